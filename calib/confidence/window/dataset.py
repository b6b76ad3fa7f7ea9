"""A window as arrays: evaluated points, quasi-random points with their probability, and slices."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import xarray as xr

from calib.confidence.window.margins import of_measured_kind
from calib.confidence.window.observed import Observed
from calib.confidence.window.region import Region
from calib.confidence.window.sampling import FINE_REPLICATES, FINE_SPLIT_POINTS, RegionSample
from calib.modelling.parameter import Space
from calib.records import OK
from calib.store import Trial

SLICE_NODES = 41  # along each side of a slice
STORED_SAMPLE = FINE_REPLICATES * FINE_SPLIT_POINTS  # as many points as the densest part of a sample has


def window_dataset(
    space: Space,
    units: Sequence[str],
    region: Region,
    sample: RegionSample,
    observed: Observed,
    trials: Sequence[Trial],
    centre: np.ndarray,
) -> xr.Dataset:
    """Return what window.nc holds.

    Its dimensions are parameter, point (evaluated), margin, sample (points spread evenly over a part of the box that
    holds the window), pair (of parameters), row and column (nodes of a slice through the centre: row along the second
    parameter of the pair, column along the first). Positions are those in the windows of the study, 0 to 1; values are
    in SI.

    Parameters
    ----------
    centre : (dim,) through which slices go
    """
    names, pairs = space.names, list(combinations(range(space.dim), 2))
    axes = np.linspace(sample.low, sample.high, SLICE_NODES).T
    met = np.stack([_slice(region, centre, axes, i, j) for i, j in pairs])
    nodes = np.array(
        [[window.value(float(u)) for u in axis] for window, axis in zip(space.windows.values(), axes, strict=True)]
    )
    stored = sample.points[:STORED_SAMPLE]
    probability = met.prod(axis=-1)
    return xr.Dataset(
        {
            "u": (("point", "parameter"), observed.points, {"units": "1"}),
            "value": (("point", "parameter"), _values(space, observed.points), {"units": "that of the parameter"}),
            "of_measured_kind": ("point", np.array([of_measured_kind(trial, trials[0]) for trial in trials])),
            "admissible": ("point", observed.admissible),
            "motion": ("point", np.array([(t.kind or "") if t.status == OK else t.status for t in trials], dtype=str)),
            "margin": (("point", "mechanism"), observed.margins, {"units": "1"}),
            "sample_u": (("sample", "parameter"), stored, {"units": "1"}),
            "sample_value": (("sample", "parameter"), _values(space, stored), {"units": "that of the parameter"}),
            "sample_probability": ("sample", sample.probability[:STORED_SAMPLE], {"units": "1"}),
            "slice_probability": (("pair", "row", "column"), probability, {"units": "1"}),
            "slice_mechanism": (("pair", "row", "column"), met.argmin(axis=-1)),
            "node_u": (("parameter", "node"), axes, {"units": "1"}),
            "node_value": (("parameter", "node"), nodes, {"units": "that of the parameter"}),
            "pair_first": ("pair", np.array([names[i] for i, _ in pairs], dtype=str)),
            "pair_second": ("pair", np.array([names[j] for _, j in pairs], dtype=str)),
            "centre": ("parameter", _values(space, centre[None])[0], {"units": "that of the parameter"}),
        },
        coords={
            "parameter": list(names),
            "parameter_unit": ("parameter", list(units)),
            "mechanism": list(observed.labels),
            "slice_mechanism_label": ("region_margin", list(region.labels)),
        },
    )


def _slice(region: Region, centre: np.ndarray, axes: np.ndarray, i: int, j: int) -> np.ndarray:
    """Probability (row, column, margins) that each margin is positive, over the axes i (columns) and j (rows)."""
    points = np.tile(centre, (SLICE_NODES, SLICE_NODES, 1))
    points[:, :, i], points[:, :, j] = axes[i][None, :], axes[j][:, None]
    return region.met(points.reshape(-1, centre.size)).reshape(SLICE_NODES, SLICE_NODES, -1)


def _values(space: Space, points: np.ndarray) -> np.ndarray:
    """Values (m, dim) in SI of points (m, dim) of the unit cube."""
    columns = zip(space.windows.values(), points.T, strict=True)
    return np.column_stack([[window.value(float(u)) for u in column] for window, column in columns])
