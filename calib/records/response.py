"""Frequency responses as records: complex amplitudes of bodies at the excitation frequencies of sweeps.

A response is a Dataset over body and point, its points in the order measured. With the excitation
A cos(2 pi F t + phase), the displacement of a body at a point is the real part of H exp(i (2 pi F t + phase)):

    frequency (point,) F [Hz]; level (point,) A [N or m], by the quantity of the excitation
    sweep (point,) number of the sweep that a point belongs to; direction (point,) 1 (up) or -1 (down)
    in_phase, quadrature (body, point) real and imaginary part of H [m]
    response_sigma (body, point) standard uncertainty of either part [m], frequency_sigma (point,) [Hz]; optional
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.units import to_si

KIND = "frequency response"  # attribute `kind` of such a record
UNKNOWN_PHASE = "unknown"  # attribute `phases` of one of amplitudes alone: they stand in its in_phase part
SIGMA_SOURCE = "sigma_source"  # attribute: how the uncertainties were estimated, of a response that does not state them
PARTS = ("in_phase", "quadrature")
HELD = "held"  # attribute: body whose amplitude a controller held, see `calib.records.held_response`
HELD_AMPLITUDE = "held_amplitude"  # at which it was held, in a record of one level a sweep
LEVEL_UNITS = ("N", "m")  # of the quantities by which bodies are excited
DIMS: Mapping[str, tuple[str, ...]] = {
    "frequency": ("point",), "level": ("point",), "sweep": ("point",), "direction": ("point",),
    "in_phase": ("body", "point"), "quadrature": ("body", "point"),
}  # fmt: skip
OPTIONAL_DIMS: Mapping[str, tuple[str, ...]] = {
    "response_sigma": ("body", "point"), "frequency_sigma": ("point",), HELD_AMPLITUDE: ("point",),
}  # fmt: skip
STATES_PER_MOTION = 32  # of a period  [count]
GOLDEN_SECTION = 0.5 * (5.0**0.5 - 1.0)  # whose multiples spread evenly over the unit interval  [1]
UNITS = {
    "frequency": "Hz", "in_phase": "m", "quadrature": "m", "response_sigma": "m", "frequency_sigma": "Hz",
    HELD_AMPLITUDE: "m",
}  # fmt: skip
AMPLITUDE_SIGMA_SHARE = 0.02  # standard uncertainty that is taken where none is stated, over the rms amplitude  [1]
FREQUENCY_SIGMA_STEPS = 0.1  # the same of the frequency, over the mean step between the frequencies of a sweep  [1]
FREQUENCY_SIGMA_SHARE = 1e-3  # the same of a single point, over its frequency  [1]


def is_response(record: xr.Dataset) -> bool:
    """Whether a record is a frequency response, and none over time."""
    return bool(record.attrs.get("kind") == KIND)


def make_response(
    frequency: np.ndarray, bodies: Sequence[str], amplitude: np.ndarray, level: np.ndarray | float, level_unit: str,
    sweep: np.ndarray | int = 0, direction: np.ndarray | float = 1.0, *, sigma: np.ndarray | None = None,
    frequency_sigma: np.ndarray | None = None, **attrs: Any,
) -> xr.Dataset:  # fmt: skip
    """Build a response from arrays in SI.

    Parameters
    ----------
    frequency : (point,) in the order measured  [Hz]
    amplitude : (body, point) complex  [m]
    level : (point,) or one amplitude of the excitation  [level_unit]
    sweep, direction : (point,) or one of all
    sigma : (body, point) of either part  [m]
    frequency_sigma : (point,)  [Hz]
    attrs : place, quantity, source, ...
    """
    size, amplitude = len(frequency), np.asarray(amplitude, dtype=complex)
    variables: dict[str, Any] = {
        "frequency": ("point", np.asarray(frequency, dtype=float), {"units": "Hz"}),
        "level": ("point", np.broadcast_to(np.asarray(level, dtype=float), size).copy(), {"units": level_unit}),
        "sweep": ("point", np.broadcast_to(np.asarray(sweep, dtype=float), size).copy()),
        "direction": ("point", np.broadcast_to(np.asarray(direction, dtype=float), size).copy()),
        "in_phase": (("body", "point"), amplitude.real.copy(), {"units": "m"}),
        "quadrature": (("body", "point"), amplitude.imag.copy(), {"units": "m"}),
    }
    if sigma is not None:
        variables["response_sigma"] = ("body", "point"), np.asarray(sigma, dtype=float), {"units": "m"}
    if frequency_sigma is not None:
        variables["frequency_sigma"] = "point", np.asarray(frequency_sigma, dtype=float), {"units": "Hz"}
    return xr.Dataset(variables, coords={"body": list(bodies)}, attrs={"kind": KIND, "status": "ok", **attrs})


def complex_amplitude(record: xr.Dataset) -> np.ndarray:
    """Complex amplitude (body, point) of a response  [m]."""
    return record.variables["in_phase"].values + 1j * record.variables["quadrature"].values


def states_of_motions(frequency: np.ndarray, harmonics: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Displacement and velocity (body, n) at instants of periodic motions  [m], [m/s].

    The second half of the instants are those half a period after the first: of a motion that is symmetric half-wave,
    of odd harmonics alone, the states there are the opposite ones.

    Parameters
    ----------
    frequency : (m,)  [Hz]
    harmonics : (body, harmonic, m) complex amplitudes, the first of which is the mean  [m]
    """
    count = STATES_PER_MOTION // 2
    start = GOLDEN_SECTION * np.arange(frequency.size)  # of a stride over the instants no phase is left out
    turn = (start[:, None] + np.arange(count) / STATES_PER_MOTION) % 1.0
    phase = 2.0 * np.pi * np.stack([turn, turn + 0.5])  # (half, m, count)
    orders = np.arange(harmonics.shape[1])
    wave = np.exp(1j * orders[:, None, None, None] * phase)
    omega = 2.0 * np.pi * frequency
    displacement = np.einsum("bkm,khmn->bhmn", harmonics, wave).real
    velocity = np.einsum("bkm,khmn->bhmn", 1j * orders[:, None] * omega * harmonics, wave).real
    shape = len(harmonics), -1
    return displacement.reshape(shape), velocity.reshape(shape)


def with_amplitude(record: xr.Dataset, amplitude: np.ndarray) -> xr.Dataset:
    """Return a response with other complex amplitudes (body, point)  [m]."""
    parts = dict(zip(PARTS, (amplitude.real, amplitude.imag), strict=True))
    return record.assign({name: record[name].copy(data=part) for name, part in parts.items()})


def check_response(record: xr.Dataset, name: str) -> xr.Dataset:
    """Return a response in SI, where it is one.

    Raises
    ------
    CalibError : it is none; the message names the variable, what was expected and the remedy
    """
    if "body" not in record.coords:
        raise CalibError(
            f"{name}: the coordinate 'body' (names of the bodies) is missing; it has {list(record.coords)}"
        )
    for variable, dims in DIMS.items():
        if variable not in record:
            raise CalibError(f"{name}: a {KIND} needs {variable} with dims {dims}; it has {list(record.data_vars)}")
    for variable, dims in {**DIMS, **OPTIONAL_DIMS}.items():
        if variable in record and record[variable].dims != dims:
            raise CalibError(f"{name}: expected {variable} with dims {dims}, got {record[variable].dims}; transpose it")
    record = _in_si(record, name)
    if not record.sizes["point"]:
        raise CalibError(f"{name}: a {KIND} needs at least one point, got none")
    for variable in (*DIMS, *(one for one in OPTIONAL_DIMS if one in record)):
        _check_finite(record, variable, name)
    for variable in ("frequency", "level", *(one for one in OPTIONAL_DIMS if one in record)):
        if not (record[variable].values > 0.0).all():
            raise CalibError(f"{name}: {variable} is expected above 0 at every point; mend or leave out those points")
    if HELD_AMPLITUDE in record and record.attrs.get(HELD) not in record.body.values.tolist():
        raise CalibError(f"{name}: {HELD_AMPLITUDE} is of a body that the attribute {HELD!r} names among its bodies")
    if not np.isin(record.direction.values, (-1.0, 1.0)).all():
        raise CalibError(f"{name}: direction is 1 (up) or -1 (down) at every point")
    for number, points in sweeps(record):
        if np.unique(record.direction.values[points]).size > 1:
            raise CalibError(f"{name}: sweep {number:g} has two directions; give each way a sweep of its own")
    return record


def _in_si(record: xr.Dataset, name: str) -> xr.Dataset:
    for variable in (*DIMS, *OPTIONAL_DIMS):
        if variable not in record:
            continue
        values = record[variable]
        if values.dtype.kind not in "fiu":
            raise CalibError(
                f"{name}: {variable}: expected real numbers, got {values.dtype}; write it as 64-bit floats"
            )
        unit, factor = UNITS.get(variable, ""), 1.0
        stated = values.attrs.get("units")
        if variable == "level":
            unit, factor = level_factor(str(stated), f"{name}: level")
        elif unit and stated is None:
            raise CalibError(f"{name}: {variable} states no unit; set its attribute units to {unit!r}")
        elif unit:
            factor = _factor(str(stated), unit, f"{name}: {variable}")
        attrs = {**values.attrs, "units": unit} if unit else values.attrs
        record = record.assign({variable: (values.dims, factor * values.values.astype(float), attrs)})
    return record


def level_factor(unit: str, where: str) -> tuple[str, float]:
    """SI unit of a level that is stated in a unit, and the factor to it.

    Raises
    ------
    CalibError : neither a force nor a displacement
    """
    for si in LEVEL_UNITS:
        try:
            return si, to_si(f"1 {unit}", si)
        except CalibError:
            continue
    raise CalibError(f"{where}: expected a unit of force or displacement, such as 'N' or 'mm', got {unit!r}")


def _factor(unit: str, si: str, where: str) -> float:
    try:
        return to_si(f"1 {unit}", si)
    except CalibError as error:
        raise CalibError(f"{where}: {error}") from error


def _check_finite(record: xr.Dataset, variable: str, name: str) -> None:
    finite = np.isfinite(record[variable].values)
    if not finite.all():
        point = int(np.argwhere(~finite)[0][-1])
        raise CalibError(f"{name}: {variable} is not a number at point {point}; cut or repair that point")


def has_phase(record: xr.Dataset) -> bool:
    """Whether the phases of a response are known, or its amplitudes alone."""
    return record.attrs.get("phases") != UNKNOWN_PHASE


def sweeps(record: xr.Dataset) -> list[tuple[float, np.ndarray]]:
    """Number of each sweep and the indices of its points, in the order measured."""
    number = record["sweep"].values
    return [(one, np.flatnonzero(number == one)) for one in dict.fromkeys(number.tolist())]


def median_of_sweeps(record: xr.Dataset, values: np.ndarray, sweep: np.ndarray) -> np.ndarray:
    """Median (n,) of values (point,) of a response over the sweep that each of the numbers `sweep` (n,) names."""
    median = {number: float(np.median(values[points])) for number, points in sweeps(record)}
    return np.array([median[number] for number in sweep.tolist()])


def tolerances(record: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Standard uncertainties of a response: of its frequencies (point,) [Hz], of either part (body, point)  [m].

    Where the record states none: a tenth of the mean step between the frequencies of the sweep, and 2 % of the rms
    amplitude of the body in the sweep.
    """
    frequency, amplitude = record["frequency"].values, np.abs(complex_amplitude(record))
    of_frequency, of_parts = np.empty(frequency.size), np.empty(amplitude.shape)
    for _, points in sweeps(record):
        span = float(np.ptp(frequency[points]))
        if span > 0.0:
            of_frequency[points] = FREQUENCY_SIGMA_STEPS * span / (points.size - 1)
        else:
            of_frequency[points] = FREQUENCY_SIGMA_SHARE * frequency[points]
        rms = np.sqrt(np.mean(amplitude[:, points] ** 2, axis=1, keepdims=True))
        of_parts[:, points] = AMPLITUDE_SIGMA_SHARE * np.where(rms > 0.0, rms, 1.0)
    if "frequency_sigma" in record:
        of_frequency = record["frequency_sigma"].values
    if "response_sigma" in record:
        of_parts = record["response_sigma"].values
    return of_frequency, of_parts
