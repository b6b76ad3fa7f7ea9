"""How sure the calibrated values of a study are: profiles and posterior distribution, in files of its folder."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any

from calib.confidence import fitted, profiled
from calib.confidence.artifacts import write_confidence
from calib.confidence.document import ConfidenceResult
from calib.confidence.instrument import unused_uncertainties
from calib.confidence.notes import NOTES, PointNotes
from calib.confidence.posterior import expected_evaluations
from calib.confidence.profiles import without_profiles
from calib.confidence.sampler_package import nautilus
from calib.confidence.serialise import confidence_result
from calib.errors import CalibError, nearest
from calib.execution.files import whole
from calib.report.plots.profiles import profiles_figure
from calib.report.plots.style import png
from calib.store.lock import Lock
from calib.study import CalibrationStudy
from calib.study_file import StudyFile, load
from calib.workflows.calibrate import rebuild_file
from calib.workflows.calibrated import calibrated_values
from calib.workflows.evaluations import Evaluations
from calib.workflows.model_comparison import (
    CONFIDENCE_STAGE,
    OpenModel,
    check_comparable,
    compared_models,
    expected_comparison,
    identity_of_points,
)
from calib.workflows.posterior import (
    NUISANCE_NOTES,
    StagedProgress,
    posterior_of,
    with_earlier,
    with_nuisances,
    without_earlier,
)
from calib.workflows.predictive import predicted_simulations

CONFIDENCE_PICTURE = "confidence.png"
ALL = "all"


def confidence_study(
    path: str | Path,
    out: str | Path | None = None,
    *,
    pairs: Sequence[tuple[str, str]] | str = (),
    only_posterior: bool = False,
    posterior: bool = False,
    sample_nuisances: bool = False,
    compare: Sequence[str | Path] = (),
    jobs: int | None = None,
    pool: Mapping[str, Any] | None = None,
    fresh: bool = False,
    on_stage: Callable[[str], None] = lambda text: None,
    on_progress: Callable[[int, int], None] = lambda done, foreseen: None,
) -> ConfidenceResult:
    """Profile the likelihood over each parameter of a calibrated study: `calib confidence` from Python.

    Writes confidence.json and confidence.png into the folder of the results, and draws report.html anew. A run that was
    stopped or killed goes on with the same call, to the same end. With `posterior`, the posterior distribution goes
    into posterior.nc, posterior.png and ensemble.csv, what it predicts into predictive.nc and predictive.png.

    Parameters
    ----------
    path : study file, or a folder with a study.toml; `calib run` must have found values
    out : folder of the results; None: the study's
    pairs : of parameters that are profiled together; "all" for every pair
    posterior, only_posterior : whether the posterior distribution is sampled, beside profiles or without them
    sample_nuisances : whether it is sampled over scale, shear and offset too; see `calib.confidence.instrument`
    compare : files of calibrated studies of the same records with other models, whose evidence is compared
    jobs, pool : take the place of the file's; of the pool, keys of a [pool] table
    fresh : forget the points made so far
    on_stage : called with what is being done
    on_progress : called with the number of evaluations that are done, and of those that are foreseen

    Raises
    ------
    CalibError : a mistake in the study file or the pairs, a study without calibration, or no sampler is installed
    """
    posterior = posterior or only_posterior
    _check_sampling(posterior, only_posterior and bool(pairs), sample_nuisances, compare)
    begin = time.monotonic()
    file = load(path, jobs=jobs, out=out, pool=pool)
    study, folder = file.study, file.folder
    chosen = _pairs(study, pairs)
    others = [load(other, jobs=jobs, pool=pool) for other in compare]
    check_comparable(file, others)
    values = calibrated_values(file, folder)
    with _locked(folder, fresh):
        result = _found(
            file, values, chosen, not only_posterior, posterior, sample_nuisances, others, on_stage, on_progress, begin
        )
    _write(result, folder)
    rebuild_file(file)
    return result


@contextmanager
def _locked(folder: Path, fresh: bool) -> Iterator[None]:
    """Hold the lock of the notes in a folder; forget them first where the points made so far are unwanted."""
    lock = Lock(folder, folder / NOTES)
    lock.acquire()
    try:
        if fresh:
            for notes in (NOTES, NUISANCE_NOTES):
                (folder / notes).unlink(missing_ok=True)
        yield
    finally:
        lock.release()


def _check_sampling(
    posterior: bool, pairs_without_profiles: bool, sample_nuisances: bool, compare: Sequence[str | Path]
) -> None:
    if pairs_without_profiles:
        raise CalibError("--pairs are profiles: leave them out, or give --posterior in place of --only-posterior")
    if posterior or compare:
        nautilus()
    if sample_nuisances and not posterior:
        raise CalibError("--sample-nuisances is of the posterior distribution: give --posterior too")


def pairs_of(text: str) -> Sequence[tuple[str, str]] | str:
    """Read A,B or "all" of an option.

    Raises
    ------
    CalibError : neither
    """
    names = [name.strip() for name in text.split(",")]
    if names == [ALL]:
        return ALL
    if len(names) != 2 or not all(names):
        raise CalibError(f"--pairs: expected two parameters, such as A,B, or all, got {text!r}")
    return [(names[0], names[1])]


def _pairs(study: CalibrationStudy, pairs: Sequence[tuple[str, str]] | str) -> list[tuple[str, str]]:
    names = study.space.names
    if isinstance(pairs, str):
        if pairs != ALL:
            raise CalibError(f'pairs: expected pairs of parameters, or "all", got {pairs!r}')
        return list(combinations(names, 2))
    chosen = []
    for one, other in pairs:
        for name in (one, other):
            if name not in names:
                raise CalibError(
                    f"pairs: no parameter {name!r} is searched{nearest(name, names)}; those are {', '.join(names)}"
                )
        if one == other:
            raise CalibError(f"pairs: expected two different parameters, got {one!r} twice")
        pair = (one, other) if names.index(one) < names.index(other) else (other, one)  # its points are kept by it
        if pair not in chosen:
            chosen.append(pair)
    return chosen


def _found(
    file: StudyFile,
    values: Mapping[str, float],
    pairs: Sequence[tuple[str, str]],
    profiling: bool,
    posterior: bool,
    nuisances: bool,
    others: Sequence[StudyFile],
    on_stage: Callable[[str], None],
    on_progress: Callable[[int, int], None],
    begin: float,
) -> ConfidenceResult:
    study, folder = file.study, file.folder
    u = study.space.point(values)
    units = {name: study.model.parameters[name.partition("@")[0]].unit for name in study.space.names}
    foreseen = expected_evaluations(study.space.dim) + predicted_simulations(file) if posterior else 0
    progress = StagedProgress(on_progress, [0, foreseen, expected_comparison(others, study.space.dim)])

    with (
        PointNotes(folder / NOTES, identity_of_points(study, u)) as notes,
        Evaluations(file, folder, on_stage) as evaluations,
    ):
        pool = evaluations.calibrated(CONFIDENCE_STAGE)
        if profiling:
            on_stage("profiles")
            profiles = profiled(study, pool, u, notes, pairs=pairs, on_progress=partial(progress, 0))
        else:
            on_stage("best point")
            profiles = without_profiles(*fitted(study, pool, u, notes), u)
        evaluated = notes.evaluations + profiles.analysis.confidence.evaluations
        result = confidence_result(study.name, study.space, units, profiles, evaluated, time.monotonic() - begin)
        own = OpenModel(file, evaluations, notes, profiles.analysis, profiles.centre)
        if posterior:
            sample = with_nuisances if nuisances else posterior_of
            distribution = sample(own, folder, on_stage, partial(progress, 1))
            remarks = result.remarks if nuisances else (*result.remarks, *unused_uncertainties(study))
            result = replace(result, posterior=distribution, remarks=remarks, seconds=time.monotonic() - begin)
        if others:
            comparison = compared_models(own, others, on_stage, partial(progress, 2))
            result = replace(result, comparison=comparison, seconds=time.monotonic() - begin)
        return with_earlier(result, file, folder) if notes.known else without_earlier(result, folder)


def _write(result: ConfidenceResult, folder: Path) -> None:
    write_confidence(result, folder)
    if not result.profiles:
        (folder / CONFIDENCE_PICTURE).unlink(missing_ok=True)
        return
    with whole(folder / CONFIDENCE_PICTURE) as temporary:
        temporary.write_bytes(png(profiles_figure(result)))
