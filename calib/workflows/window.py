"""The admissible window of a calibrated study: its points evaluated, the files that say where it is."""

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from threadpoolctl import threadpool_limits

from calib.confidence.window.analyse import analysed
from calib.confidence.window.artifacts import WINDOW_DATA
from calib.confidence.window.dataset import window_dataset
from calib.confidence.window.design import start_points
from calib.confidence.window.document import WindowResult, write_window
from calib.confidence.window.exact import checked_faces, exact_curves, with_curves
from calib.confidence.window.margins import default_tolerance
from calib.confidence.window.motion import WindowEvaluation
from calib.confidence.window.run import explored
from calib.errors import CalibError, nearest
from calib.execution.files import whole
from calib.execution.netcdf import write_dataset
from calib.execution.workers import workers
from calib.report.plots.style import png
from calib.report.plots.window import window_figure
from calib.store import Store, Trial
from calib.study import result as calibration
from calib.study_file import StudyFile, load
from calib.units import count
from calib.workflows.calibrate import rebuild_file
from calib.workflows.calibrated import calibrated_values

WINDOW_PICTURE = "window.png"
WINDOW_FOLDER = "window"  # in that of the results: the ledger
DEFAULT_BUDGET = 300  # points
ALL_TERMS = ""  # the name of a tolerance that is that of every term


def window_study(
    path: str | Path,
    out: str | Path | None = None,
    *,
    budget: int = DEFAULT_BUDGET,
    tolerance: Mapping[str, float] | None = None,
    seed: int | None = None,
    jobs: int | None = None,
    pool: Mapping[str, Any] | None = None,
    fresh: bool = False,
    exact: bool = False,
    on_note: Callable[[str], None] = lambda text: None,
    on_point: Callable[[int, int], None] = lambda done, total: None,
    on_slice: Callable[[int, int], None] = lambda done, total: None,
) -> WindowResult:
    """Draw the window in which a calibrated study's model behaves as was measured: `calib window` from Python.

    A point is admissible where the motion is of the measured kind in all records, and the distance of each term is
    within its tolerance. Writes window.json, window.nc and window.png into the folder of the results, and draws
    report.html anew. Goes on with the points evaluated before, of a smaller budget too.

    Parameters
    ----------
    path : study file, or a folder with a study.toml; `calib run` must have found values
    out : folder of the results; None: the study's
    budget : points in all
    tolerance : term -> largest distance of an admissible point, "" for every term; of the others it is 5 %, or the
        square root of 2 times the calibrated distance where that is more
    seed : of the points and draws; None: the study's
    jobs : takes the place of the file's
    pool : keys of a [pool] table that takes the place of the file's
    fresh : forget the points evaluated so far
    exact : follow grazing, fold and flip curves over every slice, and hold the emulated boundary against them
    on_note : told what is going to be simulated
    on_point, on_slice : told the number that are done, and of all: of points, of slices with their curves

    Raises
    ------
    CalibError : a mistake in the study file, the study is not calibrated, an unknown term, or no window was found
    KeyboardInterrupt : stopped by Ctrl-C; the points evaluated until then are kept
    """
    begin, file = time.monotonic(), load(path, jobs=jobs, out=out, pool=pool)
    study, folder = file.study, file.folder
    start = study.space.point(calibrated_values(file, folder))
    tolerances, seed = _tolerances(file, folder, tolerance or {}), study.seed if seed is None else seed
    _check_budget(budget, study.space.dim)
    trials = _explored(file, start, tolerances, budget, seed, fresh, on_note, on_point)
    with threadpool_limits(1):
        result, region, sample, observed = analysed(study, trials, start, tolerances, seed, time.monotonic() - begin)
        dataset = window_dataset(study.space, list(result.units.values()), region, sample, observed, trials, start)
    _write(result, dataset, folder)
    try:
        if exact:  # the window is kept, whatever becomes of the curves
            curves, reasons = exact_curves(study, start, sample.low, sample.high, on_slice)
            dataset, faces = with_curves(dataset, curves), checked_faces(dataset, curves, reasons)
            result = replace(result, exact=faces, seconds=time.monotonic() - begin)
            _write(result, dataset, folder)
    finally:
        rebuild_file(file)
    return result


def _explored(
    file: StudyFile,
    start: np.ndarray,
    tolerances: Mapping[str, float],
    budget: int,
    seed: int,
    fresh: bool,
    on_note: Callable[[str], None],
    on_point: Callable[[int, int], None],
) -> list[Trial]:
    """Evaluate the points on the study's pool, into a ledger of their own; return those of before among them."""
    study = file.study

    def opened(done: int) -> None:
        over = count(study.space.dim, "parameter")
        on_note(f"window over {over}: {count(budget, 'point')}, {done} done before")
        on_point(done, budget)

    evaluation = WindowEvaluation(study.without_search())
    with workers(evaluation, study.evaluated_by, study.timeout, modules=study.code, on_note=on_note) as evaluations:
        store = Store(file.folder / WINDOW_FOLDER, view=None, keep="best")
        return explored(study, start, tolerances, budget, seed, store, evaluations, fresh, opened, on_point)


def _write(result: WindowResult, dataset: xr.Dataset, folder: Path) -> None:
    write_window(result, folder)
    write_dataset(dataset, folder / WINDOW_DATA)
    with whole(folder / WINDOW_PICTURE) as temporary:
        temporary.write_bytes(png(window_figure(result, dataset)))


def _check_budget(budget: int, dim: int) -> None:
    least = start_points(dim) + 1
    if budget < least:
        raise CalibError(f"--budget: expected at least {least} points for {count(dim, 'parameter')}, got {budget}")


def _tolerances(file: StudyFile, folder: Path, given: Mapping[str, float]) -> dict[str, float]:
    """Tolerance of each term: the one given, that of every term, or the default."""
    found = calibration.read(folder)
    distances = {} if found is None else found.score.terms
    labels = [term.label for term in file.study.objective.terms]
    for label, value in given.items():
        if label != ALL_TERMS and label not in labels:
            raise CalibError(f"--tolerance: no term {label!r}{nearest(label, labels)}; there are {', '.join(labels)}")
        if not value > 0.0:
            raise CalibError(f"--tolerance: expected a distance above 0, got {value:g}")
    return {
        label: given.get(label, given.get(ALL_TERMS, default_tolerance(distances.get(label) or 0.0)))
        for label in labels
    }
