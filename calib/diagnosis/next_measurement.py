"""Which further measurement would tell two explanations apart."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.linalg import block_diag

from calib.diagnosis.bench import Bench, Run, Seen, simulated
from calib.diagnosis.evidence import Part
from calib.diagnosis.refit import Fit, Fitter
from calib.diagnosis.selection import Suspect
from calib.excitation import Excitation
from calib.study import Pool

AMPLITUDES = (0.1, 0.25, 0.5, 0.75, 1.25, 1.5)  # times that of a record
FREQUENCIES = (0.5, 0.8, 0.95, 0.98, 1.02, 1.05, 1.25, 2.0)
MOST = 4  # rivals that are compared
SURE = 3.0  # standard deviations by which two models have to differ to be told apart


@dataclass(frozen=True)
class Measurement:
    """A measurement that was not made, and what it would show.

    Attributes
    ----------
    said : in words
    record : beside which it would be made
    amplitude, frequency : of the excitation  [its unit], [Hz]; None for a free decay
    impacts : whether it has any; None where the simulator does not tell
    z : by which the two most alike of the rivals would differ, both fitted to it too, at the record's noise
    most : the same of the two least alike
    """

    said: str
    record: str
    amplitude: float | None
    frequency: float | None
    impacts: bool | None
    z: float
    most: float

    @property
    def helps(self) -> str:
        """What it would bring, as the end of a sentence."""
        if self.z >= SURE:
            return f"would tell them apart (z = {self.z:.3g})"
        if self.most >= SURE:
            return f"would tell some of them apart (z = {self.z:.2g} to {self.most:.3g})"
        return f"would not tell them apart (z = {self.most:.2g}), nor would another amplitude or frequency tried"


def next_measurement(
    pool: Pool, bench: Bench, fitter: Fitter, rivals: Sequence[Suspect]
) -> tuple[Measurement, ...]:
    """Measurements beside the first record that is driven harmonically, the most separating first."""
    fits = [fitter.sharpened(rival.fit) for rival in rivals if rival.fit is not None][:MOST]
    if len(fits) < 2:
        return ()
    parts = [p for p in fitter.evidence.parts if bench.objective.references[p.name].excitation.harmonic]
    proposals = _proposals(bench, parts[0]) if parts else []
    if not proposals:
        return ()
    found = []
    answers = iter(simulated(pool, [run for p in proposals for fit in fits for run in _runs(p, fit)]))
    for proposal in proposals:
        views = []
        for fit in fits:
            centre = next(answers)
            beside = [next(answers) for _ in fit.names]
            views.append((centre, beside))
        if not all(view.usable and all(b.usable for b in beside) for view, beside in views):
            continue
        pairs = combinations(range(len(fits)), 2)
        z = [_apart(proposal.part, (fits[i], fits[j]), (views[i], views[j])) for i, j in pairs]
        impacts = views[0][0].impacts
        told = sum(one >= SURE for one in z)
        found.append((told, _said(proposal, None if impacts is None else impacts > 0, z)))
    found.sort(key=lambda pair: (-pair[0], -pair[1].z, -pair[1].most))
    return tuple(measurement for _, measurement in found)


@dataclass(frozen=True, eq=False)
class _Proposal:
    part: Part
    excitation: Excitation
    words: str


def _proposals(bench: Bench, part: Part) -> list[_Proposal]:
    """Excitations near that of a record which is driven harmonically, and unlike those of all records."""
    excitation = bench.objective.references[part.name].excitation
    known = [r.excitation for r in bench.objective.references.values() if r.excitation.harmonic]
    found = []
    for factor in AMPLITUDES:
        changed = replace(excitation, amplitude=factor * excitation.amplitude)
        found.append(_Proposal(part, changed, f"{part.name} at {factor:g} times its amplitude"))
    for factor in FREQUENCIES:
        changed = replace(excitation, frequency=factor * excitation.frequency)
        found.append(_Proposal(part, changed, f"{part.name} at {factor:g} times its frequency"))
    return [p for p in found if not any(_same(p.excitation, other) for other in known)]


def _same(one: Excitation, other: Excitation) -> bool:
    near = abs(one.amplitude - other.amplitude) < 0.05 * other.amplitude
    return near and abs(one.frequency - other.frequency) < 0.005 * other.frequency


def _runs(proposal: _Proposal, fit: Fit) -> list[Run]:
    """The fitted model under the proposed excitation, and beside it along each parameter."""
    point, name = fit.point, proposal.part.name
    runs = [Run(name, point.values, point.effects, point.seen[name].state, proposal.excitation)]
    for parameter, step in zip(fit.names, fit.steps, strict=True):
        values = {**point.values, parameter: point.values[parameter] + step}
        runs.append(Run(name, values, point.effects, point.seen[name].state, proposal.excitation))
    return runs


def _apart(part: Part, fits: tuple[Fit, Fit], seen: tuple[tuple[Seen, list[Seen]], tuple[Seen, list[Seen]]]) -> float:
    """By how many standard deviations two models differ there, when both are fitted to that record too.

    seen : simulations of each model, and beside it along each of its parameters
    """
    (one, _), (other, _) = seen
    level = np.sqrt((one.rows**2).mean(axis=1) / (part.measured**2).mean(axis=1))
    noise = tuple(replace(n, sigma=n.sigma * max(f, 1e-12)) for n, f in zip(part.noise, level, strict=True))
    moving = np.array([channel == "velocity" for _, channel in part.rows])
    trust = np.where(moving[:, None], one.trust * other.trust, 1.0) * part.used.any(axis=1)[:, None]
    new = replace(part, noise=noise, weight=trust, measured=one.rows)

    def columns(fit: Fit, centre: Seen, beside: list[Seen]) -> np.ndarray:
        moved = zip(beside, fit.steps, strict=True)
        return np.column_stack([new.white(view.rows - centre.rows) / step for view, step in moved])

    fresh = [columns(fit, *views) for fit, views in zip(fits, seen, strict=True)]
    stacked = np.vstack([np.column_stack([fresh[0], -fresh[1]]), block_diag(*(fit.free(fit.columns) for fit in fits))])
    target = np.zeros(len(stacked))
    difference = new.white(other.rows - one.rows)
    target[: difference.size] = difference
    scale = np.linalg.norm(stacked, axis=0)
    scale[scale == 0.0] = 1.0
    move = np.linalg.lstsq(stacked / scale, target, rcond=1e-10)[0]
    return float(np.linalg.norm(target - (stacked / scale) @ move))


def _said(proposal: _Proposal, impacts: bool | None, z: Sequence[float]) -> Measurement:
    contact = {True: ", with impacts", False: ", without impacts", None: ""}[impacts]
    e = proposal.excitation
    return Measurement(proposal.words + contact, proposal.part.name, e.amplitude, e.frequency, impacts, min(z), max(z))
