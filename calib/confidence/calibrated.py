"""Confidence in the calibrated values of a study."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from calib.confidence.constrained import FittedPoint
from calib.confidence.covariance import MIN_BLOCK_SIZE
from calib.confidence.derivatives import Evaluate
from calib.confidence.local import Confidence, local
from calib.confidence.noise_propagation import PROPAGATION_DRAWS, noise_draws
from calib.confidence.notes import CONFIRMED, EVALUATION
from calib.confidence.posterior import LogLikelihood, Posterior, sample_posterior
from calib.confidence.prior import Prior, positions
from calib.confidence.profile import Centre
from calib.confidence.profiles import LocalAnalysis, Notes, Profiles, best_about, fit_about, profiles
from calib.confidence.starts import where_starts_agree
from calib.execution.pool import Failure, in_order
from calib.store import Trial
from calib.study import CalibrationStudy, Evaluation, Outcome, Pool, outcome

CONFIRMED_BATCH = 8  # points that the confirming simulator computes together  [count]


def around_best(
    study: CalibrationStudy,
    pool: Pool,
    best: Trial,
    evaluation: Evaluation | Failure | None = None,
    agreement: Mapping[str, Any] | None = None,
    on_progress: Callable[[int, int], None] = lambda done, foreseen: None,
) -> Confidence:
    """Confidence in the values of a study's best trial.

    Parameters
    ----------
    pool : evaluates values at this study, see `calib.study.evaluate`
    evaluation : of the best trial's values, where it was made already
    agreement : what the optimiser says of where its starts ended; where they do not agree there are no intervals
    on_progress : called with the number of draws of the noise that are propagated to the residuals, and of all
    """
    if evaluation is None:
        [evaluation] = in_order(pool, [best.values])
    u = np.array(best.u)
    confidence = _analysed(study, _evaluated_by(study, pool), u, evaluation, on_progress).confidence
    return where_starts_agree(confidence, study.space, u, agreement or {})


def profiled(
    study: CalibrationStudy,
    pool: Pool,
    u: np.ndarray,
    notes: Notes,
    *,
    pairs: Sequence[tuple[str, str]] = (),
    on_progress: Callable[[int, int], None] = lambda done, foreseen: None,
) -> Profiles:
    """Profiles of the likelihood about a study's best point; see `calib.confidence.profiles.profiles`.

    Parameters
    ----------
    pool : evaluates values at this study, see `calib.study.evaluate`
    u : (dim,) the best point, in the unit cube
    notes : finished points are taken from there, and added to it
    pairs : of parameters that are profiled together
    on_progress : called with the number of evaluations that are done, and of those that are foreseen

    Raises
    ------
    CalibError : the best point cannot be evaluated
    """
    evaluate, analyse = _evaluated_by(study, pool), partial(_analysed_at, study, pool)
    return profiles(evaluate, analyse, study.space.names, u, notes, pairs=pairs, on_progress=on_progress)


def fitted(study: CalibrationStudy, pool: Pool, u: np.ndarray, notes: Notes) -> tuple[LocalAnalysis, Centre]:
    """Best point near `u` (dim,) of the unit cube, as profiles begin at; the rest as in `profiled`."""
    evaluate, analyse = _evaluated_by(study, pool), partial(_analysed_at, study, pool)
    return best_about(evaluate, analyse, study.space.names, u, notes)


def sampled(
    study: CalibrationStudy,
    pool: Pool,
    analysis: LocalAnalysis,
    centre: Centre,
    notes: Notes,
    priors: Mapping[str, Prior],
    *,
    on_progress: Callable[[int, int], None] = lambda done, foreseen: None,
) -> Posterior:
    """Sample the posterior distribution of a study's parameters; its seed is the study's.

    Parameters
    ----------
    pool : evaluates values at this study, see `calib.study.evaluate`
    analysis, centre : of the best point, about which the likelihood is
    notes : evaluated points are taken from there, and added to it
    priors : of parameters; the others are equally likely everywhere in their windows
    on_progress : called with the number of points that are evaluated, and of those that are foreseen

    Raises
    ------
    CalibError : the sampler is not installed
    """
    log_likelihood = partial(_log_likelihoods, study, pool, analysis, centre, notes, EVALUATION)
    likelihood = centre.likelihood
    compression = -0.5 * float(np.linalg.slogdet(2.0 * np.pi * likelihood.robust_covariance)[1])
    return sample_posterior(
        log_likelihood, partial(positions, study.space, priors), study.space.dim, study.seed, compression=compression,
        on_progress=on_progress,
    )  # fmt: skip


def confirmed(
    study: CalibrationStudy,
    pool: Pool,
    analysis: LocalAnalysis,
    centre: Centre,
    notes: Notes,
    points: np.ndarray,
    on_progress: Callable[[int, int], None] = lambda done, foreseen: None,
) -> np.ndarray:
    """Logarithms (n,) of the likelihood of points (n, dim) by the confirming simulator, which `pool` runs.

    -infinity where its simulation cannot be compared. Points are evaluated in batches, each kept in the notes; the rest
    as in `sampled`.
    """
    found = list[float]()
    for first in range(0, len(points), CONFIRMED_BATCH):
        batch = points[first : first + CONFIRMED_BATCH]
        found += _log_likelihoods(study, pool, analysis, centre, notes, CONFIRMED, batch).tolist()
        on_progress(len(found), len(points))
    comparable = [_known(notes, CONFIRMED, u) for u in points]
    return np.array([x if p is not None and math.isfinite(p.square) else -math.inf
                     for x, p in zip(found, comparable, strict=True)])  # fmt: skip


def _log_likelihoods(
    study: CalibrationStudy,
    pool: Pool,
    analysis: LocalAnalysis,
    centre: Centre,
    notes: Notes,
    prefix: str,
    points: np.ndarray,
) -> np.ndarray:
    """Logarithms (n,) of the likelihood of points (n, dim), which are kept in the notes under keys with a prefix."""
    fit = fit_about(analysis, centre.likelihood, _evaluated_by(study, pool))
    logarithm = LogLikelihood(centre.likelihood, centre.u)
    missing = np.array([_known(notes, prefix, u) is None for u in points])
    if missing.any():
        made = zip(points[missing], fit.at(points[missing]), strict=True)
        notes.add_all({_key(prefix, u): point for u, point in made})
    known = (_known(notes, prefix, u) for u in points)
    return np.array([logarithm(point) for point in known if point is not None])


def _known(notes: Notes, prefix: str, u: np.ndarray) -> FittedPoint | None:
    return notes.get(_key(prefix, u))


def _key(prefix: str, u: np.ndarray) -> str:
    return f"{prefix}{json.dumps(u.tolist())}"


def _analysed_at(study: CalibrationStudy, pool: Pool, u: np.ndarray) -> LocalAnalysis:
    [evaluation] = in_order(pool, [study.space.values(u)])
    return _analysed(study, _evaluated_by(study, pool), u, evaluation)


def _evaluated_by(study: CalibrationStudy, pool: Pool) -> Evaluate:
    def evaluated(points: np.ndarray) -> list[Outcome]:
        return [_outcome(answer) for answer in in_order(pool, [study.space.values(u) for u in points])]

    return evaluated


def _analysed(
    study: CalibrationStudy,
    evaluate: Evaluate,
    u: np.ndarray,
    evaluation: Evaluation | Failure,
    on_progress: Callable[[int, int], None] = lambda done, foreseen: None,
) -> LocalAnalysis:
    """Analyse a point (dim,) of the unit cube, with its evaluation."""
    blocks = noise = None
    if isinstance(evaluation, Evaluation) and evaluation.score.residuals is not None:
        residuals = study.objective.residuals(evaluation.records)
        blocks = _blocks(residuals)
        if foreseen_noise_draws(study):
            noise = noise_draws(study.objective, evaluation.records, study.seed, on_progress=on_progress)
    centre = _outcome(evaluation)
    confidence = local(evaluate, study.space, u, outcome=centre, blocks=blocks, noise_draws=noise)
    return LocalAnalysis(centre, confidence, blocks, noise)


def foreseen_noise_draws(study: CalibrationStudy) -> int:
    """Draws of the noise that confidence in the values takes: residuals of several blocks share one measurement's."""
    swept = any(reference.is_swept for reference in study.objective.references.values())
    return PROPAGATION_DRAWS if len(study.objective.terms) > 1 or swept else 0


def _blocks(residuals: xr.DataArray) -> np.ndarray:
    """Numbers (m,) of the blocks of residuals (m,): one term, record, body and channel, in so far as they are many.

    Those of one term that are too few for a noise level of their own share one.
    """
    labels = zip(*(residuals[name].values for name in ("term", "record", "body", "channel")), strict=True)
    _, blocks, sizes = np.unique(
        [" ".join(map(str, label)) for label in labels], return_inverse=True, return_counts=True
    )
    short = sizes[blocks] < MIN_BLOCK_SIZE
    _, terms = np.unique(residuals["term"].values, return_inverse=True)
    return np.where(short, sizes.size + terms, blocks)


def _outcome(answer: Evaluation | Failure) -> Outcome:
    return outcome(answer if isinstance(answer, Failure) else answer.score)
