"""Whether the best trial gives the logged score when it is evaluated again."""

import math

from calib.execution.pool import Failure
from calib.store import Trial
from calib.study.evaluation import Evaluation

MAX_ROUND_OFF = 1e-6  # relative difference of two scores of one point that round-off may cause  [1]
NEGLIGIBLE_DISTANCE = 1e-12  # below which two scores are both those of a perfect fit  [1]


def repetition(trial: Trial, again: Evaluation | Failure) -> str:
    """Return a remark where a trial evaluated again has another score than the logged one; empty where it has not.

    Parameters
    ----------
    again : the same values, evaluated by the same simulator
    """
    consequence = (
        "the result cannot be reproduced: the simulator is not deterministic, or its code, a library or the machine "
        "has changed since that trial"
    )
    if trial.simulations == 0:
        consequence += (
            "; the trial was answered from the cache: where that is of a former program, delete the folder `cache` of "
            "the results and begin afresh (--fresh)"
        )
    logged = f"trial {trial.number} was logged at a distance of {trial.cost:.6g}"
    if isinstance(again, Failure):
        return f"{logged} and failed when it was evaluated again ({again.status}: {again.reason}); {consequence}"
    cost = float(again.score.cost)
    if math.isclose(cost, trial.cost, rel_tol=MAX_ROUND_OFF, abs_tol=NEGLIGIBLE_DISTANCE):
        return ""
    if not math.isfinite(cost):
        status = f"{again.score.status}: {again.score.reason}"
        return f"{logged} and failed when it was evaluated again ({status}); {consequence}"
    return f"{logged} and is at {cost:.6g} when it is evaluated again; {consequence}"
