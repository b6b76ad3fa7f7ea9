"""The candidate effects of a diagnosis, and the sizes at which they are tried."""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calib.modelling.effect import SIZES, Effect, places_of
from calib.modelling.model import Model
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Simulator
from calib.objective import Reference
from calib.records import channels
from calib.records.held_response import as_measured
from calib.records.response import complex_amplitude
from calib.units import powers

ABOVE_NYQUIST = "its frequencies are above half the sampling rate of every record"
NO_FIRST_GUESS = "no record shows it, so that there is no first guess of its size"
FORM_BOUND_RATIO = 3.0  # of the bounds of an effect's form over the extreme values at which it is tried  [1]
SENSOR_GAIN, EXCITATION_FACTOR = "channel_gain", "amplitude"  # names of the effect, and of the simulator's parameter
GAIN_ADVICE = (
    f"; a gain of all sensors acts on a linear response as a factor on the excitation does: give {EXCITATION_FACTOR!r} "
    "a window"
)


@dataclass(frozen=True, eq=False)
class Candidate:
    """An effect with the parameters that are free and those that are held.

    Attributes
    ----------
    effect : with the bodies it acts on
    free : parameters with a null value, which are fitted
    held : values of the others, in SI
    scale : natural scale of each free parameter and of each of the form, in its unit
    sizes : (k, free) values at which a refit may start, in SI
    bounds : of the held parameters that give the effect its form, such as a width
    form : names of those that are fitted too; their values are among the held ones
    """

    effect: Effect
    free: tuple[str, ...]
    held: Mapping[str, float] = field(default_factory=dict)
    scale: Mapping[str, float] = field(default_factory=dict)
    sizes: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    form: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.effect.name

    @property
    def max_parameter_count(self) -> int:
        """Number of parameters that are fitted where its form is fitted too."""
        return len(self.free) + len(self.bounds)

    @property
    def null(self) -> np.ndarray:
        """Values (free,) at which the effect is absent."""
        return np.array([self.effect.null[name] for name in self.free])

    @property
    def low(self) -> np.ndarray:
        """Least admissible values (free,)."""
        return np.array([parameter.low for parameter in self.parameters])

    @property
    def high(self) -> np.ndarray:
        """Largest admissible values (free,)."""
        return np.array([parameter.high for parameter in self.parameters])

    @property
    def sign(self) -> int:
        """Sign that the departure of a single free parameter from null must have; 0 where both are admissible."""
        if len(self.free) != 1:
            return 0
        if self.low[0] == self.null[0]:
            return 1
        return -1 if self.high[0] == self.null[0] else 0

    @property
    def parameters(self) -> list[Parameter]:
        """The free parameters."""
        known = {parameter.name: parameter for parameter in self.effect.parameters}
        return [known[name] for name in self.free]

    def at(self, values: Mapping[str, float]) -> "Candidate":
        """Return the candidate with the form that a fit of these values by name has."""
        return replace(self, held={**self.held, **{name: values[name] for name in self.form}})

    def values(self, sizes: np.ndarray) -> dict[str, float]:
        """Values by name where the free parameters have these sizes (free,)."""
        return {**self.held, **dict(zip(self.free, map(float, sizes), strict=True))}

    def within_scale(self, sizes: np.ndarray) -> np.ndarray:
        """Bring sizes (free,) to the natural scale where they are beyond it.

        A large misfit makes linear estimates that large: at its scale the effect would be as large as the motion
        itself.
        """
        if not np.isfinite(self.null).all():  # absent at infinity
            return sizes
        scale = np.array([self.scale[name] for name in self.free])
        largest = float(np.max(np.abs(sizes - self.null) / scale, initial=0.0))
        return self.null + (sizes - self.null) / max(1.0, largest)

    def absent(self) -> dict[str, float]:
        """Values by name at which the effect is absent."""
        return self.values(self.null)


@dataclass(frozen=True)
class Scales:
    """Natural scales of a set of records: displacement amplitude [m], time over one radian [s], and force [N].

    The force is the largest level of the responses to a force; 0 without one.
    """

    length: float
    time: float
    force: float = 0.0

    @classmethod
    def of(cls, references: Iterable[Reference]) -> "Scales":
        """Estimate them from the measured records: the largest amplitude, and the rate at which displacement changes.

        Where the motion is prescribed and the force measured, the prescribed motion is the displacement.
        """
        length, time, force = [], [], []
        for reference in references:
            record, frequency = reference.record, reference.excitation.frequency
            if reference.is_swept:
                record = as_measured(record)
                length.append(np.abs(complex_amplitude(record)).max())
                force += [record["level"].values.max()] if reference.excitation.quantity == "force" else []
                time.append(1.0 / (2.0 * np.pi * float(np.median(record["frequency"].values))))
                continue
            motion = _motion(reference)
            if motion is not None:
                swing = motion - motion.mean(axis=1, keepdims=True)
                length.append(np.abs(swing).max())
                if frequency is None and np.ptp(swing) > 0.0:
                    rate = np.gradient(swing, record.time.values, axis=1)
                    time.append(float(np.sqrt((swing**2).sum() / (rate**2).sum())))
            if frequency is not None:
                time.append(1.0 / (2.0 * np.pi * frequency))
        return cls(
            max(length, default=1.0) or 1.0, float(np.median(time)) if time else 1.0, float(max(force, default=0.0))
        )

    def scale(self, unit: str, nominal: float) -> float:
        """Natural scale of a quantity in an SI unit; from its nominal where these records have no scale of the unit."""
        known = powers(unit)
        if known is None or (known[2] and not self.force):
            return abs(nominal) or 1.0
        length, time, mass = known
        return self.length ** (length - mass) * self.time ** (time + 2.0 * mass) * (self.force or 1.0) ** mass


def _motion(reference: Reference) -> np.ndarray | None:
    """Displacement (body, n) [m] that a record holds or that its excitation prescribes; None without one."""
    record, excitation = reference.record, reference.excitation
    if "displacement" in channels(record):
        return record["displacement"].values
    if excitation.quantity == "displacement" and excitation.time is not None and excitation.value is not None:
        return np.interp(record.time.values, excitation.time, excitation.value)[None]
    return None


def candidates(
    model: Model, effects: Sequence[Effect], references: Mapping[str, Reference], searched: Sequence[str]
) -> tuple[list[Candidate], dict[str, str]]:
    """Make the candidates of a diagnosis.

    Parameters
    ----------
    model : calibrated
    effects : that may be suspected
    references : by name, those that are calibrated on or used for naming
    searched : names of the parameters in windows

    Returns
    -------
    candidates : one for each combination of values at which the parameters without null are held
    refused : effect -> why it is no candidate
    """
    scales = Scales.of(references.values())
    accepted, refused = [], {}
    for effect in effects:
        reason = _refusal(model, effect, references, searched)
        if reason:
            refused[effect.name] = reason
            continue
        variants = _variants(_placed(effect, model.simulator), scales, references)
        if not variants:
            refused[effect.name] = NO_FIRST_GUESS if effect.guess is not None else ABOVE_NYQUIST
        accepted += variants
    return accepted, refused


def _placed(effect: Effect, simulator: Simulator) -> Effect:
    """Return the effect on the bodies that the simulator has at its place, where it names none."""
    places = places_of(simulator)
    if effect.site != "force" or effect.bodies is not None or effect.place not in places:
        return effect
    return replace(effect, bodies=tuple(places[effect.place]))


def _refusal(model: Model, effect: Effect, references: Mapping[str, Reference], searched: Sequence[str]) -> str:
    """Why an effect is no candidate; "" where it is one."""
    present = {known.name for known in model.effects}
    if effect.name in present:
        return "the model has it already"
    clash = [p.name for p in effect.parameters if p.name in model.parameters]
    if clash:
        return f"its parameter {clash[0]} is one of the model's"
    reason = effect.refusal(model.simulator)
    if reason:
        return reason
    if effect.requires:
        return f"it requires {effect.requires}; where there is one, name it among [diagnosis] candidates"
    own = {p.name for p in model.simulator.parameters}
    changed = next((names for names in effect.changes if all(name in own for name in names)), ())
    if effect.site == "structure" and changed and all(name in searched for name in changed):
        return f"{', '.join(changed)} is searched already"
    if effect.site == "numerical":
        return "its error is tested as a condition of the diagnosis, not as a cause"
    undriven = effect.undriven(reference.excitation for reference in references.values())
    if undriven:
        return undriven
    if effect.transient and all(_settled(one) for one in references.values() if not effect.undriven([one.excitation])):
        return "it changes with time, and every record that it changes is of a motion that has settled"
    if effect.site == "sensor" and all(reference.is_swept for reference in references.values()):
        advice = GAIN_ADVICE if effect.name == SENSOR_GAIN and EXCITATION_FACTOR in own - set(searched) else ""
        return f"it changes what is measured over time, and every record is a frequency response{advice}"
    if effect.site == "response" and not any(reference.is_swept for reference in references.values()):
        return "it changes what is measured of a frequency response, and no record is one"
    return ""


def _settled(reference: Reference) -> bool:
    """Whether the motion of a record is simulated without its begin."""
    return reference.excitation.harmonic and (reference.is_swept or reference.request.settle != 0)


def _variants(effect: Effect, scales: Scales, references: Mapping[str, Reference]) -> list[Candidate]:
    """Make a candidate of each combination of held values.

    Of an effect that is not differentiable, of each of its free parameters alone.
    """
    free = tuple(p.name for p in effect.parameters if p.null is not None)
    scale = {p.name: scales.scale(p.unit, p.nominal) for p in effect.parameters}
    grids = [
        [
            (p.name, value)
            for value in _held(p, effect, scale[p.name])
            if p.unit != "Hz" or value < _highest_frequency(references)
        ]
        for p in effect.parameters
        if p.null is None
    ]
    variants = []
    for held in itertools.product(*grids):
        bounds = _bounds(effect, scale, dict(held))
        for own in [free] if effect.differentiable else [(name,) for name in free]:
            absent = {name: effect.null[name] for name in free if name not in own}
            sizes = _sizes(effect, own, scale, references)
            if effect.guess is not None and not sizes.size:
                continue  # no record has the channel, or none shows the effect
            own_scale = {name: scale[name] for name in own} | {name: abs(x) for name, x in held if name in bounds}
            variants.append(Candidate(effect, own, {**dict(held), **absent}, own_scale, sizes, bounds))
    return variants


def _bounds(effect: Effect, scale: Mapping[str, float], held: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """Bounds of the parameters that give an effect its form: those of one sign it is tried at, and somewhat beyond.

    held : of this variant; where it is zero, and of a parameter of the numerics, it stays
    """
    bounds = {}
    for p in effect.parameters:
        if p.name in held and held[p.name] != 0.0 and effect.differentiable and p.kind == "physical":
            sign = np.sign(held[p.name])
            sizes = [sign * value for value in _held(p, effect, scale[p.name]) if sign * value > 0.0]
            ends = sorted((sign * min(sizes) / FORM_BOUND_RATIO, sign * max(sizes) * FORM_BOUND_RATIO))
            bounds[p.name] = max(p.low, float(ends[0])), min(p.high, float(ends[1]))
    return bounds


def _held(parameter: Parameter, effect: Effect, scale: float) -> list[float]:
    """Values at which a parameter without null is held in turn."""
    multiples = effect.natural.get(parameter.name)
    return [parameter.nominal] if multiples is None else [multiple * scale for multiple in multiples]


def _highest_frequency(references: Mapping[str, Reference]) -> float:
    """Half the sampling rate of the record that is sampled fastest [Hz]: higher frequencies are aliased.

    Frequency responses are not sampled in time, and bound none.
    """
    times = [reference.abscissa for reference in references.values() if not reference.is_swept]
    return max((0.5 * (time.size - 1) / (time[-1] - time[0]) for time in times), default=np.inf)


def _sizes(
    effect: Effect, free: Sequence[str], scale: Mapping[str, float], references: Mapping[str, Reference]
) -> np.ndarray:
    """Values (k, free) at which a refit may start: guessed from the records, else typical ones."""
    if effect.guess is not None:
        over_time = [reference.record for reference in references.values() if not reference.is_swept]
        guessed = [effect.guess(record).get(free[0], ()) for record in over_time]
        return np.unique(np.concatenate([np.zeros(0), *guessed]))[:, None]
    multiples = [effect.natural.get(name, SIZES) for name in free]
    rows = [
        [effect.null[name] + m[min(k, len(m) - 1)] * scale[name] for name, m in zip(free, multiples, strict=True)]
        for k in range(max(map(len, multiples)))
    ]
    return np.unique(np.array(rows), axis=0)
