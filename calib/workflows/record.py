"""Measured records from arrays, with what a study has to know of them."""

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.objective.terms import Use
from calib.records import CHANNELS, check, make, read
from calib.records import channels as channel_names
from calib.records.excitation import Excitation, unit_of
from calib.units import is_si, to_si

EXCITATION_KEYS = (
    "place",
    "quantity",
    "frequency",
    "amplitude",
    "phase",
    "cutoff",
    "values",
    "unit",
)  # keys of an excitation


@dataclass(frozen=True, eq=False)
class Record:
    """A measured record, and how a study uses it.

    Attributes
    ----------
    dataset : channels (body, time) in SI with the excitation in its attributes; see `calib.records.record`
    name : of the record in the study
    use : "calibrate" (fitted), "name" (helps to name a cause) or "holdout" (only predicted)
    bodies : body of the record -> body of the simulator; None: they have the same names
    nuisance : what else of the record is not known, such as "trigger" or "initial_state"
    """

    dataset: xr.Dataset
    name: str = "record"
    use: Use = "calibrate"
    bodies: Mapping[str, str] | None = None
    nuisance: Sequence[str] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise CalibError(f"name: expected a text, got {self.name!r}")
        names = [*self.dataset.body.values.tolist(), *_mapping(self.bodies, "bodies", "{'beam': 'q2'}").values()]
        wrong = [body for body in names if not isinstance(body, str)]
        if wrong:
            raise CalibError(f"bodies: expected names that are texts, got {wrong[0]!r}")
        object.__setattr__(self, "nuisance", listed(self.nuisance))

    @classmethod
    def from_arrays(
        cls,
        time: np.ndarray,
        displacement: Mapping[str, np.ndarray] | None = None,
        velocity: Mapping[str, np.ndarray] | None = None,
        *,
        excitation: Mapping[str, Any],
        channels: Mapping[str, Mapping[str, np.ndarray]] | None = None,
        units: Mapping[str, str] | None = None,
        sigma: Mapping[str, float | str] | None = None,
        name: str = "record",
        use: Use = "calibrate",
        bodies: Mapping[str, str] | None = None,
        nuisance: Sequence[str] = (),
    ) -> "Record":
        """Make a record from arrays.

        Parameters
        ----------
        time : (n,) ascending  [`units["time"]`, or s]
        displacement, velocity : body -> (n,)  [`units["displacement"]`, or m; `units["velocity"]`, or m/s]
        excitation : place ("end", "mass", ...), quantity ("displacement", "force", "base motion", "free decay", ...),
            and frequency, amplitude and phase of a harmonic one ("26.24 Hz", "1.5 mm", "90 deg"; numbers are in SI), or
            `values` (n,) of a recorded one in its `unit`
        channels : further channels, such as {"force": {"mass": array}}
        units : of time and channels, such as {"time": "ms", "displacement": "mm"}
        sigma : channel -> standard uncertainty of a sample, with its unit ("2 um") or in SI
        name, use, bodies, nuisance : see the class

        Raises
        ------
        CalibError : arrays of other shapes than `time`, a unit of another dimension, an incomplete excitation, samples
            that are no numbers
        """
        units = dict(_mapping(units, "units", "{'displacement': 'mm'}"))
        sigma = _mapping(sigma, "sigma", "{'displacement': '2 um'}")
        given = _channels(displacement, velocity, channels)
        seconds = _array(time, "time") * _factor(units.pop("time", "s"), "s", "time")
        if seconds.ndim != 1:
            raise CalibError(f"time: expected an array (n,), got one of shape {seconds.shape}")
        names = list(dict.fromkeys(body for rows in given.values() for body in rows))
        unknown = [channel for channel in units if channel not in given]
        if unknown:
            raise CalibError(f"units: there is no channel {unknown[0]!r}; the record has {', '.join(given)} and time")
        arrays, si = {}, {}
        for channel, rows in given.items():
            si[channel] = CHANNELS.get(channel) or _stated_si(units, channel)
            factor = _factor(units.get(channel, si[channel]), si[channel], channel)
            arrays[channel] = _stacked(rows, names, channel, seconds.size) * factor
        for channel, value in sigma.items():
            if channel not in given:
                raise CalibError(f"sigma: there is no channel {channel!r}; the record has {', '.join(given)}")
            arrays[f"{channel}_sigma"] = np.full(len(names), to_si(value, si[channel]))
        record = make(seconds, names, arrays, si, source="arrays", **_attributes(excitation))
        if "values" in excitation:
            unit = {"units": unit_of(excitation["quantity"])}
            record["excitation"] = "time", _recorded(excitation, seconds.size), unit
        record = check(record, str(name))
        Excitation.of(record)
        return cls(record, name, use, bodies, nuisance)

    @classmethod
    def from_file(
        cls,
        path: str | Path,
        name: str | None = None,
        use: Use = "calibrate",
        bodies: Mapping[str, str] | None = None,
        nuisance: Sequence[str] = (),
    ) -> "Record":
        """Read a record from a netCDF file, such as `calib digitise` or `calib simulate` writes.

        Raises
        ------
        CalibError : no such file, or not a record
        """
        return cls(read(path), name or Path(path).stem, use, bodies, nuisance)

    def entry(self, path: str) -> dict[str, Any]:
        """Entry [[record]] of a study file for this record, whose data lie in a file at `path`."""
        optional = {"bodies": None if self.bodies is None else dict(self.bodies), "nuisance": list(self.nuisance)}
        return {"name": self.name, "path": path, "use": self.use, **{k: v for k, v in optional.items() if v}}

    def __repr__(self) -> str:
        data = self.dataset
        attrs = data.attrs
        channels = ", ".join(f"{name} [{data[name].attrs.get('units', '?')}]" for name in channel_names(data))
        bodies = ", ".join(str(body) for body in data.body.values)
        drive = f"{attrs.get('quantity', 'no excitation stated')} at {attrs.get('place', '?')!r}"
        drive += f", {attrs['frequency']:.6g} Hz" if "frequency" in attrs else ""
        return (
            f"record {self.name!r} ({self.use}): {channels} of {bodies}\n"
            f"  {data.time.size} samples from {float(data.time[0]):.6g} s to {float(data.time[-1]):.6g} s; {drive}"
        )

    def _repr_html_(self) -> str:
        return f"<b>{html.escape(self.name)}</b> ({self.use}){self.dataset._repr_html_()}"


def listed(value: Any) -> tuple[Any, ...]:
    """One thing, or a sequence of them, as a tuple: a text is one thing."""
    return tuple(value) if isinstance(value, Sequence) and not isinstance(value, str) else (value,)


def _channels(displacement: Any, velocity: Any, channels: Any) -> dict[str, Mapping[str, Any]]:
    """Channel -> body -> array of all channels that are stated."""
    further = _mapping(channels, "channels", "{'force': {'mass': array}}")
    twice = [channel for channel in ("displacement", "velocity") if channel in further]
    if twice:
        raise CalibError(f"channels: {twice[0]} is an argument of its own")
    stated = {"displacement": displacement, "velocity": velocity, **further}
    given = {channel: _mapping(rows, channel, "{'mass': array}") for channel, rows in stated.items()}
    given = {channel: rows for channel, rows in given.items() if rows}
    if not given:
        raise CalibError("a record needs a channel: displacement or velocity, body -> array")
    return given


def _stacked(rows: Mapping[str, Any], bodies: Sequence[str], channel: str, size: int) -> np.ndarray:
    """Array (body, time) of a channel, in the unit that it has."""
    missing = [body for body in bodies if body not in rows]
    if missing:
        raise CalibError(
            f"{channel}: no array for body {missing[0]!r}, which another channel has; "
            f"every channel needs one for each of {', '.join(bodies)}"
        )
    return np.stack([_row(rows[body], channel, body, size) for body in bodies])


def _recorded(excitation: Mapping[str, Any], size: int) -> np.ndarray:
    """Samples (time,) of a recorded excitation, in SI."""
    unit = unit_of(excitation["quantity"])
    return _row(excitation["values"], "excitation", "values", size) * _factor(
        excitation.get("unit", unit), unit, "excitation"
    )


def _mapping(value: Any, what: str, example: str) -> Mapping[str, Any]:
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise CalibError(f"{what}: expected a mapping such as {example}, got {type(value).__name__}")
    return value


def _array(values: Any, what: str) -> np.ndarray:
    kind = np.asarray(values).dtype.kind
    if kind in "mMc":
        wanted = {"m": "a duration", "M": "a date", "c": "complex numbers"}[kind]
        raise CalibError(f"{what}: expected real numbers, got {wanted}; give seconds since the start, or real parts")
    try:
        return np.ma.filled(np.ma.asarray(values).astype(float), np.nan)  # what is masked is no number
    except (TypeError, ValueError) as error:
        raise CalibError(f"{what}: expected an array of numbers, got {values!r:.60}") from error


def _row(values: Any, channel: str, body: str, size: int) -> np.ndarray:
    row = _array(values, f"{channel} of {body!r}")
    if row.shape != (size,):
        raise CalibError(f"{channel} of {body!r}: expected an array ({size},) like time, got one of shape {row.shape}")
    return row


def _stated_si(units: Mapping[str, str], channel: str) -> str:
    """Unit of a channel that has no usual one."""
    if channel not in units or not is_si(units[channel]):
        stated = f"got {units[channel]!r}" if channel in units else "none is given"
        raise CalibError(f"units of {channel}: expected an SI unit such as 'N' or 'm/s^2', {stated}")
    return units[channel]


def _factor(unit: str, si: str, what: str) -> float:
    """Factor from a unit to the SI unit."""
    try:
        return to_si(f"1 {unit}", si)
    except CalibError as error:
        raise CalibError(f"units of {what}: {error}") from error


def _attributes(excitation: Mapping[str, Any]) -> dict[str, Any]:
    """Attributes of a record that say how a body was driven, in SI."""
    if not isinstance(excitation, Mapping):
        raise CalibError(
            "excitation: expected a mapping such as {'place': 'end', 'quantity': 'displacement', 'frequency': '26 Hz', "
            f"'amplitude': '1 mm'}}, got {excitation!r:.60}"
        )
    unknown = [key for key in excitation if key not in EXCITATION_KEYS]
    if unknown:
        raise CalibError(f"excitation: unknown key {unknown[0]!r}; known are {', '.join(EXCITATION_KEYS)}")
    for key in ("place", "quantity"):
        if key not in excitation:
            raise CalibError(f"excitation: {key!r} is missing; say where and by what the bodies are driven")
        if not isinstance(excitation[key], str):
            raise CalibError(f"excitation: {key}: expected a text, got {excitation[key]!r}")
    if "unit" in excitation and "values" not in excitation:
        raise CalibError("excitation: unit is that of `values`; write the amplitude with its unit, such as '1.5 mm'")
    unit = unit_of(excitation["quantity"])
    units = {"frequency": "Hz", "amplitude": unit, "phase": "rad", "cutoff": "Hz"}
    numbers = {}
    for key in units:
        if key in excitation:
            try:
                numbers[key] = to_si(excitation[key], units[key])
            except CalibError as error:
                raise CalibError(f"excitation: {key}: {error}") from error
    return {"place": excitation["place"], "quantity": excitation["quantity"], **numbers}
