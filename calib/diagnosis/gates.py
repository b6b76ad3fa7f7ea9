"""The conditions that have to hold before a misfit is attributed to a cause."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib.diagnosis.bench import Run, SimulatedRows, simulated
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.effort import Effort
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.fit import Fit
from calib.diagnosis.noise import STATED
from calib.diagnosis.refit import Fitter
from calib.diagnosis.score import variance_along
from calib.modelling.effect import Effect
from calib.modelling.model import Model
from calib.study import Pool
from calib.units import count

MIN_WRITTEN_Z = 0.01  # smaller ones are written as below it  [1]
REFINEMENT_FACTOR = 2.0  # factor by which step and tolerance are divided  [1]


@dataclass(frozen=True)
class Gate:
    """A condition of every diagnosis.

    Attributes
    ----------
    name : "simulation", "kind of motion", "noise", "budget", or that of a numerical effect
    passed : whether it holds
    summary : in a sentence
    z : of a numerical effect, None of the others
    tried : whether it could be tested
    """

    name: str
    passed: bool
    summary: str
    z: float | None = None
    tried: bool = True


def simulates(views: Mapping[str, SimulatedRows]) -> Gate:
    """Every record can be simulated at the calibrated values."""
    bad = {name: view for name, view in views.items() if not view.usable}
    summary = "; ".join(f"{name}: {view.status} {view.reason}".strip() for name, view in bad.items())
    return Gate("simulation", not bad, summary or "every record is simulated")


def same_kind(views: Mapping[str, SimulatedRows], periodic: bool) -> Gate:
    """Measured and simulated motion have the same period; not tested where no excitation is `periodic`."""
    if not periodic:
        return Gate("kind of motion", True, "no record of a steady motion over time: kinds of motion do not apply")
    wrong = {name: view.wrong for name, view in views.items() if view.wrong}
    summary = "; ".join(f"{name}: {text}" for name, text in wrong.items())
    return Gate("kind of motion", not wrong, summary or "simulated motions have the period of the measured ones")


def fine_enough(
    pool: Pool, model: Model, values: Mapping[str, float], views: Mapping[str, SimulatedRows], effects: Sequence[Effect]
) -> list[Gate]:
    """Whether solver steps and tolerances may be the reason for a wrong kind of motion.

    values : of the calibrated model
    views : its records
    effects : those of site "numerical"
    """
    tried = [effect for effect in effects if not effect.refusal(model.simulator)]
    runs = [[Run(name, {**values, **_refined(effect)}, (effect,)) for name in views] for effect in tried]
    gates = []
    for effect, refined in _answers(pool, tried, runs):
        change = max((_change(views[name], view) for name, view in refined.items() if view.usable), default=0.0)
        summary = f"made {REFINEMENT_FACTOR:g} times finer, it changes a channel by {change:.1%}"
        coarse = f"{summary} of its rms: it may be the reason for the wrong kind of motion; make it finer"
        passed = change < CRITERIA.max_solver_change
        gates.append(Gate(effect.name, passed, summary if passed else coarse))
    return gates


def _change(one: SimulatedRows, other: SimulatedRows) -> float:
    """Largest change of a row, relative to its rms."""
    size = np.sqrt((one.rows**2).mean(axis=1))
    change = np.sqrt(((other.rows - one.rows) ** 2).mean(axis=1))
    return float((change / np.where(size > 0.0, size, np.inf)).max(initial=0.0))


def noise_known(evidence: Evidence) -> Gate:
    """The noise of every channel is stated or can be estimated: a record that states it may be short."""
    estimated = [part for part in evidence.parts if any(n.source != STATED for n in part.compared_noise)]
    short = [part for part in estimated if part.time.size < CRITERIA.min_noise_samples]
    if short:
        swept = any(part.is_swept for part in short)
        reason = (
            f"{', '.join(part.name for part in short)}: a noise level needs at least {CRITERIA.min_noise_samples} "
            f"{'points of a record of sweeps' if swept else 'samples'}, or a stated one"
        )
        return Gate("noise", False, reason)
    levels = []
    for part in evidence.parts:
        for (body, channel), noise, used in zip(part.rows, part.noise, part.used, strict=True):
            if used.any():
                correlated = ", correlated" if noise.ar.size else ""
                levels.append(f"{part.name} {body} {channel}: {noise.sigma:.3g} ({part.source_of(noise)}{correlated})")
    return Gate("noise", True, "; ".join(levels))


def above_noise(evidence: Evidence, fit: Fit) -> Gate:
    """The residual is not far smaller than the noise.

    Where it is, the noise is wrong: the motion changes within the record, or the uncertainty that the record states is
    too large. The test is on the mean square of the residual in units of the noise, by row.
    """
    below = []
    for part in evidence.parts:
        own = fit.residual[evidence.of(part.name)].reshape(part.measured.shape)
        for (body, channel), noise, row, weight in zip(part.rows, part.noise, own, part.weight, strict=True):
            counted = float((weight**2).sum())
            if counted < CRITERIA.min_noise_samples:
                continue
            ratio = float(row @ row) / counted
            deviation = (ratio - 1.0) * np.sqrt(0.5 * counted)
            if ratio < CRITERIA.min_variance_ratio and deviation < -CRITERIA.min_variance_deficit_std:
                below.append(
                    f"{part.name} {body} {channel}: the residual is {np.sqrt(ratio):.2g} times the noise of "
                    f"{noise.sigma:.3g} ({part.source_of(noise)}), {-deviation:.0f} standard deviations below it"
                )
    if not below:
        return Gate("noise level", True, "no residual is far below its noise")
    text = "; ".join(below)
    return Gate(
        "noise level",
        False,
        f"{text}: the motion changes from cycle to cycle, or the stated uncertainty is too large; record a steady "
        "motion, or correct the stated uncertainty",
    )


def budget_too_small(effort: Effort, needed: str) -> Gate:
    """The gate of a budget that does not suffice for something without which nothing can be concluded."""
    kept = f", {effort.reserve:.0f} kept for the conclusion" if effort.reserve else ""
    foreseen = f", about {effort.foreseen} foreseen in all" if effort.foreseen > effort.done else ""
    done = count(effort.done, "simulation")
    return Gate("budget", False, f"it does not suffice for {needed}: {done} done{kept}{foreseen}")


def converged(fitter: Fitter, fit: Fit, effects: Sequence[Effect], threshold: float, margin: float) -> list[Gate]:
    """Solver steps and tolerances have no influence: made finer, they change less than an effect that could be named.

    Or less than a tenth of that on which the result rests: then they bias sizes by that z at most, but do not change
    the result. As for any cause z is in standard deviations of the whole residual of the fit, not of the noise alone.

    fit : the calibrated model with its causes
    effects : those of site "numerical"
    threshold : of |z|  [1]
    margin : reduction of chi-square on which the result rests  [1]
    """
    tolerated = CRITERIA.max_solver_share * float(np.sqrt(margin))
    refusals = {effect.name: effect.refusal(fitter.model.simulator) for effect in effects}
    tried = [effect for effect in effects if not refusals[effect.name]]
    runs = [fit.point.runs(fitter.evidence.names, _refined(effect), (effect,)) for effect in tried]
    gates = []
    for effect, views in _answers(fitter.effort, tried, runs):
        bad = next((view for view in views.values() if not view.usable), None)
        if bad is not None:
            gates.append(
                Gate(effect.name, False, f"made {REFINEMENT_FACTOR:g} times finer, the simulation ends {bad.status}")
            )
            continue
        change = fit.projection(fitter.evidence.difference(fit.point.simulated, views))
        size = float(np.linalg.norm(change))
        z = size / np.sqrt(variance_along(change / size, fit.residual, fit.rows)) if size > 0.0 else 0.0
        summary = (
            f"made {REFINEMENT_FACTOR:g} times finer, it changes the records by z {_written(z)} "
            f"(threshold {threshold:.2g})"
        )
        if threshold <= z < tolerated:
            rests = f"the result rests on z = {tolerated / CRITERIA.max_solver_share:.2g}"
            summary += f"; sizes may be biased by as many standard errors, but {rests}"
        gates.append(Gate(effect.name, z < max(threshold, tolerated), summary, z))
    gates += [Gate(name, True, reason, tried=False) for name, reason in refusals.items() if reason]
    return gates


def _answers(
    pool: Pool, effects: Sequence[Effect], runs: Sequence[Sequence[Run]]
) -> Iterator[tuple[Effect, dict[str, SimulatedRows]]]:
    """Run what each effect asks for, all side by side; its records by name."""
    answers = iter(simulated(pool, list(itertools.chain.from_iterable(runs))))
    for effect, asked in zip(effects, runs, strict=True):
        yield effect, {run.record: next(answers) for run in asked}


def _written(z: float) -> str:
    """Write the value of z with two digits."""
    return f"= {z:.2g}" if z >= MIN_WRITTEN_Z else f"< {MIN_WRITTEN_Z:g}"


def _refined(effect: Effect) -> dict[str, float]:
    """Values of the parameters of a numerical effect that make steps and tolerances finer."""
    return {p.name: REFINEMENT_FACTOR for p in effect.parameters}
