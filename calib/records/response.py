"""Frequency responses as records: complex amplitudes of bodies at the excitation frequencies of sweeps.

A response is a Dataset over body and point, its points in the order measured. With the excitation
A cos(2 pi F t + phase), the displacement of a body at a point is the real part of the sum of
H_k exp(i k (2 pi F t + phase)) over the orders k of its harmonics. The first one, H, is always there. Higher ones have
the same phase reference, k times the phase of the excitation, so that none depends on when the clock began:

    frequency (point,) F [Hz]; level (point,) A [N or m], by the quantity of the excitation
    sweep (point,) number of the sweep that a point belongs to; direction (point,) 1 (up) or -1 (down)
    in_phase, quadrature (body, point) real and imaginary part of H [m]
    response_sigma (body, point) standard uncertainty of either part [m], frequency_sigma (point,) [Hz]; optional
    in_phase_2, quadrature_2 (body, point) parts of H_2 [m], response_2_sigma (body, point) their standard uncertainty
        [m]; optional, and likewise of any of the orders 2 to 7
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
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
HIGHEST_ORDER = 7  # of a harmonic that is recorded: as many has the shortest series of a simulated motion
OF_HIGHER_ORDER = re.compile(r"(?:in_phase|quadrature)_(?P<part>.+)|response_(?P<sigma>.+)_sigma")
AMPLITUDE_SIGMA_SHARE = 0.02  # standard uncertainty that is taken where none is stated, over the rms amplitude  [1]
FREQUENCY_SIGMA_STEPS = 0.1  # the same of the frequency, over the mean step between the frequencies of a sweep  [1]
FREQUENCY_SIGMA_SHARE = 1e-3  # the same of a single point, over its frequency  [1]

NO_HARMONICS: Mapping[int, np.ndarray] = MappingProxyType({})  # above the first


def is_response(record: xr.Dataset) -> bool:
    """Whether a record is a frequency response, and none over time."""
    return bool(record.attrs.get("kind") == KIND)


def make_response(
    frequency: np.ndarray, bodies: Sequence[str], amplitude: np.ndarray, level: np.ndarray | float, level_unit: str,
    sweep: np.ndarray | int = 0, direction: np.ndarray | float = 1.0, *, sigma: np.ndarray | None = None,
    frequency_sigma: np.ndarray | None = None, higher: Mapping[int, np.ndarray] = NO_HARMONICS,
    higher_sigma: Mapping[int, np.ndarray] = NO_HARMONICS, **attrs: Any,
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
    higher, higher_sigma : by order from 2 on, as `amplitude` and `sigma`
    attrs : place, quantity, source, ...
    """
    size = len(frequency)
    variables: dict[str, Any] = {
        "frequency": ("point", np.asarray(frequency, dtype=float), {"units": "Hz"}),
        "level": ("point", np.broadcast_to(np.asarray(level, dtype=float), size).copy(), {"units": level_unit}),
        "sweep": ("point", np.broadcast_to(np.asarray(sweep, dtype=float), size).copy()),
        "direction": ("point", np.broadcast_to(np.asarray(direction, dtype=float), size).copy()),
    }
    for order, own in {1: amplitude, **higher}.items():
        values = np.asarray(own, dtype=complex)
        for part, of_part in zip(parts_of_order(order), (values.real, values.imag), strict=True):
            variables[part] = ("body", "point"), of_part.copy(), {"units": "m"}
    for order, uncertainty in {1: sigma, **higher_sigma}.items():
        if uncertainty is not None:
            variables[sigma_of_order(order)] = ("body", "point"), np.asarray(uncertainty, dtype=float), {"units": "m"}
    if frequency_sigma is not None:
        variables["frequency_sigma"] = "point", np.asarray(frequency_sigma, dtype=float), {"units": "Hz"}
    return xr.Dataset(variables, coords={"body": list(bodies)}, attrs={"kind": KIND, "status": "ok", **attrs})


def parts_of_order(order: int) -> tuple[str, str]:
    """Names of the real and of the imaginary part of a harmonic of a response."""
    return PARTS if order == 1 else (f"{PARTS[0]}_{order}", f"{PARTS[1]}_{order}")


def order_of_part(part: str) -> int:
    """Order of the harmonic that a part of a response belongs to, by its name."""
    number = part.rpartition("_")[2]
    return int(number) if number.isdigit() else 1


def sigma_of_order(order: int) -> str:
    """Name of the standard uncertainty of either part of a harmonic of a response."""
    return "response_sigma" if order == 1 else f"response_{order}_sigma"


def harmonic_orders(record: xr.Dataset) -> tuple[int, ...]:
    """Orders of the harmonics that a response has, rising from 1."""
    prefix = f"{PARTS[0]}_"
    named = (str(name) for name in record.variables)
    return (1, *sorted(int(name.removeprefix(prefix)) for name in named if name.startswith(prefix)))


def parts_of(record: xr.Dataset) -> tuple[str, ...]:
    """Names of the parts of all harmonics of a response: real and imaginary part of the first one, and so on."""
    return tuple(part for order in harmonic_orders(record) for part in parts_of_order(order))


def stated_sigma(record: xr.Dataset, part: str) -> str | None:
    """Name of the standard uncertainty that a response states of a part, None where it states none.

    What a sensor adds is the same at any order, so that the first harmonic's is taken of one that states none.
    """
    names = sigma_of_order(order_of_part(part)), sigma_of_order(1)
    return next((name for name in names if name in record.variables), None)


def complex_amplitude(record: xr.Dataset) -> np.ndarray:
    """Complex amplitude (body, point) of a response, its first harmonic  [m]."""
    return record.variables["in_phase"].values + 1j * record.variables["quadrature"].values


def complex_harmonics(record: xr.Dataset) -> np.ndarray:
    """Complex amplitudes (order, body, point) of all harmonics that a response has  [m]."""
    names = [parts_of_order(order) for order in harmonic_orders(record)]
    return np.array([record.variables[real].values + 1j * record.variables[imag].values for real, imag in names])


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
    """Return a response with other complex amplitudes (body, point) of its first harmonic  [m]."""
    parts = dict(zip(PARTS, (amplitude.real, amplitude.imag), strict=True))
    return record.assign({name: record[name].copy(data=part) for name, part in parts.items()})


def with_harmonics(record: xr.Dataset, harmonics: np.ndarray) -> xr.Dataset:
    """Return a response with other complex amplitudes (order, body, point) of all harmonics that it has  [m]."""
    return record.assign({name: record[name].copy(data=part) for name, part in split_parts(record, harmonics)})


def split_parts(record: xr.Dataset, harmonics: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the name of each part of a response, and its values (body, n) in complex amplitudes (order, body, n)."""
    for order, own in zip(harmonic_orders(record), harmonics, strict=True):
        yield from zip(parts_of_order(order), (own.real, own.imag), strict=True)


def modulus(record: xr.Dataset) -> xr.Dataset:
    """Return a response with its amplitudes alone: they stand in the real parts."""
    return with_harmonics(record, np.abs(complex_harmonics(record)) + 0.0j)


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
    parts, sigmas = _of_higher_orders(record, name)
    needed = {**DIMS, **dict.fromkeys(parts, ("body", "point"))}
    optional = {**OPTIONAL_DIMS, **dict.fromkeys(sigmas, ("body", "point"))}
    optional = {variable: dims for variable, dims in optional.items() if variable in record}
    for variable, dims in {**needed, **optional}.items():
        if record[variable].dims != dims:
            raise CalibError(f"{name}: expected {variable} with dims {dims}, got {record[variable].dims}; transpose it")
    record = _in_si(record, [*needed, *optional], name)
    if not record.sizes["point"]:
        raise CalibError(f"{name}: a {KIND} needs at least one point, got none")
    for variable in (*needed, *optional):
        _check_finite(record, variable, name)
    for variable in ("frequency", "level", *optional):
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


def _of_higher_orders(record: xr.Dataset, name: str) -> tuple[list[str], list[str]]:
    """Names of the parts of higher harmonics, and of their uncertainties, checked."""
    orders, sigmas = list[int](), list[str]()
    for variable in map(str, record.data_vars):
        match = OF_HIGHER_ORDER.fullmatch(variable)
        if match is None:
            continue
        number = match["part"] or match["sigma"]
        if not re.fullmatch(r"[-+]?\d+", number):
            raise CalibError(
                f"{name}: {variable} is not known: the parts of harmonic 2 are {', '.join(parts_of_order(2))}, their "
                f"standard uncertainty is {sigma_of_order(2)}, and that of the first harmonic {sigma_of_order(1)}; "
                "rename or drop it"
            )
        order = order_of(number, f"{name}: {variable}")
        for part in parts_of_order(order):
            if part not in record:
                raise CalibError(f"{name}: {variable} is of harmonic {order}, whose {part} is missing; add it")
        if match["sigma"]:
            sigmas.append(variable)
        elif order not in orders:
            orders.append(order)
    return [part for order in sorted(orders) for part in parts_of_order(order)], sigmas


def order_of(text: str, where: str) -> int:
    """Order of a higher harmonic.

    Raises
    ------
    CalibError : no whole number from 2 to `HIGHEST_ORDER`
    """
    if re.fullmatch(r"[1-9]\d*", text) and 2 <= int(text) <= HIGHEST_ORDER:
        return int(text)
    hint = "; the first harmonic stands without a number" if text == "1" else ""
    raise CalibError(f"{where}: the order of a higher harmonic is 2 to {HIGHEST_ORDER}, got {text!r}{hint}")


def _in_si(record: xr.Dataset, variables: Iterable[str], name: str) -> xr.Dataset:
    for variable in variables:
        values = record[variable]
        if values.dtype.kind not in "fiu":
            raise CalibError(
                f"{name}: {variable}: expected real numbers, got {values.dtype}; write it as 64-bit floats"
            )
        unit, factor = "m" if OF_HIGHER_ORDER.fullmatch(variable) else UNITS.get(variable, ""), 1.0
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

    Those of the parts are of the first harmonic, `harmonic_tolerances` has those of all. Where the record states none:
    a tenth of the mean step between the frequencies of the sweep, and 2 % of the rms amplitude of the body in the
    sweep.
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


def harmonic_tolerances(record: xr.Dataset) -> np.ndarray:
    """Standard uncertainties (order, body, point) of either part of each harmonic of a response  [m].

    Of one that states none that of the first harmonic: noise of a sensor is as large at any order.
    """
    first = tolerances(record)[1]
    names = [sigma_of_order(order) for order in harmonic_orders(record)]
    return np.array([record.variables[name].values if name in record.variables else first for name in names])
