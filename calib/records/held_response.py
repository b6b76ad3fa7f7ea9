"""Frequency responses at a held amplitude, or constant-response tests: the level followed as it was needed.

A controller holds the amplitude of a body while the frequency is stepped, and what is measured is the level that takes.
Where a resonance would fold at a set level, all of its motions are met this way, also those that are unstable there.

The record states H, the complex amplitude, at one level of each sweep, in proportion to what was held: that which was
measured, times the level of the sweep over the level of the point. So it is the response of the linear system that
moves as the body does at the amplitude that was held, and may be drawn, compared and weighed as any other. Nothing is
lost: the level of a point was that of the sweep, times `held_amplitude` over |H| of the body (`as_measured`). Higher
harmonics are scaled as the first one is, so that their ratio to it stays what was measured.
"""

import numpy as np
import xarray as xr

from calib.errors import CalibError, nearest
from calib.records.response import (
    HELD,
    HELD_AMPLITUDE,
    complex_amplitude,
    complex_harmonics,
    harmonic_orders,
    median_of_sweeps,
    sigma_of_order,
    sweeps,
    with_harmonics,
)

MAX_UNSTEADINESS = 0.1  # of an amplitude that is held: rms deviation over the mean  [1]


def is_held(record: xr.Dataset) -> bool:
    """Whether the amplitude of a body was held, and the record is `at_one_level`."""
    return HELD in record.attrs and HELD_AMPLITUDE in record


def at_one_level(record: xr.Dataset, body: str) -> xr.Dataset:
    """Put a response whose controller held the amplitude of `body` at one level a sweep.

    Levels of sweeps are in proportion to the displacement, velocity or acceleration that was held, by the median ratio
    of the level to it, so that sweeps at one amplitude are at one level. Standard uncertainties of amplitudes are
    multiplied likewise: in proportion to the amplitude that was held they are those of the level in proportion to it.

    Parameters
    ----------
    record : as measured, checked by `calib.records.response.check_response`; one that is at one level stays as it is

    Raises
    ------
    CalibError : an unknown body, or one that does not move at a point
    """
    if is_held(record):
        return record
    bodies = [str(own) for own in record.body.values]
    if body not in bodies:
        raise CalibError(
            f"held names the body whose amplitude was held: no body {body!r}{nearest(body, bodies)}; the response is "
            f"of {', '.join(bodies)}"
        )
    held = np.abs(complex_amplitude(record)[bodies.index(body)])
    if not (held > 0.0).all():
        at = float(record["frequency"].values[np.argmin(held > 0.0)])
        raise CalibError(f"held: {body} does not move at {at:g} Hz, so that its amplitude cannot have been held there")
    levels, omega = record["level"].values, 2.0 * np.pi * record["frequency"].values
    kinds = held * omega ** np.arange(3)[:, None]  # displacement, velocity, acceleration
    kept = kinds[int(np.argmin(np.sum([_variation(kinds[:, points]) for _, points in sweeps(record)], axis=0)))]
    level = np.median(levels / kept) * median_of_sweeps(record, kept, record["sweep"].values)
    factor = level / levels
    unit = {"units": record["level"].attrs["units"]}
    scaled = with_harmonics(record, complex_harmonics(record) * factor).assign(
        {"level": ("point", level, unit), HELD_AMPLITUDE: ("point", held, {"units": "m"})}
    )
    sigmas = {name: record[name] for name in _sigmas(record) if name in record}
    scaled = scaled.assign({name: sigma.copy(data=sigma.values * factor) for name, sigma in sigmas.items()})
    return scaled.assign_attrs({HELD: body})


def as_measured(record: xr.Dataset) -> xr.Dataset:
    """Return a response with the amplitudes and levels of its points as measured; any other than a held one as it is.

    Of this `at_one_level` makes the record again, as far as its uncertainties are not asked for.
    """
    if not is_held(record):
        return record
    scaled = complex_harmonics(record)
    bodies = record.body.values.tolist()
    factor = record[HELD_AMPLITUDE].values / np.abs(scaled[0, bodies.index(record.attrs[HELD])])
    level = record["level"].copy(data=record["level"].values * factor)
    return (
        with_harmonics(record, scaled * factor)
        .assign(level=level)
        .drop_vars([HELD_AMPLITUDE, *_sigmas(record)], errors="ignore")
    )


def _sigmas(record: xr.Dataset) -> list[str]:
    """Names of the uncertainties that the harmonics of a response may state."""
    return [sigma_of_order(order) for order in harmonic_orders(record)]


def unsteady(record: xr.Dataset) -> list[tuple[float, float]]:
    """Sweeps of a held response in which it was not held, by number, and by how much: rms deviation over the mean.

    Of displacement, velocity and acceleration that which varies least.
    """
    omega, found = 2.0 * np.pi * record["frequency"].values, []
    for sweep, points in sweeps(record):
        varies = float(_variation(record[HELD_AMPLITUDE].values[points] * omega[points] ** np.arange(3)[:, None]).min())
        if varies > MAX_UNSTEADINESS:
            found.append((sweep, varies))
    return found


def _variation(values: np.ndarray) -> np.ndarray:
    """Standard deviation over the mean (k,) of rows (k, n)  [1]."""
    return np.asarray(np.std(values, axis=1) / np.mean(values, axis=1))
