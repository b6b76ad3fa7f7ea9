"""Faces of a window by continuation: grazing, fold and flip curves over the slices through its centre, as a check.

The motion that a slice is drawn about is followed over one parameter of the pair, and what ends it over both (see
`calib.dynamics.curves`). Only simulators with a period map have such curves.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import xarray as xr
from scipy.spatial.distance import cdist

from calib.confidence.window.document import ExactFaces
from calib.confidence.window.margins import MECHANISMS
from calib.confidence.window.motion import settled_cycle
from calib.confidence.window.observed import KIND_MARGIN
from calib.dynamics.branch import follow
from calib.dynamics.curves import BifurcationCurve, follow_curves
from calib.dynamics.defining import ParameterPlane
from calib.errors import CalibError
from calib.modelling.orbit import PeriodMap
from calib.modelling.parameter import values_for
from calib.study import CalibrationStudy

MAX_CURVE_POINTS = 120  # each way along a curve; a slice is crossed in some tens
MAX_BRANCH_POINTS = 200  # each way along the motions over one parameter
POINTS_BETWEEN = 20  # of a chord of a curve, from which distances are measured
OF_KIND = frozenset([*MECHANISMS.values(), KIND_MARGIN])  # labels of faces at which the kind of motion changes


@dataclass(frozen=True, eq=False)
class ExactCurve:
    """A curve over a slice.

    Attributes
    ----------
    pair : positions of both parameters; kind : "fold", "flip" or "grazing"
    u : (m, 2) their positions in the windows of the study, 0 to 1
    bounding : (m,) whether it bounds stable motion
    """

    pair: tuple[int, int]
    kind: str
    u: np.ndarray
    bounding: np.ndarray


def exact_curves(
    study: CalibrationStudy,
    centre: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    on_slice: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[list[ExactCurve], dict[tuple[int, int], str]]:
    """Follow the curves of all records over the slices; return them, and why a slice has none.

    Parameters
    ----------
    centre : (dim,) the calibrated point in the unit cube, at which the other parameters are held
    low, high : (dim,) of the slices
    on_slice : told how many slices are done, and how many there are
    """
    curves, reasons = list[ExactCurve](), dict[tuple[int, int], str]()
    pairs = list(combinations(range(study.space.dim), 2))
    for done, pair in enumerate(pairs, start=1):
        told = list[str]()
        for name in study.objective.scored:
            for own in (pair, pair[::-1]):  # a branch over the second may meet what that over the first misses
                try:
                    followed = _followed(study, name, centre, low, high, own)
                except (CalibError, ValueError) as error:
                    told.append(str(error))
                    break
                curves += [_curve(pair, own, curve) for curve in followed]
                if followed:
                    break
        if not any(curve.pair == pair for curve in curves):
            reasons[pair] = told[0] if told else "the motion meets no grazing, fold or flip over either parameter"
        on_slice(done, len(pairs))
    return curves, reasons


def _followed(
    study: CalibrationStudy, name: str, centre: np.ndarray, low: np.ndarray, high: np.ndarray, pair: tuple[int, int]
) -> list[BifurcationCurve]:
    """Curves of the motion of the record `name` over the pair, of which the first is that of its branch."""
    reference, periods = study.objective.references[name], int(study.objective.measured_periods.get(name) or 0)
    if reference.is_swept:
        raise CalibError(f"record {name!r} is a frequency response, whose motions are many")
    if not reference.excitation.harmonic or not periods:
        raise CalibError(f"record {name!r} has no periodic motion under a harmonic excitation")
    i, j = pair

    def maps(a: float, b: float) -> PeriodMap:
        point = centre.copy()
        point[i], point[j] = a, b
        return study.model.period_map(values_for(study.space.values(point), name), reference.excitation)

    cycle = settled_cycle(maps(centre[i], centre[j]), periods)
    if cycle is None or not cycle.converged:
        raise CalibError(f"the motion of record {name!r} does not settle to a periodic one at the calibrated point")
    window = float(low[i]), float(high[i])
    branch = follow(
        lambda a: maps(a, centre[j]), cycle.state, float(centre[i]), window, cycle.periods, MAX_BRANCH_POINTS
    )
    if not branch.points:
        return []
    plane = ParameterPlane(maps, window, (float(low[j]), float(high[j])))
    return [curve for curve in follow_curves(branch, plane, float(centre[j]), MAX_CURVE_POINTS) if curve.a.size]


def _curve(pair: tuple[int, int], own: tuple[int, int], curve: BifurcationCurve) -> ExactCurve:
    u = np.column_stack([curve.a, curve.b] if own == pair else [curve.b, curve.a])
    return ExactCurve(pair, curve.kind, u, curve.bounding)


def with_curves(dataset: xr.Dataset, curves: Sequence[ExactCurve]) -> xr.Dataset:
    """Return what window.nc holds with the curves: dimensions exact_curve, and exact_step along all of them."""
    sizes = [len(curve.u) for curve in curves]
    u = np.concatenate([np.empty((0, 2)), *(curve.u for curve in curves)])
    pairs = list(combinations(range(dataset.sizes["parameter"]), 2))
    return dataset.assign(
        exact_pair=("exact_curve", np.array([pairs.index(curve.pair) for curve in curves], dtype=int)),
        exact_kind=("exact_curve", np.array([curve.kind for curve in curves], dtype=str)),
        exact_curve_of_step=("exact_step", np.repeat(np.arange(len(curves)), sizes)),
        exact_u=(("exact_step", "exact_axis"), u, {"units": "1"}),
        exact_bounding=("exact_step", np.concatenate([np.empty(0, bool), *(curve.bounding for curve in curves)])),
    )


def checked_faces(
    dataset: xr.Dataset, curves: Sequence[ExactCurve], reasons: Mapping[tuple[int, int], str]
) -> tuple[ExactFaces, ...]:
    """Compare the emulated boundary of each slice, where the kind of motion changes, with the curves over it."""
    names, checked = list(map(str, dataset.parameter.values)), []
    for k, pair in enumerate(combinations(range(len(names)), 2)):
        own = [curve for curve in curves if curve.pair == pair]
        emulated = kind_boundary(dataset, k, pair)
        distance = None
        if own and len(emulated):
            exact = np.concatenate([_dense(curve.u) for curve in own])
            distance = float(cdist(emulated, exact).min(axis=1).max())
        kinds = tuple(sorted({curve.kind for curve in own}))
        checked.append(ExactFaces(names[pair[0]], names[pair[1]], kinds, distance, reasons.get(pair, "")))
    return tuple(checked)


def kind_boundary(dataset: xr.Dataset, k: int, pair: tuple[int, int]) -> np.ndarray:
    """Points (n, 2) in the unit square at which a slice leaves the window because the kind of motion changes.

    They lie between neighbouring nodes, where the probability interpolated linearly is one half.
    """
    probability, mechanism = dataset.slice_probability.values[k], dataset.slice_mechanism.values[k]
    labels = dataset.slice_mechanism_label.values
    of_kind = np.array([str(label) in OF_KIND for label in labels])[mechanism]
    nodes = np.stack(np.meshgrid(*(dataset.node_u.values[axis] for axis in pair)), axis=-1)
    found = []
    for here, there in (((slice(None), slice(-1)), (slice(None), slice(1, None))), ((slice(-1),), (slice(1, None),))):
        one, other = probability[here], probability[there]
        crossed = (one >= 0.5) != (other >= 0.5)
        crossed &= np.where(one >= 0.5, of_kind[there], of_kind[here])  # the node outside tells why
        share = ((0.5 - one[crossed]) / (other[crossed] - one[crossed]))[:, None]
        found.append(nodes[here][crossed] * (1.0 - share) + nodes[there][crossed] * share)
    return np.concatenate(found)


def _dense(u: np.ndarray) -> np.ndarray:
    """Points along the chords of a curve (m, 2)."""
    if len(u) < 2:
        return u
    at = np.linspace(0.0, len(u) - 1.0, POINTS_BETWEEN * (len(u) - 1) + 1)
    return np.column_stack([np.interp(at, np.arange(len(u)), column) for column in u.T])
