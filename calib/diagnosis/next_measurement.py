"""Which further measurement would tell two explanations apart."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from scipy.linalg import block_diag

from calib.diagnosis.bench import Bench, Run, Seen, simulated
from calib.diagnosis.evidence import Part
from calib.diagnosis.refit import Fit, Fitter
from calib.diagnosis.selection import Suspect
from calib.excitation import Excitation
from calib.record import STATE
from calib.study import Pool
from calib.units import shown

AMPLITUDES = (0.1, 0.25, 0.5, 0.75, 1.25, 1.5)  # times that of a record
FREQUENCIES = (0.5, 0.8, 0.95, 0.98, 1.02, 1.05, 1.25, 2.0)
RELEASED = (0.5, 1.0, 2.0)  # times the largest displacement of a record: where a free decay begins
BEGIN = ("initial_displacement", "initial_velocity")  # parameters of simulators that can be released
NUDGE = 1e-3  # of the largest displacement and velocity: steps of the initial state
MOST = 4  # rivals that are compared
SURE = 3.0  # standard deviations by which two models have to differ to be told apart


@dataclass(frozen=True)
class Measurement:
    """A measurement that was not made, and what it would show.

    Attributes
    ----------
    said : in words
    record : beside which it would be made
    amplitude, frequency : of a harmonic excitation  [its unit], [Hz]; None for another
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
        return f"would not tell them apart (z = {self.most:.2g})"


def next_measurement(pool: Pool, bench: Bench, fitter: Fitter, rivals: Sequence[Suspect]) -> tuple[Measurement, ...]:
    """Measurements beside the first record that is driven harmonically, or beside the first, the best first.

    Another amplitude, another frequency, and a free decay where the simulator can be released.
    """
    fits = [fitter.sharpened(rival.fit) for rival in rivals if rival.fit is not None][:MOST]
    if len(fits) < 2:
        return ()
    parts = sorted(fitter.evidence.parts, key=lambda p: not bench.objective.references[p.name].excitation.harmonic)
    proposals, found = _proposals(bench, parts[0], fits[0].point.seen[parts[0].name]), []
    answers = iter(simulated(pool, [run for p in proposals for fit in fits for run in _runs(p, fit)]))
    for proposal in proposals:
        views = []
        for fit in fits:
            centre = next(answers)
            beside = [next(answers) for _ in (*fit.names, *proposal.begin)]
            views.append((centre, beside))
        if not all(view.usable and not view.wrong for centre, beside in views for view in (centre, *beside)):
            continue
        pairs = combinations(range(len(fits)), 2)
        z = [_apart(proposal, (fits[i], fits[j]), (views[i], views[j])) for i, j in pairs]
        impacts = views[0][0].impacts
        told = sum(one >= SURE for one in z)
        found.append((told, _said(proposal, None if impacts is None else impacts > 0, z)))
    found.sort(key=lambda pair: (-pair[0], -pair[1].z, -pair[1].most))
    return tuple(measurement for _, measurement in found)


@dataclass(frozen=True, eq=False)
class _Proposal:
    """A measurement to be tried.

    Attributes
    ----------
    part : the record beside which it would be made
    excitation : of it
    words : what it is
    begin : the initial state it is released from, by parameter: a number that its record would have to tell  [SI]
    nudges : steps of that
    """

    part: Part
    excitation: Excitation
    words: str
    begin: Mapping[str, float] = field(default_factory=dict)
    nudges: tuple[float, ...] = ()


def _proposals(bench: Bench, part: Part, seen: Seen) -> list[_Proposal]:
    """Excitations near that of a record, and unlike those of all records; releases.

    Where the record's initial state is a nuisance, a proposal begins from the one that was solved for, not known.
    """
    excitation = bench.objective.references[part.name].excitation
    known = [r.excitation for r in bench.objective.references.values()]
    found = []
    begin = {name: seen.nuisances[name] for name in bench.model.initial if name in seen.nuisances}
    size = NUDGE * float(np.abs(part.measured).max())
    nudges = tuple(size / float(np.abs(change).max()) for change in seen.initial) if begin else ()
    if excitation.harmonic or excitation.recorded:
        for factor in AMPLITUDES:
            words = f"{part.name} at {factor:g} times its amplitude"
            found.append(_Proposal(part, excitation.scaled(factor), words, begin, nudges))
    if excitation.harmonic:
        for factor in FREQUENCIES:
            changed = replace(excitation, frequency=factor * excitation.frequency)
            found.append(_Proposal(part, changed, f"{part.name} at {factor:g} times its frequency"))
    return [p for p in found if not any(_same(p.excitation, other) for other in known)] + _releases(bench, part)


def _releases(bench: Bench, part: Part) -> list[_Proposal]:
    """Free decays from rest, at displacements such as those of a record; none where the simulator takes none."""
    simulator = bench.model.simulator
    place = next((p for quantity, p in getattr(simulator, "excitations", ()) if quantity == "free decay"), None)
    largest: dict[str, float] = {}
    for (_, channel), row in zip(part.rows, part.measured, strict=True):
        largest[channel] = max(largest.get(channel, 0.0), float(np.abs(row).max()))
    if place is None or not set(BEGIN) <= set(bench.model.nominal) or not set(STATE) <= set(largest):
        return []
    nudges = tuple(NUDGE * largest[channel] for channel in STATE)
    free, found = Excitation(place, "free decay"), []
    for factor in RELEASED:
        begin = factor * largest["displacement"]
        words = f"a free decay, released from {shown(begin, 'm')}"
        found.append(_Proposal(part, free, words, dict(zip(BEGIN, (begin, 0.0), strict=True)), nudges))
    return found


def _same(one: Excitation, other: Excitation) -> bool:
    if one.recorded and other.recorded:
        alike = one.value.shape == other.value.shape
        return alike and np.abs(one.value - other.value).max() < 0.05 * np.abs(other.value).max()
    if not (one.harmonic and other.harmonic):
        return False
    near = abs(one.amplitude - other.amplitude) < 0.05 * other.amplitude
    return near and abs(one.frequency - other.frequency) < 0.005 * other.frequency


def _runs(proposal: _Proposal, fit: Fit) -> list[Run]:
    """The fitted model under the proposed excitation, beside it along each parameter, and along its initial state."""
    point, name = fit.point, proposal.part.name
    state = None if proposal.begin else point.seen[name].state
    own = {f"{parameter}@{name}" for parameter in proposal.begin}

    def run(values: Mapping[str, float], begin: Mapping[str, float]) -> Run:
        rest = {parameter: value for parameter, value in values.items() if parameter not in own}
        return Run(name, {**rest, **begin}, point.effects, state, proposal.excitation)

    runs = [run(point.values, proposal.begin)]
    for parameter, step in zip(fit.names, fit.steps, strict=True):
        runs.append(run({**point.values, parameter: point.values[parameter] + step}, proposal.begin))
    for parameter, step in zip(proposal.begin, proposal.nudges, strict=True):
        runs.append(run(point.values, {**proposal.begin, parameter: proposal.begin[parameter] + step}))
    return runs


def _apart(
    proposal: _Proposal, fits: tuple[Fit, Fit], seen: tuple[tuple[Seen, list[Seen]], tuple[Seen, list[Seen]]]
) -> float:
    """By how many standard deviations two models differ there, when both are fitted to that record and its nuisances.

    seen : simulations of each model, beside it along each of its parameters, and along the initial state
    """
    part = proposal.part
    (one, _), (other, _) = seen
    level = np.sqrt((one.rows**2).mean(axis=1) / (part.measured**2).mean(axis=1))
    noise = tuple(replace(n, sigma=n.sigma * max(f, 1e-12)) for n, f in zip(part.noise, level, strict=True))
    moving = np.array([channel == "velocity" for _, channel in part.rows])
    trust = np.where(moving[:, None], one.trust * other.trust, 1.0) * part.used.any(axis=1)[:, None]
    new = replace(part, time=one.time, noise=noise, weight=trust, measured=one.rows, clock=None)

    def columns(fit: Fit, centre: Seen, beside: list[Seen]) -> np.ndarray:
        moved = zip(beside, (*fit.steps, *proposal.nudges), strict=True)
        return np.column_stack([new.white(view.rows - centre.rows) / step for view, step in moved])

    def known(fit: Fit) -> np.ndarray:
        """Derivatives of the records there are: they tell nothing of the initial state of another."""
        return np.pad(fit.free(fit.columns), ((0, 0), (0, len(proposal.nudges))))

    fresh = [columns(fit, *views) for fit, views in zip(fits, seen, strict=True)]
    nuisances = new.tangents(one)
    told = block_diag(*(known(fit) for fit in fits), np.zeros((0, nuisances.shape[1])))
    stacked = np.vstack([np.column_stack([fresh[0], -fresh[1], nuisances]), told])
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
    driven = (e.amplitude, e.frequency) if e.harmonic else (None, None)
    return Measurement(proposal.words + contact, proposal.part.name, *driven, impacts, min(z), max(z))
