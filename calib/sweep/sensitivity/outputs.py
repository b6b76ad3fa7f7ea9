"""What the parameters of a study may influence, as numbers at each point."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.objective.objective import MIN_COST_OF_WRONG_KIND
from calib.records import OK
from calib.store import Trial
from calib.sweep.sensitivity.document import FEATURE, KIND, RESIDUAL, STATUS

DISTANCE = "distance"  # of all terms together
MEASURED_KIND, ENDED_WELL = "the motion is of the measured kind", "the simulation ends well"  # labels of outputs


@dataclass(frozen=True, eq=False)
class Output:
    """One number at each point.

    Attributes
    ----------
    label, of, unit, record, body : see `calib.sweep.sensitivity.document.OutputSensitivity`
    values : (n,)  [unit]; NaN where a point does not show it
    """

    label: str
    of: str
    values: np.ndarray
    unit: str = "1"
    record: str = ""
    body: str = ""


def is_of_measured_kind(trial: Trial) -> bool:
    """Whether the motion of a point is of the measured kind in all records."""
    return trial.scored and trial.cost < MIN_COST_OF_WRONG_KIND


def outputs(trials: Sequence[Trial]) -> list[Output]:
    """Outputs at the points (n,) of `trials`.

    Those of the motion are defined where it is of the measured kind: the distance from the measurement, in all and by
    term, and the scalar features of each record and body.
    """
    right = [is_of_measured_kind(trial) for trial in trials]
    found = [Output(MEASURED_KIND, KIND, np.array(right, dtype=float))]
    if any(trial.status != OK for trial in trials):
        found.append(Output(ENDED_WELL, STATUS, np.array([trial.status == OK for trial in trials], dtype=float)))
    distances: dict[str, np.ndarray] = {}
    features: dict[tuple[str, str, str, str], np.ndarray] = {}

    def empty() -> np.ndarray:
        return np.full(len(trials), np.nan)

    for point, trial in enumerate(trials):
        if not right[point]:
            continue
        if len(trial.terms) > 1:
            distances.setdefault(DISTANCE, empty())[point] = trial.cost
        for label, distance in trial.terms.items():
            distances.setdefault(f"distance of {label}", empty())[point] = distance
        for feature in trial.features:
            key = feature["record"], feature["body"], feature["label"], feature["unit"]
            simulated = feature["simulated"]
            features.setdefault(key, empty())[point] = np.nan if simulated is None else simulated
    found += [Output(label, RESIDUAL, values) for label, values in distances.items()]
    return found + [
        Output(label, FEATURE, values, unit, record, body) for (record, body, label, unit), values in features.items()
    ]
