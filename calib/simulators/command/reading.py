"""From the columns of an output to a record on the instants that were asked for."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy.interpolate import PchipInterpolator

from calib.errors import CalibError, nearest
from calib.execution.files import lies_within
from calib.records import MIN_SECTION_PERIODS, STATE, make
from calib.simulators.command.options import OutputReading, ReadChannel
from calib.simulators.command.readers import Columns, reader
from calib.units import shown

NO_OUTPUT, UNREADABLE, SHORT, NOT_FINITE = "no output", "unreadable output", "short output", "not finite"  # statuses
SAME_INSTANT = 1e-3  # of the step between two instants, by which an output may lie beside them: 7 digits of time
# of the step between two instants, of the request or of the output where that is finer, by which an output may begin
# too late or end too early: its time is rounded as it is printed
MAX_TIME_ROUNDING = 0.1


class OutputFault(Exception):
    """An output that gives no record: a status and its reason."""

    def __init__(self, status: str, reason: str):
        super().__init__(reason)
        self.status, self.reason = status, reason


@dataclass(frozen=True, eq=False)
class Instants:
    """What is recorded of a run.

    Attributes
    ----------
    times : (n,) of the program's own time  [s]
    begin : instant that is time 0 of the record  [s]
    period : of the excitation  [s]; None without one
    periods, settle : recorded, and before them; 0 without a period
    """

    times: np.ndarray
    begin: float = 0.0
    period: float | None = None
    periods: int = 0
    settle: int = 0

    @property
    def sections(self) -> np.ndarray:
        """Instants (k,) of the stroboscopic section: the recorded periods, and of those before the later half.

        At most 65, from the start of the first period to the end of the last.
        """
        if self.period is None:
            return np.empty(0)
        count = min(max(self.periods, MIN_SECTION_PERIODS), self.periods + self.settle // 2)
        return self.period * (self.settle + self.periods - count + np.arange(count + 1))


def read_columns(folder: Path, reading: OutputReading, modules: Path | None) -> Columns:
    """Read the output file of a run.

    Raises
    ------
    OutputFault : it is missing, or no such file as the reader expects
    """
    path = folder / reading.file
    if not lies_within(path, folder):
        raise OutputFault(UNREADABLE, f"{reading.file} lies outside the run folder")
    try:
        return reader(reading.reader, modules)(path, **reading.options)
    except CalibError as error:
        if not path.exists():
            raise OutputFault(NO_OUTPUT, f"it has written no file {reading.file}") from error
        raise OutputFault(UNREADABLE, str(error).replace(f"{folder}/", "")) from error


def record_of(columns: Columns, reading: OutputReading, instants: Instants, attrs: Mapping[str, Any]) -> xr.Dataset:
    """Record of a run.

    Where the output lies on other instants than those asked for, it is interpolated without overshoot (PCHIP), which
    the attribute `resampled` says.

    Raises
    ------
    OutputFault : a column is missing, the output ends too early, holds NaN, or its time does not increase
    """
    time = _time(columns, reading)
    rows = {
        (body, channel.name): _values(columns, channel, body, reading, time.size)
        for body, own in reading.channels.items()
        for channel in own
    }
    _check_covered(time, instants, reading.file)
    bodies = list(reading.channels)
    names = [channel.name for channel in reading.channels[bodies[0]]]
    units = {channel.name: channel.si for channel in reading.channels[bodies[0]]}
    on_instants = _Sampled(time, instants.times)
    channels = {name: np.array([on_instants(rows[body, name]) for body in bodies]) for name in names}
    extra: dict[str, Any] = {}
    sections = _covered(instants, time)
    if sections.size > 1:
        at_phase_zero = _Sampled(time, sections)
        extra["section"] = {
            name: np.array([at_phase_zero(rows[body, name]) for body in bodies]) for name in names if name in STATE
        }
    if on_instants.text:
        extra["resampled"] = on_instants.text
    return make(instants.times - instants.begin, bodies, channels, units, **extra, **attrs)


def _time(columns: Columns, reading: OutputReading) -> np.ndarray:
    """Time (n,) [s]."""
    time = np.asarray(columns.time, dtype=float) * reading.time_factor
    if time.ndim != 1 or time.size < 2:
        raise OutputFault(SHORT, f"{reading.file} holds {time.size} instant(s); at least two are needed")
    if not np.isfinite(time).all():
        raise OutputFault(
            NOT_FINITE, f"time in {reading.file} is not a number at row {int(np.argmin(np.isfinite(time)))}"
        )
    if (np.diff(time) <= 0.0).any():
        at = int(np.argmax(np.diff(time) <= 0.0))
        raise OutputFault(
            UNREADABLE, f"time in {reading.file} goes from {time[at]:.9g} to {time[at + 1]:.9g} s at row {at + 1}; "
            "it must increase; have the program write more digits of time, or fewer instants"
        )  # fmt: skip
    return time


def _values(columns: Columns, channel: ReadChannel, body: str, reading: OutputReading, size: int) -> np.ndarray:
    """Values (n,) of a channel in SI."""
    if channel.column not in columns.values:
        known = list(columns.values)
        shown = ", ".join(known[:20]) + (", ..." if len(known) > 20 else "")
        raise OutputFault(
            UNREADABLE, f"{reading.file} has no column {channel.column!r} ({channel.name} of {body})"
            f"{nearest(channel.column, known)}; it has {shown}"
        )  # fmt: skip
    values = np.asarray(columns.values[channel.column], dtype=float)
    if values.shape != (size,):
        raise OutputFault(UNREADABLE, f"column {channel.column!r} has shape {values.shape}, time has ({size},)")
    finite = np.isfinite(values)
    if not finite.all():
        raise OutputFault(
            NOT_FINITE, f"column {channel.column!r} of {reading.file} holds NaN or infinity from row "
            f"{int(np.argmin(finite))} on"
        )  # fmt: skip
    return values * channel.factor


def _check_covered(time: np.ndarray, instants: Instants, file: str) -> None:
    first, last = instants.times[0], instants.times[-1]
    reach = _reach(time, instants)
    late, early = time[0] - first, last - time[-1]
    if late <= reach and early <= reach:
        return
    gaps = [f"begins {shown(late, 's')} too late"] if late > reach else []
    gaps += [f"ends {shown(early, 's')} too early"] if early > reach else []
    raise OutputFault(
        SHORT, f"{file} covers {time[0]:.9g} to {time[-1]:.9g} s; {first:.9g} to {last:.9g} s are needed: it "
        f"{' and '.join(gaps)}, and rounding of its time accounts for {shown(reach, 's')}, "
        f"{MAX_TIME_ROUNDING:g} of the sample spacing; have the program write more, or more digits of time"
    )  # fmt: skip


def _reach(time: np.ndarray, instants: Instants) -> float:
    """Time [s] by which the output may begin too late or end too early: its first or last sample then stands in."""
    requested = (instants.times[-1] - instants.times[0]) / (instants.times.size - 1)
    return float(MAX_TIME_ROUNDING * min(requested, (time[-1] - time[0]) / (time.size - 1)))


def _covered(instants: Instants, time: np.ndarray) -> np.ndarray:
    """Return the instants (k,) of the stroboscopic section that the output covers."""
    sections, reach = instants.sections, _reach(time, instants)
    return sections[(sections >= time[0] - reach) & (sections <= time[-1] + reach)]


class _Sampled:
    """Takes values at instants (n,) from an output's time (m,): as they are, or interpolated."""

    def __init__(self, time: np.ndarray, instants: np.ndarray):
        self._time, self._instants = time, np.clip(instants, time[0], time[-1])
        after = np.clip(np.searchsorted(time, instants), 1, time.size - 1)
        nearest_at = after - (instants - time[after - 1] < time[after] - instants)
        step = (instants[-1] - instants[0]) / (instants.size - 1)
        exact = bool((np.abs(time[nearest_at] - instants) <= SAME_INSTANT * step).all())
        self._at = nearest_at if exact else None
        self.text = "" if exact else (
            f"interpolated (PCHIP) from {time.size} instants, {float(np.median(np.diff(time))):.4g} s apart (median), "
            f"to {instants.size}, {step:.4g} s apart"
        )  # fmt: skip

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Values (n,) at the instants."""
        if self._at is not None:
            return values[self._at]
        return PchipInterpolator(self._time, values)(self._instants)
