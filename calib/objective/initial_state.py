"""The initial state of one record, solved for as a nuisance of that record alone.

The state s minimises the squared difference of measured and simulated channels, each over the measured root mean square
about its mean, with the linear nuisances at their best for every s (variable projection: Golub and Pereyra, Inverse
Problems 19, 2003). Gauss-Newton steps with forward differences start from the record's own first samples, so that the
same values give the same bits whatever was simulated before.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.modelling.model import Model
from calib.modelling.parameter import Parameter
from calib.objective.outliers import STD_PER_MAD, isolated_outliers
from calib.records import OK, SIMULATIONS

STATE_ATTRIBUTE = "initial_state"  # of a simulated record: the state that was solved for, as JSON [SI]

MAX_STATE_STEPS = 4  # of the search for the state, by the method of Gauss and Newton  [count]
MAX_STATE_HALVINGS = 4  # of a step that does not reduce the squared difference
STATE_DIFFERENCE_STEP = 1e-3  # of a state's scale
MAX_REDUCTION_RATIO = 0.03  # of one predicted reduction to the next: above it, the derivatives are taken anew
RESIDUAL_CHANGE_TOLERANCE = 1e-6  # predicted change of the residual over the residual, which ends the search  [1]
CHANNEL_ROUNDING = 1e-11  # the same, relative to the measured channels
STATE_RANK_TOLERANCE = 1e-9  # singular value over the largest: below it a direction of the state is undetermined  [1]

MIN_WINDOW, CUBIC_WINDOW = 6, 12  # samples of the local polynomial: least number, and from which on it is a cubic
HUBER_THRESHOLD = 1.345  # of Huber's weights, in standard deviations (Holland & Welsch 1977)
MAX_HUBER_STEPS = 30  # of iteratively reweighted least squares  [count]


@dataclass(frozen=True, eq=False)
class Unknown:
    """One component of an initial state, estimated from the record alone.

    Attributes
    ----------
    name : of the simulator's parameter
    start : where the search begins  [its unit]
    scale : size of its changes  [its unit]
    low, high : bounds  [its unit]
    """

    name: str
    start: float
    scale: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class View:
    """A simulated record beside the measured one.

    Attributes
    ----------
    record : simulated
    channels : name -> (body, time) on the time base of the reference, linear nuisances applied, in SI
    residual : (n,) measured less simulated, weighted
    weight : (n,)
    status : "ok", or why there is nothing to compare
    """

    record: xr.Dataset
    channels: Mapping[str, np.ndarray] = field(default_factory=dict)
    residual: np.ndarray = field(default_factory=lambda: np.zeros(0))
    weight: np.ndarray = field(default_factory=lambda: np.zeros(0))
    status: str = OK


@dataclass(frozen=True, eq=False)
class Released:
    """A simulated record whose initial state was solved for.

    Attributes
    ----------
    record : simulated, with the state and the number of simulations among its attributes; a failed one where a
        simulation on the way to it failed
    slopes : parameter -> channel -> (body, time) change of the aligned channels with the parameter, in SI
    simulations : that it took
    """

    record: xr.Dataset
    slopes: Mapping[str, Mapping[str, np.ndarray]]
    simulations: int


def initial_state(record: xr.Dataset) -> dict[str, float]:
    """Initial state that was solved for, by parameter [SI]; empty where none was."""
    return json.loads(record.attrs.get(STATE_ATTRIBUTE, "{}"))


def with_initial_state(record: xr.Dataset, state: Mapping[str, float]) -> xr.Dataset:
    """Return a simulated record with the initial state that was solved for, by parameter [SI], as an attribute."""
    return record.assign_attrs({STATE_ATTRIBUTE: json.dumps(dict(state))})


def no_initial_state(model: Model) -> str:
    """Why the initial state of a record cannot be solved for with a model whose simulator declares none."""
    return (
        f"simulator {model.simulator.name!r} does not say which of its parameters are the initial state (its attribute "
        "`initial`; see calib.modelling.simulator.Simulator), so the nuisance 'initial_state' cannot be solved for; "
        "drop it, and search such parameters in [windows]"
    )


def simulations(record: xr.Dataset) -> int:
    """Runs of the simulator that a record took."""
    return int(record.attrs.get(SIMULATIONS, 1))


class Comparison:
    """The samples of a reference from which its initial state is solved.

    Isolated outliers of the measured channels have no weight, nor has what the excitation prescribes.

    Parameters
    ----------
    record : the reference
    rows : (body, channel) pairs that are compared
    """

    def __init__(self, record: xr.Dataset, rows: Sequence[tuple[str, str]]):
        bodies = [str(body) for body in record.body.values]
        self.rows = [(channel, bodies.index(body)) for body, channel in rows]
        self.measured = np.array([record[channel].values[index] for channel, index in self.rows])
        spread = self.measured.std(axis=1, keepdims=True)
        size = np.where(spread > 0.0, spread, np.abs(self.measured).max(axis=1, keepdims=True))
        self.weight = ~isolated_outliers(self.measured) / np.where(size > 0.0, size, 1.0)

    def view(self, record: xr.Dataset, channels: Mapping[str, np.ndarray], trust: np.ndarray) -> View:
        """View of a simulated record with its aligned channels; `trust` (time,) is that in its velocities."""
        weights = [w * (trust if c == "velocity" else 1.0) for (c, _), w in zip(self.rows, self.weight, strict=True)]
        weight = np.concatenate(weights)
        return View(record, channels, weight * (self.measured.ravel() - self.stacked(channels)), weight)

    def stacked(self, channels: Mapping[str, np.ndarray]) -> np.ndarray:
        """Compared rows of some channels (body, time), one after the other (n,); zeros for an absent channel."""
        none = np.zeros(self.measured.shape[1])
        return np.concatenate([channels[c][index] if c in channels else none for c, index in self.rows])


def released(
    simulate: Callable[[Mapping[str, float]], View],
    compared: Comparison,
    unknowns: Sequence[Unknown],
) -> Released:
    """Simulate a record with the initial state that fits it best.

    Parameters
    ----------
    simulate : called with an initial state, by parameter [SI]
    compared : of the reference
    unknowns : components of the state

    Raises
    ------
    CalibError : the initial state changes nothing that is compared
    """
    return _Search(simulate, compared, unknowns).released()


Slopes = list[dict[str, np.ndarray]]  # one for each unknown: channel -> (body, time)


class _Search:
    """Gauss-Newton's search for one initial state; counts its simulations."""

    def __init__(
        self, simulate: Callable[[Mapping[str, float]], View], compared: Comparison, unknowns: Sequence[Unknown]
    ):
        self.simulate, self.compared, self.unknowns = simulate, compared, unknowns
        self.scale = np.array([u.scale for u in unknowns])
        self.low, self.high = np.array([u.low for u in unknowns]), np.array([u.high for u in unknowns])
        self.count = 0

    def released(self) -> Released:
        state = np.clip([u.start for u in self.unknowns], self.low, self.high)
        now = self._view(state)
        if now.status != OK:
            return self._failed(now)
        size = float(np.linalg.norm(now.weight * self.compared.measured.ravel()))
        slopes: Slopes = []
        before = np.inf
        for _ in range(MAX_STATE_STEPS):
            if slopes:
                step, change = self._step(now, slopes)
            if not slopes or change > MAX_REDUCTION_RATIO * before:
                taken = self._slopes(now, state)
                if isinstance(taken, View):
                    return self._failed(taken)
                slopes = taken
                self._check(now, slopes, size)
                step, change = self._step(now, slopes)
            if change <= RESIDUAL_CHANGE_TOLERANCE * np.linalg.norm(now.residual) + CHANNEL_ROUNDING * size:
                break
            ahead = self._ahead(now, state, step)
            if isinstance(ahead, View):
                return self._failed(ahead)
            if ahead is None:
                break
            (state, now), before = ahead, change
        return self._finished(now, state, slopes)

    def _view(self, state: np.ndarray) -> View:
        self.count += 1
        return self.simulate(self._named(state))

    def _named(self, state: np.ndarray) -> dict[str, float]:
        return {u.name: float(value) for u, value in zip(self.unknowns, state, strict=True)}

    def _slopes(self, now: View, state: np.ndarray) -> Slopes | View:
        """Forward differences of the aligned channels, backward where the state ahead fails; or the failed view."""
        slopes = []
        for index, unknown in enumerate(self.unknowns):
            step = STATE_DIFFERENCE_STEP * unknown.scale
            room = (1.0, -1.0) if state[index] + step <= unknown.high else (-1.0,)
            for sign in room:
                beside = state.copy()
                beside[index] += sign * step
                view = self._view(beside)
                if view.status == OK:
                    break
            else:
                return view
            moved = beside[index] - state[index]
            slopes.append({c: (view.channels[c] - now.channels[c]) / moved for c in now.channels})
        return slopes

    def _columns(self, now: View, slopes: Slopes) -> np.ndarray:
        """Weighted changes (n, k) with each unknown over its scale."""
        return np.column_stack([now.weight * self.compared.stacked(own) for own in slopes]) * self.scale

    def _step(self, now: View, slopes: Slopes) -> tuple[np.ndarray, float]:
        """Step (k,) of the state, and the norm of the change of the residual that it predicts."""
        columns = self._columns(now, slopes)
        step = np.linalg.lstsq(columns, now.residual, rcond=STATE_RANK_TOLERANCE)[0]
        return step * self.scale, float(np.linalg.norm(columns @ step))

    def _check(self, now: View, slopes: Slopes, size: float) -> None:
        if np.linalg.norm(self._columns(now, slopes), axis=0).max() <= CHANNEL_ROUNDING * size:
            names = ", ".join(u.name for u in self.unknowns)
            raise CalibError(
                f"the initial state ({names}) changes nothing that is compared; drop 'initial_state' from the "
                "nuisances of this record"
            )

    def _ahead(self, now: View, state: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, View] | View | None:
        """State and view after the step, halved until it reduces the residual; else a failed view, or None."""
        failed = None
        for halving in range(MAX_STATE_HALVINGS + 1):
            there = np.clip(state + 0.5**halving * step, self.low, self.high)
            view = self._view(there)
            if view.status != OK:
                failed = view
            elif np.linalg.norm(view.residual) < np.linalg.norm(now.residual):
                return there, view
        return failed

    def _finished(self, now: View, state: np.ndarray, slopes: Slopes) -> Released:
        record = with_initial_state(now.record, self._named(state)).assign_attrs({SIMULATIONS: self.count})
        named = {u.name: own for u, own in zip(self.unknowns, slopes, strict=True)}
        return Released(record, named, self.count)

    def _failed(self, view: View) -> Released:
        return Released(view.record.assign_attrs({SIMULATIONS: self.count}), {}, self.count)


# --- estimates from the record alone ----------------------------------------------------------------------------------


def unknowns(
    record: xr.Dataset,
    initial: Mapping[str, tuple[str, str]],
    parameters: Mapping[str, Parameter],
    centred: bool,
) -> list[Unknown]:
    """Components of an initial state, estimated from the first samples of the record.

    Parameters
    ----------
    record : measured
    initial : parameter -> (body, channel) that it sets
    parameters : of the model, by name
    centred : whether the zero of the displacements is unknown; the mean is then taken for it
    """
    return [_unknown(record, parameters[name], *target, centred) for name, target in initial.items()]


def _unknown(record: xr.Dataset, parameter: Parameter, body: str, channel: str, centred: bool) -> Unknown:
    start, scale = parameter.nominal, abs(parameter.nominal) or 1.0
    bodies = [str(name) for name in record.body.values]
    source = channel if channel in record else "displacement" if channel == "velocity" else None
    if body in bodies and source in record:
        time, values = record.time.values, record[source].values[bodies.index(body)]
        values = values[~isolated_outliers(values[None])[0]]
        quarter = quarter_period(values)
        value, rate = first_value(time, record[source].values[bodies.index(body)], quarter)
        mean = values.mean()
        swing = float(np.abs(values - mean).max())
        if source == channel:
            start, scale = value - (mean if centred and channel == "displacement" else 0.0), swing
        else:
            start, scale = rate, swing * np.pi / (2.0 * quarter * (time[-1] - time[0]) / (time.size - 1))
    return Unknown(parameter.name, float(start), float(scale) or 1.0, parameter.low, parameter.high)


def quarter_period(values: np.ndarray) -> int:
    """Samples after which values (n,) have lost their autocorrelation: a quarter of a period of an oscillation.

    The number of all where they keep it, or do not vary.
    """
    swing = values - values.mean()
    spectrum = np.fft.rfft(swing, 2 * swing.size)
    below = np.fft.irfft(np.abs(spectrum) ** 2)[: swing.size] <= 0.0
    return int(np.argmax(below)) or swing.size


def first_value(time: np.ndarray, values: np.ndarray, window: int) -> tuple[float, float]:
    """Value and rate at the first instant, of a polynomial through the first `window` samples.

    Fitted with Huber's weights, so that outliers, the first sample included, have little influence.
    """
    count = min(values.size, max(MIN_WINDOW, window))
    degree = 3 if count >= CUBIC_WINDOW else min(2, count - 1)
    length = time[count - 1] - time[0]
    powers = np.vander((time[:count] - time[0]) / length, degree + 1, increasing=True)
    weight = np.ones(count)
    for _ in range(MAX_HUBER_STEPS):
        root = np.sqrt(weight)
        coefficients = np.linalg.lstsq(root[:, None] * powers, root * values[:count], rcond=None)[0]
        residual = np.abs(values[:count] - powers @ coefficients)
        sigma = STD_PER_MAD * float(np.median(residual))
        if sigma <= 1e-12 * np.abs(values[:count]).max():
            break
        weight = np.minimum(1.0, HUBER_THRESHOLD * sigma / np.maximum(residual, 1e-300))
    return float(coefficients[0]), float(coefficients[1] / length)
