"""Confidence in the calibrated values of a study."""

import numpy as np

from calib.confidence.local import Confidence, local
from calib.confidence.noise_propagation import noise_draws
from calib.execution.pool import Failure, in_order
from calib.store import Trial
from calib.study import CalibrationStudy, Evaluation, Outcome, Pool, outcome


def around_best(
    study: CalibrationStudy, pool: Pool, best: Trial, evaluation: Evaluation | Failure | None = None
) -> Confidence:
    """Confidence in the values of a study's best trial.

    Parameters
    ----------
    pool : evaluates values at this study, see `calib.study.evaluate`
    evaluation : of the best trial's values, where it was made already
    """

    def evaluated(points: np.ndarray) -> list[Outcome]:
        return [_outcome(answer) for answer in in_order(pool, [study.space.values(u) for u in points])]

    if evaluation is None:
        [evaluation] = in_order(pool, [best.values])
    blocks = noise = None
    if isinstance(evaluation, Evaluation) and evaluation.score.residuals is not None:
        residuals = study.objective.residuals(evaluation.records)
        labels = zip(*(residuals[name].values for name in ("term", "record", "body", "channel")), strict=True)
        blocks = np.unique([" ".join(map(str, label)) for label in labels], return_inverse=True)[1]
        if len(study.objective.terms) > 1:  # terms that compare one channel share its noise
            noise = noise_draws(study.objective, evaluation.records, study.seed)
    return local(
        evaluated, study.space, np.array(best.u), outcome=_outcome(evaluation), blocks=blocks, noise_draws=noise
    )


def _outcome(answer: Evaluation | Failure) -> Outcome:
    return outcome(answer if isinstance(answer, Failure) else answer.score)
