"""How sure the calibrated values of a study are: profiles of the likelihood, in files of its folder."""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

from calib.confidence import profiled
from calib.confidence.document import ConfidenceResult
from calib.confidence.notes import NOTES, PointNotes
from calib.confidence.serialise import confidence_result
from calib.errors import CalibError, nearest
from calib.execution.files import whole
from calib.report.plots.profiles import profiles_figure
from calib.report.plots.style import png
from calib.store.lock import Lock
from calib.study import CalibrationStudy
from calib.study_file import StudyFile, load
from calib.workflows.calibrated import calibrated_values
from calib.workflows.evaluations import Evaluations

CONFIDENCE, CONFIDENCE_PICTURE = "confidence.json", "confidence.png"
STAGE = "profiles"
ALL = "all"
FORMAT_VERSION = 1  # of the points: those of another are forgotten


def confidence_study(
    path: str | Path,
    out: str | Path | None = None,
    *,
    pairs: Sequence[tuple[str, str]] | str = (),
    jobs: int | None = None,
    pool: Mapping[str, Any] | None = None,
    fresh: bool = False,
    on_stage: Callable[[str], None] = lambda text: None,
    on_progress: Callable[[int, int], None] = lambda done, foreseen: None,
) -> ConfidenceResult:
    """Profile the likelihood over each parameter of a calibrated study: `calib confidence` from Python.

    Writes confidence.json and confidence.png into the folder of the results. Each point is kept in confidence.jsonl as
    it ends: a run that was stopped or killed goes on with the same call, and finds what it would have found
    uninterrupted.

    Parameters
    ----------
    path : study file, or a folder with a study.toml; `calib run` must have found values
    out : folder of the results; None: the study's
    pairs : of parameters that are profiled together; "all" for every pair
    jobs : takes the place of the file's
    pool : keys of a [pool] table that takes the place of the file's
    fresh : forget the points made so far
    on_stage : called with what is being done
    on_progress : called with the number of points that are done, and of those that are foreseen

    Raises
    ------
    CalibError : a mistake in the study file or the pairs, or the study has not been calibrated
    """
    begin = time.monotonic()
    file = load(path, jobs=jobs, out=out, pool=pool)
    study, folder = file.study, file.folder
    chosen = _pairs(study, pairs)
    values = calibrated_values(file, folder)
    lock = Lock(folder, folder / NOTES)
    lock.acquire()
    try:
        if fresh:
            (folder / NOTES).unlink(missing_ok=True)
        result = _profiled(file, values, chosen, on_stage, on_progress, begin)
    finally:
        lock.release()
    _write(result, folder)
    return result


def read_confidence(folder: Path) -> ConfidenceResult | None:
    """Return what the confidence.json of a folder says, None where there is none.

    Raises
    ------
    CalibError : the file describes none
    """
    path = folder / CONFIDENCE
    if not path.is_file():
        return None
    try:
        return ConfidenceResult.from_dict(json.loads(path.read_text(encoding="utf-8")))
    except ValueError as error:
        raise CalibError(f"{path} holds no profiles ({error}); delete it and run `calib confidence` again") from error


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
        if (one, other) not in chosen and (other, one) not in chosen:
            chosen.append((one, other))
    return chosen


def _profiled(
    file: StudyFile,
    values: Mapping[str, float],
    pairs: Sequence[tuple[str, str]],
    on_stage: Callable[[str], None],
    on_progress: Callable[[int, int], None],
    begin: float,
) -> ConfidenceResult:
    study, folder = file.study, file.folder
    u = study.space.point(values)
    identity = [FORMAT_VERSION, study.header.definition, study.code, u.tolist()]
    on_stage("profiles")
    with PointNotes(folder / NOTES, identity) as notes, Evaluations(file, folder, on_stage) as evaluations:
        profiles = profiled(study, evaluations.calibrated(STAGE), u, notes, pairs=pairs, on_progress=on_progress)
        evaluated = notes.evaluations + profiles.analysis.confidence.evaluations
    units = {name: study.model.parameters[name.partition("@")[0]].unit for name in study.space.names}
    return confidence_result(study.name, study.space, units, profiles, evaluated, time.monotonic() - begin)


def _write(result: ConfidenceResult, folder: Path) -> None:
    with whole(folder / CONFIDENCE) as temporary:
        temporary.write_text(json.dumps(result.as_dict(), indent=2, allow_nan=False), encoding="utf-8")
    with whole(folder / CONFIDENCE_PICTURE) as temporary:
        temporary.write_bytes(png(profiles_figure(result)))
