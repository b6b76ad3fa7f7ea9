"""The record made of the curves of a figure."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import xarray as xr
from scipy.optimize import isotonic_regression, minimize_scalar

from calib import records
from calib.digitise.clock import LoopClock, NodeLoop, clock, loop
from calib.digitise.reading import Reading
from calib.digitise.response_assembly import assembled_response
from calib.digitise.spec import FigureToml
from calib.digitise.uncertainty import propagated
from calib.errors import CalibError
from calib.records.excitation import unit_of
from calib.units import shown, to_si

MAX_PERIOD_ERROR = 0.1  # relative difference of the time once round from whole periods of the excitation
WARNING_SIGMAS = 3.0  # standard uncertainties: a larger difference gives a warning
MIN_PERIOD_DIFFERENCE = 0.002  # relative difference of periods below which there is no warning
MAX_BACKWARDS = 0.01  # of the period, for which a curve may run against time without a warning
MAX_ZERO_OFFSET = 0.01  # of the greatest speed: velocity at turning points without a warning
MAX_SCALE_SIGMA = 0.01  # standard uncertainty of a scale above which a study solves for it
MIN_SHARE_OF_PERIOD = 0.97  # that a diagram over time has to show
COMPARED_INSTANTS = 32  # of the end of a diagram with what it shows some periods earlier
TRIED_LOOP_STARTS = 400  # instants tried for the start of a loop within a diagram over time


@dataclass(frozen=True, eq=False)
class TimedLoop:
    """A phase curve with its time.

    Attributes
    ----------
    reading : it was made from
    loop : its nodes
    sigma : (2, node) standard uncertainty of displacement and velocity at a node's time  [m], [m/s]
    time : (node + 1,) from 0 at the greatest displacement, stretched to the period that it is given  [s]
    """

    reading: Reading
    loop: NodeLoop
    sigma: np.ndarray
    time: np.ndarray

    def at(self, instants: np.ndarray) -> np.ndarray:
        """Displacement, velocity and their uncertainty (4, n) at instants (n,) [s]."""
        period = self.time[-1]
        rows = np.array([self.loop.displacement, self.loop.velocity, *self.sigma])
        return np.array([np.interp(instants % period, self.time, np.append(row, row[0])) for row in rows])


@dataclass
class Findings:
    """Results of the assembly: attributes of the record, and notes and warnings for its user."""

    attrs: dict[str, float | int | str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


def assembled(readings: Sequence[Reading], spec: FigureToml) -> tuple[xr.Dataset, Findings]:
    """Make a record of what was read off a figure.

    Raises
    ------
    CalibError : curves that contradict one another, or that share no common clock
    """
    findings = Findings()
    for reading in readings:
        findings.notes += [f"{reading.body}, {reading.kind}: {note}" for note in reading.notes]
    if any(reading.sweep is not None for reading in readings):
        return assembled_response(readings, spec), findings
    given = _by_body(readings)
    period, excitation = _excitation(spec)
    loops = {body: kinds["phase curve"] for body, kinds in given.items() if "phase curve" in kinds}
    timeless = [body for body, kinds in given.items() if set(kinds) == {"phase curve"}]
    if len(timeless) > 1 or (timeless and len(given) > 1):
        raise CalibError(
            f"phase curves show no time, so that the phase between {timeless[0]!r} and "
            f"{next(b for b in given if b != timeless[0])!r} is unknown; give the displacement over time of each, "
            f"or make a record of each: --body {timeless[0]}"
        )
    if not loops:
        record = _of_diagrams(given, period, spec.samples, findings)
    else:
        record = _of_loops(given, loops, period, spec.samples, findings)
    attrs = {**excitation, **findings.attrs, "source": spec.source}
    if "frequency" in findings.attrs:
        findings.warnings.append("no frequency of the excitation was stated; that of the loop itself was taken")
    return record.assign_attrs(attrs), findings


def _by_body(readings: Sequence[Reading]) -> dict[str, dict[str, Reading]]:
    given: dict[str, dict[str, Reading]] = {}
    for reading in readings:
        kinds = given.setdefault(reading.body, {})
        if reading.kind in kinds:
            raise CalibError(f"two curves are the {reading.kind} of body {reading.body!r}; keep one")
        kinds[reading.kind] = reading
    return given


def _excitation(spec: FigureToml) -> tuple[float | None, dict[str, float | str]]:
    """Period [s], and attributes of the record."""
    if spec.excitation is None:
        return None, {}
    attrs: dict[str, float | str] = {"place": spec.excitation.place, "quantity": spec.excitation.quantity}
    unit = unit_of(spec.excitation.quantity)
    if spec.excitation.amplitude is not None:
        attrs["amplitude"] = to_si(spec.excitation.amplitude, unit)
    if spec.excitation.frequency is None:
        return None, attrs
    frequency = attrs["frequency"] = to_si(spec.excitation.frequency, "Hz")
    return 1.0 / frequency, attrs


# --- phase curves


def _timed(reading: Reading, period: float | None, samples: int, findings: Findings) -> TimedLoop:
    """Find the time along a phase curve; `period` is that of the excitation, None where it is not known."""
    where = f"phase curve of {reading.body}"
    try:
        drawn = loop(reading.points)
        noise = float(np.sqrt(np.mean(reading.sigma[:, 0] ** 2)))
        timing = clock(drawn, noise)
    except CalibError as error:
        raise CalibError(f"{where}: {error}") from error
    modes = drawn.carried(reading.modes)
    once = timing.period
    cycles = 1
    if period is not None:
        cycles = max(1, round(once / period))
        off = once / (cycles * period) - 1.0
        if abs(off) > MAX_PERIOD_ERROR:
            raise CalibError(
                f"{where}: going round it takes {shown(once, 's')}, which is {once / period:.2f} periods of the "
                f"excitation of {shown(period, 's')}; expected whole ones: check units, axis points and frequency"
            )
        once = cycles * period
    displaced, quickened, lasting = propagated(drawn, timing, modes, once, once / (cycles * samples))
    local = drawn.carried(reading.sigma[None] ** 2)[0]
    sigma = np.sqrt(np.array([displaced**2 + local[:, 0], quickened**2 + local[:, 1]]))
    _closure(where, reading, timing, lasting, once, period, findings)
    findings.attrs["returns_after"] = cycles
    if period is None:
        findings.attrs["frequency"] = 1.0 / once
    start = int(np.argmax(drawn.displacement))
    time = np.diff(timing.time)
    time = np.concatenate([[0.0], np.cumsum(np.roll(time, -start))]) * (once / timing.period)
    rolled = NodeLoop(
        np.roll(drawn.displacement, -start), np.roll(drawn.velocity, -start), np.roll(drawn.position, -start),
        drawn.reversed,
    )  # fmt: skip
    return TimedLoop(reading, rolled, np.roll(sigma, -start, axis=1), time)


def _closure(
    where: str,
    reading: Reading,
    timing: LoopClock,
    lasting: float,
    once: float,
    period: float | None,
    findings: Findings,
) -> None:
    """Add to the findings how well the loop closes in time."""
    body = reading.body
    findings.attrs[f"closure_drift_{body}"] = timing.drift
    findings.attrs[f"closure_backwards_{body}"] = timing.backwards
    findings.attrs[f"closure_period_sigma_{body}"] = lasting
    note = f"{where}: once round in {shown(timing.period, 's', 5)} +- {100.0 * lasting:.2g} %"
    if period is not None:
        off = timing.period / once - 1.0
        findings.attrs[f"closure_period_{body}"] = off
        note += f", {100.0 * off:+.2g} % off {round(once / period)} period(s) of the excitation, then stretched to them"
        if abs(off) > max(WARNING_SIGMAS * lasting, MIN_PERIOD_DIFFERENCE):
            findings.warnings.append(
                f"{where}: its own time once round is {100.0 * off:+.2g} % off the period of the excitation, with an "
                f"uncertainty of {100.0 * lasting:.2g} %; are units, axis points and frequency right?"
            )
    findings.notes.append(note)
    if np.isfinite(timing.zero):
        findings.attrs[f"closure_zero_{body}"] = timing.zero
    if abs(timing.zero) > MAX_ZERO_OFFSET:
        findings.warnings.append(
            f"{where}: displacement turns where velocity is {100.0 * timing.zero:+.2g} % of its greatest, not zero; "
            "is the zero of the velocity axis where it should be, and does the page stand straight?"
        )
    if timing.backwards > MAX_BACKWARDS:
        findings.warnings.append(
            f"{where}: over {100.0 * timing.backwards:.2g} % of the period the curve runs against time; is the zero of "
            "the velocity axis where it should be, and is the page calibrated?"
        )


def _of_loops(
    given: Mapping[str, Mapping[str, Reading]],
    loops: Mapping[str, Reading],
    period: float | None,
    samples: int,
    findings: Findings,
) -> xr.Dataset:
    """Record of one cycle of bodies with phase curves, and of others with diagrams over time."""
    timed = {}
    for body, reading in loops.items():
        timed[body] = _timed(reading, period, samples, findings)
        period = period or float(timed[body].time[-1])
    spans = {body: round(one.time[-1] / period) for body, one in timed.items()}
    if len(set(spans.values())) > 1:
        raise CalibError(f"the phase curves close after different numbers of periods of the excitation, {spans}")
    cycles = next(iter(spans.values()))
    count = samples * cycles
    grid = np.arange(count) * (cycles * period / count)
    rows: dict[str, dict[str, tuple[np.ndarray, np.ndarray]]] = {}
    for body, kinds in given.items():
        own: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        diagrams = [kinds[k] for k in ("displacement over time", "velocity over time") if k in kinds]
        if body in timed:
            start = _start(timed[body], diagrams, findings) if diagrams else 0.0
            x, v, sigma_x, sigma_v = timed[body].at(grid - start)
            own = {"displacement": (x, sigma_x), "velocity": (v, sigma_v)}
        for diagram in diagrams:
            channel = diagram.kind.partition(" ")[0]
            folded = _folded(diagram, grid, cycles * period, findings)
            own[channel] = _mean(own[channel], folded) if channel in own else folded
        rows[body] = own
    _nuisances(timed, findings)
    return _made(grid, rows)


def _made(time: np.ndarray, rows: Mapping[str, Mapping[str, tuple[np.ndarray, np.ndarray]]]) -> xr.Dataset:
    shared = [c for c in records.STATE if all(c in own for own in rows.values())]
    if not shared:
        raise CalibError(f"the bodies {list(rows)} share no channel; give displacement, or velocity, of all of them")
    channels = {c: np.array([own[c][0] for own in rows.values()]) for c in shared}
    channels |= {f"{c}_sigma": np.array([own[c][1] for own in rows.values()]) for c in shared}
    return records.make(time, list(rows), channels)


def _nuisances(timed: Mapping[str, TimedLoop], findings: Findings) -> None:
    """State which nuisances a study should solve for, and the standard uncertainty of the axes.

    The zero of the displacement is seldom that of the model, and a free shear loses no information. A free scale loses
    the amplitude, so it is freed only where the axes do not determine it.
    """
    variances: dict[str, float] = {}
    for body, one in timed.items():
        points, modes = one.reading.points, one.reading.modes[: one.reading.axes]
        design = np.column_stack([points, np.ones(len(points))])
        for mode in modes:
            across = np.linalg.lstsq(design, mode[:, 0], rcond=None)[0]
            up = np.linalg.lstsq(design, mode[:, 1], rcond=None)[0]
            for name, value in (("scale.displacement", across[0]), ("shear", across[1]), (f"offset.{body}", across[2]),
                                ("scale.velocity", up[1])):  # fmt: skip
                variances[name] = variances.get(name, 0.0) + value**2 / (1 if name.startswith("offset") else len(timed))
    sigmas = {name: float(f"{np.sqrt(value):.4g}") for name, value in variances.items()}
    freed = ["trigger", "offset", *(["shear"] if "shear" in sigmas else [])]
    if max(sigmas.get("scale.displacement", 0.0), sigmas.get("scale.velocity", 0.0)) > MAX_SCALE_SIGMA:
        freed.append("scale")
    findings.attrs["nuisance"] = ", ".join(freed)
    if sigmas:
        findings.attrs["nuisance_sigma"] = json.dumps(sigmas)


# --- diagrams over time


def _in_time(reading: Reading) -> tuple[np.ndarray, np.ndarray]:
    """Time (n,), never falling, and values (n,) of a diagram."""
    time, values = reading.points.T
    if time[-1] < time[0]:
        time, values = time[::-1], values[::-1]
    steady = np.asarray(isotonic_regression(time).x)
    return steady + np.arange(time.size) * 1e-12 * np.ptp(time), values


def _errors(reading: Reading, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Standard uncertainty (n,) of the values, that of their time included."""
    turned = reading.points[-1, 0] < reading.points[0, 0]
    every = np.concatenate([reading.modes, np.zeros((1, *reading.sigma.shape))])
    spread = np.sqrt((every**2).sum(axis=0) + reading.sigma**2)
    spread = spread[::-1] if turned else spread
    late = spread[:, 0]
    reach = np.maximum(late, 1e-9 * np.ptp(time))
    slope = (np.interp(time + reach, time, values) - np.interp(time - reach, time, values)) / (2.0 * reach)
    return np.hypot(spread[:, 1], slope * late)


def _of_diagrams(
    given: Mapping[str, Mapping[str, Reading]], period: float | None, samples: int, findings: Findings
) -> xr.Dataset:
    """Record of diagrams over time alone: all whole periods that all of them show, or all of it without a period."""
    readings = [reading for kinds in given.values() for reading in kinds.values()]
    drawn = {id(r): _in_time(r) for r in readings}
    first = max(time[0] for time, _ in drawn.values())
    last = min(time[-1] for time, _ in drawn.values())
    span = last - first
    if span <= 0.0:
        raise CalibError("the diagrams share no time; are their units right?")
    if period is not None:
        cycles = int(span / period + 1.0 - MIN_SHARE_OF_PERIOD)
        if cycles < 1:
            raise CalibError(
                f"the diagrams share {shown(span, 's')}, less than the period of {shown(period, 's')} that the "
                "excitation has; a record needs one at least: are the units of time right?"
            )
        grid = first + np.arange(samples * cycles) * period / samples
    else:
        grid = np.linspace(first, last, samples)
    rows: dict[str, dict[str, tuple[np.ndarray, np.ndarray]]] = {}
    for body, kinds in given.items():
        for reading in kinds.values():
            row = _at(reading, grid, period, findings)
            rows.setdefault(body, {})[reading.kind.partition(" ")[0]] = row
    record = _made(grid - grid[0], rows)
    return record.assign_attrs(nuisance="trigger, offset" if period else "offset")


def _folded(reading: Reading, grid: np.ndarray, length: float, findings: Findings) -> tuple[np.ndarray, np.ndarray]:
    """Mean cycle of a diagram at instants within `length` [s], with its uncertainty."""
    time, values = _in_time(reading)
    if time[-1] - time[0] < MIN_SHARE_OF_PERIOD * length:
        raise CalibError(
            f"{reading.kind} of {reading.body}: it shows {shown(time[-1] - time[0], 's')}, less than the "
            f"{shown(length, 's')} after which the motion returns; are the units of time right?"
        )
    errors = _errors(reading, time, values)
    turns = np.arange(np.floor(time[0] / length) - 1, np.ceil(time[-1] / length) + 1)
    instants = grid[None] + length * turns[:, None]
    inside = (instants >= time[0]) & (instants <= time[-1])
    counts = np.maximum(inside.sum(axis=0), 1)
    mean, sigma = ((np.interp(instants, time, row) * inside).sum(axis=0) / counts for row in (values, errors))
    missing = ~inside.any(axis=0)
    if missing.any():
        after = time[-1] + (grid[missing] - time[-1]) % length
        mean[missing], sigma[missing] = _across(time, values, errors, after, length)
        findings.notes.append(_note(reading, time[0] + length - time[-1], "a straight line to its beginning"))
    return mean, sigma


def _at(reading: Reading, grid: np.ndarray, period: float | None, findings: Findings) -> tuple[np.ndarray, np.ndarray]:
    """Values (n,) of a diagram at the instants of a grid [s], with their uncertainty.

    What a diagram does not show of its last period is what it shows some periods earlier: so many as make both most
    alike just before it ends. How unlike they are there is added to the uncertainty.
    """
    time, values = _in_time(reading)
    errors = _errors(reading, time, values)
    row, sigma = np.interp(grid, time, values), np.interp(grid, time, errors)
    missing = grid > time[-1]
    if period is None or not missing.any():
        return row, sigma
    late, lacking = grid[missing], float(grid[-1] - time[-1])
    before = np.linspace(time[-1] - (1.0 - MIN_SHARE_OF_PERIOD) * period, time[-1], COMPARED_INSTANTS)
    lags = period * np.arange(1, int((before[0] - time[0]) / period) + 1)
    lags = lags[late[0] - lags >= time[0]]
    if lags.size:
        unlike = [np.interp(before, time, values) - np.interp(before - lag, time, values) for lag in lags]
        sizes = np.sqrt(np.mean(np.square(unlike), axis=1))
        best = int(np.argmin(sizes))
        row[missing] = np.interp(late - lags[best], time, values)
        sigma[missing] = np.hypot(np.interp(late - lags[best], time, errors), sizes[best])
        findings.notes.append(_note(reading, lacking, f"what it shows {best + 1} period(s) earlier"))
    else:
        length = period * round((grid[-1] - grid[0]) / period)
        row[missing], sigma[missing] = _across(time, values, errors, late, length)
        findings.notes.append(_note(reading, lacking, "a straight line to its beginning"))
    return row, sigma


def _across(
    time: np.ndarray, values: np.ndarray, errors: np.ndarray, late: np.ndarray, length: float
) -> tuple[np.ndarray, np.ndarray]:
    """Values and uncertainties (n,) at instants between the end of a diagram and its beginning, one `length` later.

    On the straight line between both, uncertain as any value between both is.
    """
    ends = [time[-1], time[0] + length]
    step = float(values[0] - values[-1])
    row, sigma = (np.interp(late, ends, [drawn[-1], drawn[0]]) for drawn in (values, errors))
    return row, np.hypot(sigma, step / np.sqrt(12.0))  # of a uniform distribution


def _note(reading: Reading, lacking: float, instead: str) -> str:
    return (
        f"{reading.body}: {reading.kind} ends {shown(lacking, 's', 2)} before whole periods; {instead} is taken there, "
        "with an uncertainty that is widened"
    )


def _mean(one: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Mean of two readings of one channel, weighed by their variances."""
    weights = 1.0 / np.array([one[1], other[1]]) ** 2
    mean = (weights * np.array([one[0], other[0]])).sum(axis=0) / weights.sum(axis=0)
    return mean, np.sqrt(1.0 / weights.sum(axis=0))


def _start(timed: TimedLoop, diagrams: Sequence[Reading], findings: Findings) -> float:
    """Instant [s] of the diagrams' time at which the loop begins, and how well both agree."""
    first = diagrams[0]
    row = 0 if first.kind.startswith("displacement") else 1
    time, values = _in_time(first)
    errors = _errors(first, time, values)
    length = float(timed.time[-1])
    even = np.linspace(time[0], time[-1], 2000)
    drawn, error = np.interp(even, time, values), np.interp(even, time, errors)

    def mean_square(start: float) -> float:
        return float(np.mean((drawn - timed.at(even - start)[row]) ** 2))

    tried = np.arange(TRIED_LOOP_STARTS) * length / TRIED_LOOP_STARTS
    best = float(tried[np.argmin([mean_square(start) for start in tried])])
    step = length / TRIED_LOOP_STARTS
    start = float(minimize_scalar(mean_square, bounds=(best - step, best + step), method="bounded").x)
    of_loop = timed.at(even - start)
    scale, offset = np.linalg.lstsq(np.column_stack([of_loop[row], np.ones(even.size)]), drawn, rcond=None)[0]
    size = float(np.ptp(timed.loop.displacement if row == 0 else timed.loop.velocity)) / 2.0
    rest = float(np.sqrt(mean_square(start)))
    expected = float(np.sqrt(np.mean(of_loop[2 + row] ** 2 + error**2)))
    body, kind = timed.reading.body, first.kind
    findings.attrs[f"reconciled_scale_{body}"] = float(scale)
    findings.attrs[f"reconciled_offset_{body}"] = float(offset)
    findings.attrs[f"reconciled_rest_{body}"] = rest / size
    note = (
        f"{body}: {kind} and phase curve differ by {100.0 * rest / size:.2g} % of the amplitude (root mean square; "
        f"{100.0 * expected / size:.2g} % expected), scale {scale:.4f}, offset {100.0 * offset / size:+.2g} %"
    )
    findings.notes.append(note)
    if rest > WARNING_SIGMAS * expected:
        findings.warnings.append(
            f"{note}: more than {WARNING_SIGMAS:g} times their uncertainty; is it the same motion?"
        )
    return start
