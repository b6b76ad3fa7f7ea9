"""The posterior distribution of a study and what it predicts, in files of its folder."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from calib.confidence import confirmed, fitted, sampled
from calib.confidence.artifacts import read_confidence
from calib.confidence.bands import PREDICTIVE, write_bands
from calib.confidence.document import ConfidenceResult, ConfirmedResult, PosteriorResult
from calib.confidence.importance import CONFIRMED_DRAWS, confirmed_result
from calib.confidence.instrument import with_sampled_nuisances
from calib.confidence.likelihood import AdjustedLikelihood
from calib.confidence.notes import PointNotes
from calib.confidence.posterior import Posterior, expected_evaluations
from calib.confidence.profile import Centre
from calib.confidence.sample import (
    check_posterior,
    posterior_result,
    prior_in_words,
    values_of,
    write_ensemble,
    write_posterior,
)
from calib.errors import CalibError
from calib.execution.files import whole
from calib.execution.netcdf import read_dataset
from calib.report.plots.posterior import posterior_figure
from calib.report.plots.predictive import predictive_figure
from calib.report.plots.style import png
from calib.study_file import StudyFile
from calib.workflows.evaluations import CONFIRM, Evaluations
from calib.workflows.model_comparison import CONFIDENCE_STAGE, OpenModel, identity_of_points
from calib.workflows.predictive import (
    PredictedRecords,
    bands_of_records,
    forget_pieces,
    predicted_records,
    predicted_results,
    predicted_simulations,
    predictive_groups,
)

POSTERIOR, POSTERIOR_PICTURE, ENSEMBLE = "posterior.nc", "posterior.png", "ensemble.csv"
PREDICTIVE_PICTURE = "predictive.png"
POSTERIOR_FILES = (POSTERIOR, POSTERIOR_PICTURE, PREDICTIVE, PREDICTIVE_PICTURE, ENSEMBLE)
NUISANCE_NOTES = "confidence.nuisances.jsonl"  # points of the study whose nuisances are parameters
MAX_COVARIANCE_CONDITION = 1e10  # of a covariance, above which it does not tell directions apart  [1]


def posterior_of(
    model: OpenModel, folder: Path, on_stage: Callable[[str], None], on_progress: Callable[[int, int], None]
) -> PosteriorResult:
    """Sample the posterior distribution of a study, simulate what it predicts, and write its files.

    on_progress : called with the number of evaluations that are done, and of those that are foreseen

    Raises
    ------
    CalibError : the sampler is not installed
    """
    file, study = model.file, model.file.study
    again = CONFIRMED_DRAWS if study.model.confirming is not None else 0
    progress = StagedProgress(on_progress, [expected_evaluations(study.space.dim), predicted_simulations(file), again])
    on_stage("posterior")
    sample = sampled(
        study, model.evaluations.calibrated(CONFIDENCE_STAGE), model.analysis, model.centre, model.notes, file.priors,
        on_progress=partial(progress, 0),
    )  # fmt: skip
    on_stage("predictions")
    best = study.space.values(model.centre.u)
    records = predicted_records(file, model.evaluations, sample, best, folder, partial(progress, 1))
    units = {name: study.model.parameters[name.partition("@")[0]].unit for name in study.space.names}
    result = replace(posterior_result(study.space, units, file.priors, sample), predicted=predicted_results(records))
    if study.model.confirming is not None:
        on_stage("confirming simulator")
        result = replace(result, confirmed=_confirmed(model, sample, result, partial(progress, 2)))
    _write_sample(file, sample, result, best, units, records, folder)
    return result


def _confirmed(
    model: OpenModel, sample: Posterior, result: PosteriorResult, on_progress: Callable[[int, int], None]
) -> ConfirmedResult:
    """Compute the first draws, which are in random order, by the confirming simulator."""
    study, points = model.file.study, sample.points[:CONFIRMED_DRAWS]
    pool = model.evaluations.calibrated(CONFIRM, confirming=True)
    logarithms = confirmed(study, pool, model.analysis, model.centre, model.notes, points, on_progress)
    values = {name: own[: len(points)] for name, own in values_of(study.space, sample).items()}
    deviations = {own.name: own.standard_deviation for own in result.parameters}
    return confirmed_result(sample.log_likelihood[: len(points)], logarithms, values, deviations)


def with_nuisances(
    model: OpenModel, folder: Path, on_stage: Callable[[str], None], on_progress: Callable[[int, int], None]
) -> PosteriorResult:
    """Sample scale, shear and offset of the calibrated records with the parameters; the rest as in `posterior_of`.

    Raises
    ------
    CalibError : no record has such nuisances, or the sampler is not installed
    """
    own = model.file.study
    study, priors, null = with_sampled_nuisances(own, model.file.priors)
    file = replace(model.file, study=study, priors=priors)
    u = study.space.point({**own.space.values(model.centre.u), **null})
    with (
        PointNotes(folder / NUISANCE_NOTES, identity_of_points(study, u)) as notes,
        Evaluations(file, folder, on_stage) as evaluations,
    ):
        on_stage("best point with nuisances")
        analysis, centre = fitted(study, evaluations.calibrated(CONFIDENCE_STAGE), u, notes)
        centre = replace(centre, likelihood=_told_apart(centre, model.centre))
        return posterior_of(OpenModel(file, evaluations, notes, analysis, centre), folder, on_stage, on_progress)


def with_earlier(result: ConfidenceResult, file: StudyFile, folder: Path) -> ConfidenceResult:
    """Take over what an earlier run about the same best point has profiled, and sampled where its priors are the same.

    Where samples cannot be taken over, their files are removed: they would be of another result.
    """
    try:
        earlier = read_confidence(folder)
    except CalibError:
        earlier = None
    space, parameters = file.study.space, file.study.model.parameters
    if earlier is None or dict(earlier.values) != dict(result.values):
        return without_earlier(result, folder)
    result = replace(result, comparison=result.comparison or earlier.comparison)
    if not result.profiles:
        result = replace(result, profiles=earlier.profiles, pairs=earlier.pairs)
    if result.posterior is not None or earlier.posterior is None:
        return without_earlier(result, folder)
    priors = {own.name: own.prior for own in earlier.posterior.parameters}
    now = {
        name: prior_in_words(file.priors.get(name), window.scale, parameters[name.partition("@")[0]].unit)
        for name, window in space.windows.items()
    }
    if any(priors.get(name) != prior for name, prior in now.items()):
        return without_earlier(result, folder)
    damage = tuple(filter(None, (damage_of_sample(folder, name) for name in POSTERIOR_FILES)))
    return replace(result, posterior=earlier.posterior, remarks=(*result.remarks, *damage))


def damage_of_sample(folder: Path, name: str) -> str:
    """Why a file of a posterior distribution cannot be used, a sentence without its full stop; "" where it can."""
    path = folder / name
    if not path.is_file():
        return f"{path} is missing: sample the posterior distribution again, with --posterior"
    checks = {POSTERIOR: check_posterior, PREDICTIVE: read_dataset}
    try:
        if name in checks:
            checks[name](path)
    except CalibError as error:
        return f"{path} is damaged: sample the posterior distribution again, with --posterior ({error})"
    return ""


def without_earlier(result: ConfidenceResult, folder: Path) -> ConfidenceResult:
    """Remove the files of an earlier posterior distribution where the result has none."""
    if result.posterior is None:
        for name in POSTERIOR_FILES:
            (folder / name).unlink(missing_ok=True)
    return result


def _told_apart(centre: Centre, solved: Centre) -> AdjustedLikelihood:
    """Likelihood about a point; with one factor for all directions where its covariance is all but singular.

    A scale and an amplitude may make up for each other entirely. The factor is then the mean over the parameters of the
    study whose nuisances are `solved`.
    """
    own, other = centre.likelihood, solved.likelihood
    if np.linalg.cond(own.unit_covariance) <= MAX_COVARIANCE_CONDITION:
        return own
    variance = float(np.mean(np.diag(other.robust_covariance) / np.diag(other.unit_covariance)))
    unit = np.eye(centre.u.size)
    return replace(own, unit_covariance=unit, covariance=variance * unit)


class StagedProgress:
    """Counts over stages, of which each says how much of it is done and foreseen."""

    def __init__(self, on_progress: Callable[[int, int], None], foreseen: Sequence[int]):
        self._on_progress = on_progress
        self._done, self._foreseen = [0] * len(foreseen), list(foreseen)

    def __call__(self, stage: int, done: int, foreseen: int) -> None:
        """Take in how much of a stage is done, and foreseen."""
        self._done[stage], self._foreseen[stage] = done, foreseen
        self._on_progress(sum(self._done), sum(self._foreseen))


def _write_sample(
    file: StudyFile,
    sample: Posterior,
    result: PosteriorResult,
    best: Mapping[str, float],
    units: Mapping[str, str],
    records: PredictedRecords,
    folder: Path,
) -> None:
    study = file.study
    write_posterior(folder / POSTERIOR, study.space, units, sample, predictive_groups(records, study.seed))
    write_ensemble(folder / ENSEMBLE, study.space, units, sample)
    with whole(folder / POSTERIOR_PICTURE) as temporary:
        temporary.write_bytes(png(posterior_figure(result, values_of(study.space, sample), best)))
    bands = bands_of_records(records)
    write_bands(bands, folder)
    with whole(folder / PREDICTIVE_PICTURE) as temporary:
        temporary.write_bytes(png(predictive_figure(bands)))
    forget_pieces(folder)
