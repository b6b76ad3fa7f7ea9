"""From a record to numbers with a unit that a simulation can be compared by."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from calib.cycles import harmonics, impact, loop_sigma, mean_cycle, period_of, poincare, rows
from calib.errors import CalibError
from calib.filter import low_pass
from calib.record import CHANNELS, STATE

RADIAN = 1.0 / (2.0 * np.pi)  # of a period: a phase shift by delta costs a loop about 2 pi delta of its size


def _channels(record: xr.Dataset, wanted: tuple[str, ...]) -> tuple[str, ...]:
    """Return the channels wanted, or, where none are named, displacement and velocity as the record has them."""
    if wanted:
        return wanted
    present = tuple(channel for channel in STATE if channel in record.variables)
    if not present:
        raise CalibError("the record has neither displacement nor velocity; name the channels to compare")
    return present


def _labelled(values: np.ndarray, record: xr.Dataset, bodies, channels, *dims: str) -> xr.DataArray:
    """Put the names of bodies and channels to values (body, channel, *dims)."""
    names = list(bodies or record.variables["body"].values.tolist())
    return xr.DataArray(values, dims=("body", "channel", *dims), coords={"body": names, "channel": list(channels)})


def _loops(record: xr.Dataset, bodies, channels, periods: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Mean closed loops (body, channel, phase) and their phase [1, in periods]."""
    mean = mean_cycle(record.variables["time"].values, rows(record, bodies, channels), period_of(record), periods)
    return mean.loop.reshape(-1, len(channels), mean.phase.size), mean.phase


def _size(reference: xr.DataArray) -> xr.DataArray:
    """Root mean square about the mean along the last dimension; of a constant, its magnitude."""
    last = reference.dims[-1]
    spread = reference.std(last)
    return spread.where(spread > 1e-9 * np.abs(reference).max(last), np.abs(reference).max(last))


def _of_velocity(trust: np.ndarray, channels: Sequence[str]) -> np.ndarray:
    """Trust (channel, n) of sampled channels: only a velocity jumps at an impact."""
    return np.array([trust.ravel() if channel == "velocity" else np.ones(trust.size) for channel in channels])


def _as_names(names: Sequence[str] | str) -> tuple[str, ...]:
    return (names,) if isinstance(names, str) else tuple(names)


@dataclass(frozen=True)
class PhaseCurve:
    """The closed loop of displacement and velocity over the period of the excitation.

    Loops are compared sample by sample at the same phase, each channel over the reference's root mean square about its
    mean: an identical loop scores 0, one 10 % larger 0.10. Comparing velocity at the same displacement instead would
    give a distance of 0.15 for identical loops, because a loop is no function of displacement.

    Attributes
    ----------
    channels : to compare; ("displacement",) for a reference without velocity
    periods : length of the loop; n to tell the halves of a period-n motion apart
    """

    channels: Sequence[str] = STATE
    periods: int = 1
    name = "phase_curve"
    unit = "m, m/s"

    def __post_init__(self):
        object.__setattr__(self, "channels", _as_names(self.channels))

    def __call__(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray:
        """Mean loops (body, channel, phase)."""
        return _labelled(self.values(record, bodies), record, bodies, self.channels, "phase")

    def values(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> np.ndarray:
        """Return the same as a bare array."""
        return _loops(record, bodies, self.channels, self.periods)[0]

    def trust(self, record: xr.Dataset) -> np.ndarray:
        """Trust (channel, phase) in the values of a simulated record."""
        time, trust = record.variables["time"].values, record.variables["trust"].values[None]
        mean = mean_cycle(time, trust, period_of(record), self.periods)
        return _of_velocity(np.clip(mean.loop, 0.0, 1.0), self.channels)

    def scale(self, reference: xr.DataArray) -> xr.DataArray:
        """Root mean square (body, channel) of the reference's loop about its mean."""
        return _size(reference)

    def uncertainty(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray | None:
        """Standard uncertainty (body, channel, phase) from the record's sigma, None where it has none."""
        sigma = [loop_sigma(record, channel, self.periods) for channel in self.channels]
        if any(s is None for s in sigma):
            return None
        return _picked(np.stack(sigma, axis=1), record, bodies, self.channels, "phase")


def _picked(values: np.ndarray, record: xr.Dataset, bodies, channels, *dims: str) -> xr.DataArray:
    """Values (body, channel, *dims) of the record's bodies, of which those named are kept."""
    everything = _labelled(values, record, None, channels, *dims)
    return everything if bodies is None else everything.sel(body=list(bodies))


@dataclass(frozen=True)
class TimeHistory:
    """The channels themselves, sample by sample: for excitations without a period too.

    The distance is the root mean square of the difference over that of the reference about its mean.

    Attributes
    ----------
    channels : to compare; none named: displacement and velocity as the reference has them
    """

    channels: Sequence[str] = ()
    name = "time_history"
    unit = "that of the channel"

    def __post_init__(self):
        object.__setattr__(self, "channels", _as_names(self.channels))

    def __call__(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray:
        """Channels (body, channel, time)."""
        channels = _channels(record, self.channels)
        return _labelled(self.values(record, bodies), record, bodies, channels, "time")

    def values(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> np.ndarray:
        """Return the same as a bare array."""
        channels = _channels(record, self.channels)
        values = rows(record, bodies, channels)
        return values.reshape(-1, len(channels), values.shape[-1])

    def trust(self, record: xr.Dataset) -> np.ndarray:
        """Trust (channel, time) in the values of a simulated record."""
        return _of_velocity(record.variables["trust"].values, _channels(record, self.channels))

    def scale(self, reference: xr.DataArray) -> xr.DataArray:
        """Root mean square (body, channel) of the reference about its mean."""
        return _size(reference)

    def uncertainty(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray | None:
        """Standard uncertainty (body, channel, time) from the record's sigma, None where it has none."""
        channels = _channels(record, self.channels)
        names = [f"{channel}_sigma" for channel in channels]
        if any(name not in record.variables for name in names):
            return None
        size = record.sizes["time"]
        sigma = [record.variables[name].values for name in names]
        full = [np.repeat(s[:, None], size, axis=1) if s.ndim == 1 else s for s in sigma]
        return _picked(np.stack(full, axis=1), record, bodies, channels, "time")


@dataclass(frozen=True)
class Amplitude:
    """Half the peak-to-peak value: of the mean loop, or of the whole record where the excitation has no period.

    Attributes
    ----------
    channels : to compare; none named: displacement and velocity as the reference has them
    """

    channels: Sequence[str] = ()
    name = "amplitude"
    unit = "that of the channel"

    def __post_init__(self):
        object.__setattr__(self, "channels", _as_names(self.channels))

    def __call__(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray:
        """Amplitudes (body, channel)."""
        return _labelled(self.values(record, bodies), record, bodies, _channels(record, self.channels))

    def values(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> np.ndarray:
        """Return the same as a bare array."""
        channels = _channels(record, self.channels)
        if "frequency" in record.attrs:
            values, _ = _loops(record, bodies, channels)
        else:
            values = rows(record, bodies, channels)
            values = values.reshape(-1, len(channels), values.shape[-1])
        return 0.5 * np.ptp(values, axis=-1)

    def scale(self, reference: xr.DataArray) -> xr.DataArray:
        """Return the reference's own amplitude (body, channel): 10 % larger scores 0.10."""
        return np.abs(reference)


@dataclass(frozen=True)
class Harmonics:
    """Complex amplitudes of the first harmonics of the excitation: x = mean + sum of Re[c_n exp(2 pi i n phase)].

    Attributes
    ----------
    number : of harmonics
    channels : to compare; none named: displacement and velocity as the reference has them
    """

    number: int = 5
    channels: Sequence[str] = ()
    name = "harmonics"
    unit = "that of the channel"

    def __post_init__(self):
        if self.number < 1:
            raise CalibError(f"harmonics are counted from 1 on, got number = {self.number}")
        object.__setattr__(self, "channels", _as_names(self.channels))

    def __call__(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray:
        """Real and imaginary part (body, channel, harmonic, part)."""
        channels = _channels(record, self.channels)
        return _labelled(self.values(record, bodies), record, bodies, channels, "harmonic", "part")

    def values(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> np.ndarray:
        """Return the same as a bare array."""
        channels = _channels(record, self.channels)
        loops, phase = _loops(record, bodies, channels)
        if self.number > (phase.size - 1) // 2:
            raise CalibError(f"{phase.size} samples a period resolve fewer than {self.number} harmonics; ask for fewer")
        turn = np.exp(-2j * np.pi * np.arange(1, self.number + 1) * phase[0])
        amplitude = harmonics(loops, self.number) * turn
        return np.stack([amplitude.real, amplitude.imag], axis=-1)

    def scale(self, reference: xr.DataArray) -> xr.DataArray:
        """Magnitude (body, channel) of the reference's fundamental, over the root of the number of numbers.

        So the distance is the root of the summed squares of the differences, relative to the fundamental.
        """
        fundamental = np.sqrt((reference.isel(harmonic=0) ** 2).sum("part"))
        return fundamental / np.sqrt(2.0 * self.number)


@dataclass(frozen=True)
class ImpactPhase:
    """Phase at which the velocity of a body changes fastest (see `calib.cycles.impact`).

    A difference of one radian, 1/(2 pi) of a period, scores 1; differences are taken around the circle.
    """

    name = "impact_phase"
    unit = "1"
    channels = ("velocity",)
    wraps = 1.0

    def __call__(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray:
        """Phase (body, channel) in [0, 1), in periods; NaN where there is no impact."""
        return _labelled(_impacts(record, bodies)[..., 0], record, bodies, self.channels)

    def scale(self, reference: xr.DataArray) -> float:
        """One radian, in periods."""
        return RADIAN


@dataclass(frozen=True)
class ContactTime:
    """Share of the period for which the acceleration of a body's strongest impact exceeds 0.2 of its peak."""

    name = "contact_time"
    unit = "1"
    channels = ("velocity",)

    def __call__(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray:
        """Contact time (body, channel), in periods; NaN where there is no impact."""
        return _labelled(_impacts(record, bodies)[..., 2], record, bodies, self.channels)

    def scale(self, reference: xr.DataArray) -> xr.DataArray:
        """Return the reference's own contact time: 10 % longer scores 0.10."""
        return reference


def _impacts(record, bodies):
    loops, phase = _loops(record, bodies, ("velocity",))
    return np.array([[impact(phase, loop) for loop in body] for body in loops])


@dataclass(frozen=True)
class PoincareSpread:
    """Spread of the stroboscopic section, as a share of the amplitude of the motion.

    Root mean square of the section about its mean over half the peak-to-peak value of the record: 0 for a period-1
    motion without noise. A difference of 1 scores 1.

    Attributes
    ----------
    channels : to compare; none named: displacement and velocity as the reference has them
    """

    channels: Sequence[str] = ()
    name = "poincare_spread"
    unit = "1"
    aligned = False  # the section is longer than the record, and its spread does not depend on the trigger

    def __post_init__(self):
        object.__setattr__(self, "channels", _as_names(self.channels))

    def __call__(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray:
        """Spread (body, channel)."""
        channels = _channels(record, self.channels)
        section = poincare(record)
        amplitude = 0.5 * np.ptp(rows(record, None, channels), axis=-1).reshape(-1, len(channels))
        spread = np.stack([section[channel].values.std(axis=1) for channel in channels], axis=1)
        return _picked(spread / np.where(amplitude > 0.0, amplitude, 1.0), record, bodies, channels)

    def scale(self, reference: xr.DataArray) -> float:
        """One: the spread is relative already."""
        return 1.0


@dataclass(frozen=True)
class ForceBalance:
    """Force that a measured motion needs, against the force that was measured (motion in, force out).

    The distance is the root mean square of the difference over that of the measured force.

    Attributes
    ----------
    cutoff : of the zero-phase low-pass (`calib.filter`) on both forces [Hz]; None filters nothing
    decimate : every so many-th sample is compared, after the filter
    """

    cutoff: float | None = None
    decimate: int = 1
    name = "force_balance"
    unit = CHANNELS["force"]
    channels = ("force",)

    def __post_init__(self):
        if self.decimate < 1:
            raise CalibError(f"decimate is a number of samples from 1 on, got {self.decimate}")

    def __call__(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray:
        """Forces (body, channel, time)."""
        force = rows(record, bodies, self.channels)
        if self.cutoff is not None:
            force = low_pass(force, record.variables["time"].values, self.cutoff)
        return _labelled(force[:, None, :: self.decimate], record, bodies, self.channels, "time")

    def scale(self, reference: xr.DataArray) -> xr.DataArray:
        """Root mean square (body, channel) of the measured force."""
        return np.sqrt((reference**2).mean("time"))
