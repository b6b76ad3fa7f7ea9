"""The sensitivity of a study: its points evaluated, its indices, the files that say so."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from calib.errors import CalibError
from calib.execution.files import whole
from calib.report.plots.sensitivity import sensitivity_figure
from calib.report.plots.style import png
from calib.store import Store
from calib.study_file import load
from calib.sweep.sensitivity import MORRIS, SensitivityDesign, SensitivityResult, analyse, evaluated
from calib.sweep.sensitivity.design import DEFAULT_SAMPLES, DEFAULT_TRAJECTORIES, Method
from calib.sweep.sensitivity.document import write
from calib.units import count
from calib.workflows.evaluations import SEARCH, Evaluations

SENSITIVITY_PICTURE = "sensitivity.png"
SENSITIVITY_FOLDER = "sensitivity"  # in that of the results: a ledger for each method


def sensitivity_study(
    path: str | Path,
    out: str | Path | None = None,
    *,
    method: Method = MORRIS,
    trajectories: int | None = None,
    samples: int | None = None,
    seed: int | None = None,
    jobs: int | None = None,
    pool: Mapping[str, Any] | None = None,
    fresh: bool = False,
    on_note: Callable[[str], None] = lambda text: None,
    on_point: Callable[[int, int], None] = lambda done, total: None,
) -> SensitivityResult:
    """Say which parameter moves which feature of a study's motion: `calib sensitivity` from Python.

    Goes on with the points evaluated before, of fewer or more trajectories or samples too. Writes sensitivity.json and
    sensitivity.png into the folder of the results. Nothing has to be calibrated before.

    Parameters
    ----------
    path : study file, or a folder with a study.toml
    out : folder of the results; None: the study's
    method : "morris" (screening) or "sobol" (variance-based indices)
    trajectories : of Morris, each of one point more than there are parameters; None: 20
    samples : of Sobol, each of two points more than there are parameters, a power of two; None: 128
    seed : of the points and the bootstrap; None: the study's
    jobs : takes the place of the file's
    pool : keys of a [pool] table that takes the place of the file's
    fresh : forget the points evaluated so far
    on_note : told what is going to be simulated, before it is, and what else a user may want to know
    on_point : called with the number of points that are done, and of all

    Raises
    ------
    CalibError : a mistake in the study file or the method; SALib is not installed
    KeyboardInterrupt : stopped by Ctrl-C; the points evaluated until then are kept
    """
    file = load(path, jobs=jobs, out=out, pool=pool)
    study, folder = file.study, file.folder
    groups = _groups(method, trajectories, samples)
    design = SensitivityDesign(method, study.space.dim, groups, study.seed if seed is None else seed)
    records = len(study.objective.scored)

    def opened(done: int) -> None:
        over = count(design.dim, "parameter")
        of_each = "" if records == 1 else f" of {records} records each"
        what = f"{groups} {'trajectories' if method == MORRIS else 'base samples'} over {over}"
        left = count((design.size - done) * records, "simulation")
        on_note(f"{method}: {what}: {design.size} points{of_each}, {done} done before; {left} to come")
        on_point(done, design.size)

    store = Store(folder / SENSITIVITY_FOLDER / method, view=None, keep="best")
    with Evaluations(file, folder, on_note) as evaluations:
        trials = evaluated(study, design, store, evaluations.calibrated(SEARCH), fresh, opened, on_point)
    result = analyse(study, design, trials)
    write(result, folder)
    with whole(folder / SENSITIVITY_PICTURE) as temporary:
        temporary.write_bytes(png(sensitivity_figure(result)))
    return result


def _groups(method: Method, trajectories: int | None, samples: int | None) -> int:
    """Number of trajectories or base samples; the other one may not be stated."""
    own, other, default = trajectories, samples, DEFAULT_TRAJECTORIES
    if method != MORRIS:
        own, other, default = samples, trajectories, DEFAULT_SAMPLES
    if other is not None:
        wrong, right = ("samples", "trajectories") if method == MORRIS else ("trajectories", "samples")
        raise CalibError(f"the method {method!r} takes a number of {right}, not of {wrong}; state {right}")
    return default if own is None else own
