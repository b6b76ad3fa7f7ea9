"""Indices of sensitivity from the evaluated points of a design."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.records import OK
from calib.store import Trial
from calib.store.trial import failures
from calib.study import CalibrationStudy
from calib.study.result import FailureSummary
from calib.sweep.sensitivity.design import MORRIS, SensitivityDesign
from calib.sweep.sensitivity.document import (
    ELEMENTARY_EFFECTS,
    KIND,
    Estimate,
    MotionShare,
    OutputSensitivity,
    SensitivityResult,
)
from calib.sweep.sensitivity.morris import morris_influences
from calib.sweep.sensitivity.outputs import Output, is_of_measured_kind, outputs
from calib.sweep.sensitivity.variance import HALF_WIDTH, sobol_influences

MAX_ROUNDING_VARIATION = 1e-9  # standard deviation over the largest size, below which an output does not vary  [1]
MIN_MEASURED_SHARE = 0.1  # of the measured kind, below which smaller windows are advised  [1]


def analyse(study: CalibrationStudy, design: SensitivityDesign, trials: Sequence[Trial]) -> SensitivityResult:
    """Return shares of the kinds of motion, and the influence of every parameter on every output.

    Parameters
    ----------
    trials : of the design's points, in their order
    """
    model, names = study.model, study.space.names
    result = SensitivityResult(
        name=study.name,
        method=design.method,
        windows=dict(study.space.windows),
        units={name: model.parameters[name.partition("@")[0]].unit for name in names},
        groups=design.groups,
        seed=design.seed,
        points=design.size,
        simulations=sum(len(study.objective.scored) if t.simulations is None else t.simulations for t in trials),
        measured_kind=study.objective.measured_kinds,
        shares=shares(design, trials),
        outputs=tuple(sensitivity(design, names, output) for output in outputs(trials)),
        failures=tuple(FailureSummary(group[0].status, len(group), group[0].reason) for group in failures(trials)),
    )
    return replace(result, remarks=tuple(_remarks(result)))


def sensitivity(design: SensitivityDesign, names: Sequence[str], output: Output) -> OutputSensitivity:
    """Influence of each parameter, in the order of the design's coordinates, on an output."""
    known = output.values[np.isfinite(output.values)]
    found = OutputSensitivity(
        output.label, output.of, output.unit, output.record, output.body, points=known.size
    )  # fmt: skip
    if not known.size:
        return replace(found, reason="not available: no point shows it")
    deviation = float(known.std())
    found = replace(found, deviation=deviation)
    if deviation <= MAX_ROUNDING_VARIATION * float(np.abs(known).max()):
        what = f"it is {known[0]:.6g} at all points" if output.of != KIND else _same_kind(bool(known[0]))
        return replace(found, reason=f"no parameter moves it: {what}")
    if design.method == MORRIS:
        influences = morris_influences(design, names, output.values)
        return replace(found, estimator=ELEMENTARY_EFFECTS, influences=influences)
    estimator, influences, reason = sobol_influences(design, names, output.values)
    return replace(found, estimator=estimator, influences=influences, reason=reason)


def shares(design: SensitivityDesign, trials: Sequence[Trial]) -> tuple[MotionShare, ...]:
    """Share of the points of each kind of motion and status, the measured kind first, then the most frequent one."""
    counts: dict[tuple[str, bool, bool], int] = {}
    for trial in trials:
        failed = trial.status != OK
        key = (trial.status if failed else trial.kind or ""), is_of_measured_kind(trial), failed
        counts[key] = counts.get(key, 0) + 1
    found = [
        MotionShare(motion, measured, failed, count, _wilson(count / design.size, design.groups))
        for (motion, measured, failed), count in counts.items()
    ]
    return tuple(sorted(found, key=lambda one: (not one.measured, one.failed, -one.points, one.motion)))


def _same_kind(measured: bool) -> str:
    return "the motion is of the measured kind at all points" if measured else "it is so at no point"


def _wilson(share: float, number: int) -> Estimate:
    """Wilson's interval of a share that was observed among so many independent points (1927, JASA 22, 209)."""
    square = HALF_WIDTH**2 / number
    centre = (share + 0.5 * square) / (1.0 + square)
    half = math.sqrt(square * share * (1.0 - share) + 0.25 * square**2) / (1.0 + square)
    return Estimate(share, max(0.0, centre - half), min(1.0, centre + half))


def _remarks(result: SensitivityResult) -> list[str]:
    measured, remarks = result.measured_share, list[str]()
    if measured < MIN_MEASURED_SHARE:
        remarks.append(
            f"the motion is of the measured kind at {measured:.0%} of the points: narrow the windows of the parameters "
            "that decide it, or take more points"
        )
    if any(one.estimator == "given data" for one in result.outputs):
        remarks.append(
            "where some points do not show an output, its indices are of given data: those of parameters that the "
            "kind of motion ties to each other share what they cause together"
        )
    return remarks
