"""The sample of a posterior distribution in SI: its summary, and its files."""

import csv
from collections.abc import Hashable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from calib.confidence.document import AT_LIMIT, MarginalResult, ModeResult, PosteriorResult
from calib.confidence.likelihood import LEVEL
from calib.confidence.modes import separate_modes
from calib.confidence.posterior import Posterior
from calib.confidence.prior import Prior
from calib.errors import CalibError
from calib.execution.apart import read_apart
from calib.execution.files import whole
from calib.execution.interrupt import uninterrupted
from calib.execution.netcdf import UNREADABLE
from calib.modelling.parameter import Space
from calib.records import OK
from calib.units import shown

ENSEMBLE_SIZE = 20  # parameter sets of an ensemble  [count]
SINGLE_PRECISION = {"dtype": "float32", "zlib": True, "complevel": 1}  # of many drawn samples in a file


def values_of(space: Space, posterior: Posterior) -> dict[str, np.ndarray]:
    """Values (n,) of each searched parameter in the sample, in SI."""
    return {
        name: np.array([window.value(float(x)) for x in column])
        for (name, window), column in zip(space.windows.items(), posterior.points.T, strict=True)
    }


def posterior_result(
    space: Space, units: Mapping[str, str], priors: Mapping[str, Prior], posterior: Posterior
) -> PosteriorResult:
    """Return what confidence.json holds of a posterior distribution."""
    tails = 0.5 * (1.0 - LEVEL), 0.5 * (1.0 + LEVEL)
    marginals = []
    for name, values in values_of(space, posterior).items():
        low, high = np.quantile(values, tails)
        window = space.windows[name]
        marginals.append(
            MarginalResult(
                name,
                units[name],
                window.scale,
                float(values.mean()),
                float(values.std(ddof=1)),
                float(low),
                float(high),
                prior_in_words(priors.get(name), window.scale, units[name]),
            )  # fmt: skip
        )
    return PosteriorResult(
        tuple(marginals), posterior.log_evidence, posterior.log_evidence_error, posterior.effective_size,
        posterior.evaluations, modes=modes(values_of(space, posterior), posterior.points),
        status=OK if posterior.complete else AT_LIMIT,
    )  # fmt: skip


def modes(values: Mapping[str, np.ndarray], points: np.ndarray) -> tuple[ModeResult, ...]:
    """Return the separate modes of a sample, the heaviest first; none where there is only one.

    Parameters
    ----------
    values : (n,) of each parameter, in SI
    points : (n, dim) the same in the unit cube
    """
    found = separate_modes(points)
    if len(found) < 2:
        return ()
    return tuple(
        ModeResult(
            own.size / len(points),
            {name: float(value[own].mean()) for name, value in values.items()},
            {name: float(value[own].std()) for name, value in values.items()},
        )
        for own in found
    )


def prior_in_words(prior: Prior | None, scale: str, unit: str) -> str:
    """Say what is known of a parameter before the measurement.

    scale, unit : of its window, and its SI unit
    """
    if prior is None:
        return "flat in the window" + (" on its logarithmic scale" if scale == "log" else "")
    centre = shown(prior.centre, unit)
    if prior.kind == "normal":
        return f"normal, mean {centre}, standard deviation {shown(prior.spread, unit)}"
    return f"lognormal, median {centre}, standard deviation of the logarithm {prior.spread:.3g}"


def write_posterior(
    path: Path, space: Space, units: Mapping[str, str], posterior: Posterior, groups: Mapping[str, xr.Dataset]
) -> None:
    """Write a sample as netCDF with the groups `posterior` and `sample_stats`, as ArviZ reads it.

    Each parameter has the dimensions (chain, draw) and a unit; log_likelihood is over that of the best point.

    groups : further ones, of which real numbers are stored in single precision
    """
    dims = ("chain", "draw")
    coordinates = {"chain": [0], "draw": np.arange(len(posterior.points))}
    values = {name: (dims, own[None], {"units": units[name]}) for name, own in values_of(space, posterior).items()}
    evidence = {
        "log_evidence": posterior.log_evidence,
        "log_evidence_error": posterior.log_evidence_error,
        "effective_size": posterior.effective_size,
        "inference_library": "nautilus",
    }
    statistics = {"log_likelihood": (dims, posterior.log_likelihood[None])}
    with whole(path) as temporary:
        xr.Dataset(values, coordinates, evidence).to_netcdf(temporary, group="posterior", engine="netcdf4")
        xr.Dataset(statistics, coordinates).to_netcdf(temporary, mode="a", group="sample_stats", engine="netcdf4")
        for name, content in groups.items():
            encoding: dict[Hashable, dict[str, Any]] = {one: SINGLE_PRECISION for one in content.data_vars}
            content.to_netcdf(temporary, mode="a", group=name, engine="netcdf4", encoding=encoding)


def check_posterior(path: Path) -> None:
    """Check that a file holds a sample.

    Raises
    ------
    CalibError : it does not, or cannot be read
    """
    try:
        with uninterrupted():
            read_apart(partial(_stored_sample, path), path)
    except UNREADABLE as error:
        raise CalibError(f"{path}: not a readable sample ({error}); it may be truncated") from error


def _stored_sample(path: Path) -> xr.Dataset:
    with xr.open_dataset(path, group="posterior", engine="netcdf4") as stored:
        return stored.load()


def write_ensemble(path: Path, space: Space, units: Mapping[str, str], posterior: Posterior) -> None:
    """Write a handful of equally weighted parameter sets as CSV, a column each, its unit in brackets; in SI."""
    rows = np.unique(np.linspace(0, len(posterior.points) - 1, ENSEMBLE_SIZE).round().astype(int))
    values = values_of(space, posterior)
    with whole(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        lines = csv.writer(file, lineterminator="\n")
        lines.writerow([f"{name} [{units[name]}]" for name in values])
        lines.writerows([[repr(float(own[row])) for own in values.values()] for row in rows])
