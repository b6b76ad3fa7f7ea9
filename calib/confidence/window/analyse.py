"""The window from its evaluated points: share, faces, tolerances, the largest box and ellipsoid inside."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import gammaln

from calib.confidence.window.design import WindowDesign
from calib.confidence.window.document import WINDOW_END, EllipsoidResult, KindShare, ParameterTolerance, WindowResult
from calib.confidence.window.faces import Face, faces
from calib.confidence.window.margins import observed_of, of_measured_kind
from calib.confidence.window.observed import Observed
from calib.confidence.window.region import Region
from calib.confidence.window.sampling import RegionSample, fine_sample
from calib.confidence.window.shape import extent_along_axes, inscribed_ellipsoid, largest_box
from calib.confidence.window.share import UndiscoveredShare, VolumeShare, undiscovered_share, volume_share
from calib.confidence.window.words import percent
from calib.errors import CalibError
from calib.records import OK
from calib.store import Trial
from calib.store.trial import failures
from calib.study import CalibrationStudy
from calib.study.result import FailureSummary
from calib.units import count

MIN_SHAPE_POINTS = 100  # of the window, from which its second moments are known
STEP_OUTSIDE = 1e-3  # edges of the cube, beyond an end, where its cause is read
MAX_RELATIVE_UNCERTAINTY = 0.05  # misclassified over admissible volume, above which more points are advised  [1]


def analysed(
    study: CalibrationStudy,
    trials: Sequence[Trial],
    start: np.ndarray,
    tolerances: Mapping[str, float],
    seed: int,
    seconds: float,
) -> tuple[WindowResult, Region, RegionSample, Observed]:
    """Window of the study, its emulated region, the points that this was sampled at, and what was observed.

    Raises
    ------
    CalibError : no point is of the measured kind, or too few are for an emulator
    """
    observed = observed_of(trials, tolerances)
    region = WindowDesign(study.space.dim, seed).region(observed)
    if region is None:
        raise CalibError(
            f"the motion is of the measured kind at {int(observed.right.sum())} of "
            f"{count(len(trials), 'point')}: too few to draw a window; raise --budget, or narrow the study's windows"
        )
    sample = fine_sample(region, observed.points[observed.admissible], seed)
    share = volume_share(region, sample, observed, seed)
    undiscovered = undiscovered_share(region, sample, observed, seed)
    inside = sample.points[sample.probability >= 0.5]
    box = largest_box(region, start)
    found = faces(region, sample, seed)
    units = {name: study.model.parameters[name.partition("@")[0]].unit for name in study.space.names}
    result = WindowResult(
        name=study.name,
        windows=dict(study.space.windows),
        units=units,
        measured_kind=study.objective.measured_kinds,
        tolerances=dict(tolerances),
        calibrated={name: study.space.values(start)[name] for name in study.space.names},
        points=len(trials),
        simulations=sum(len(study.objective.scored) if t.simulations is None else t.simulations for t in trials),
        seed=seed,
        admissible_points=int(observed.admissible.sum()),
        share=share.value,
        share_low=share.low,
        share_high=share.high,
        misclassified=share.misclassified,
        mechanisms=found[0].mechanisms if found else {},
        parameters=_tolerances(study, region, start, box, found),
        box_share=None if box is None or not share.value else float(np.prod(box[1] - box[0])) / share.value,
        ellipsoid=_ellipsoid(region, inside, share.value),
        kinds=_kinds(trials),
        failures=tuple(FailureSummary(group[0].status, len(group), group[0].reason) for group in failures(trials)),
        remarks=tuple(_remarks(observed, region, share, undiscovered, start, tolerances)),
        seconds=seconds,
    )
    return result, region, sample, observed


def _tolerances(
    study: CalibrationStudy,
    region: Region,
    start: np.ndarray,
    box: tuple[np.ndarray, np.ndarray] | None,
    found: Sequence[Face],
) -> tuple[ParameterTolerance, ...]:
    low, high = extent_along_axes(region, start)
    met = {(face.parameter, face.side): face.mechanisms for face in found}
    rows = []
    for axis, (name, window) in enumerate(study.space.windows.items()):
        rows.append(
            ParameterTolerance(
                name=name,
                unit=study.model.parameters[name.partition("@")[0]].unit,
                value=window.value(float(start[axis])),
                alone_low=window.value(float(low[axis])),
                alone_high=window.value(float(high[axis])),
                alone_low_cause=_cause(region, start, axis, float(low[axis]) - STEP_OUTSIDE),
                alone_high_cause=_cause(region, start, axis, float(high[axis]) + STEP_OUTSIDE),
                together_low=None if box is None else window.value(float(box[0][axis])),
                together_high=None if box is None else window.value(float(box[1][axis])),
                low_mechanisms=met.get((axis, "low"), {}),
                high_mechanisms=met.get((axis, "high"), {}),
            )
        )
    return tuple(rows)


def _cause(region: Region, start: np.ndarray, axis: int, beyond: float) -> str:
    """What bounds the window where a coordinate comes to `beyond`, the others at the start."""
    if not 0.0 <= beyond <= 1.0:
        return WINDOW_END
    point = start.copy()
    point[axis] = beyond
    return region.labels[int(np.argmin(region.met(point[None])[0]))]


def _ellipsoid(region: Region, inside: np.ndarray, share: float) -> EllipsoidResult | None:
    if len(inside) < MIN_SHAPE_POINTS:
        return None
    found = inscribed_ellipsoid(region, inside)
    if not found.radius > 1e-3:
        return None
    root, dim = found.radius * found.root, inside.shape[1]
    volume = math.exp(
        0.5 * dim * math.log(math.pi) - float(gammaln(0.5 * dim + 1.0)) + float(np.linalg.slogdet(root)[1])
    )
    return EllipsoidResult(tuple(found.centre.tolist()), tuple(map(tuple, root.tolist())), volume / share)


def _kinds(trials: Sequence[Trial]) -> tuple[KindShare, ...]:
    counts = Counter(
        ((trial.kind or "") if trial.status == OK else trial.status, of_measured_kind(trial, trials[0]))
        for trial in trials
    )
    return tuple(KindShare(motion, measured, number) for (motion, measured), number in counts.most_common())


def _remarks(
    observed: Observed,
    region: Region,
    share: VolumeShare,
    undiscovered: UndiscoveredShare,
    start: np.ndarray,
    tolerances: Mapping[str, float],
) -> list[str]:
    remarks = []
    if not observed.admissible.any():
        remarks.append("no evaluated point is admissible: the share is an extrapolation; raise the tolerances")
    elif region.probability(start[None])[0] < 0.5 or not observed.admissible[0]:
        remarks.append(
            "the calibrated point itself is not admissible, so that what parameters may vary alone means nothing; "
            f"raise the tolerances ({', '.join(f'{label} {tolerance:.3g}' for label, tolerance in tolerances.items())})"
        )
    if observed.admissible.any() and undiscovered.high > share.high - share.value:
        remarks.append(
            f"the share is that of the part of the window that points have met: none of the {undiscovered.points} "
            f"space-filling points outside it is admissible, so that other parts have at most "
            f"{percent(undiscovered.high)} of the box (with 97.5 % probability)"
        )
    if share.value and share.misclassified > MAX_RELATIVE_UNCERTAINTY * share.value:
        remarks.append(
            f"{percent(share.misclassified / share.value)} of the admissible volume may be on the wrong side of the "
            "boundary: a larger --budget goes on from here"
        )
    return remarks
