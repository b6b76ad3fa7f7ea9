"""The search of a study for the force law that its model misses, and the files that say what was found."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from calib.diagnosis.discovery.artifacts import write_discovery
from calib.diagnosis.discovery.discover import discover
from calib.diagnosis.discovery.document import DiscoveryResult
from calib.diagnosis.discovery.serialise import discovery_result
from calib.diagnosis.effort import Budget
from calib.execution.files import whole
from calib.report.plots.found_force import found_force_figure
from calib.report.plots.style import png
from calib.study_file import load
from calib.workflows.calibrate import rebuild_file
from calib.workflows.calibrated import calibrated_values
from calib.workflows.found_effect import apply_force
from calib.workflows.kept_simulations import kept_simulations

FORCE_PICTURE = "discovery.png"
SIMULATIONS = "discovery.simulations"  # file of those of a search that did not end


def discover_study(
    path: str | Path,
    out: str | Path | None = None,
    *,
    seed: int | None = None,
    jobs: int | None = None,
    apply: bool = False,
    on_stage: Callable[[str], None] = lambda text: None,
    on_progress: Callable[[int, int], None] = lambda done, foreseen: None,
    budget: str | None = None,
    pool: Mapping[str, Any] | None = None,
) -> tuple[DiscoveryResult, Path | None]:
    """Search a calibrated study for the force that its model misses: `calib discover` from Python.

    Writes discovery.json and, where a force is found, discovery.png into the folder of the results, and draws
    report.html anew with the search in it. Simulations are kept as by `calib.workflows.diagnose.diagnose_study`.

    Parameters
    ----------
    path : study file, or a folder with a study.toml; `calib run` must have found values
    out : folder of the results; None: the study's
    seed : of the noise that is drawn; None: the study's
    jobs : takes the place of the file's
    apply : write the force as an effect file, effects/found_NAME.py, and study.found.toml with it beside the study
    on_stage : called with what is being done
    on_progress : called with the simulations that are done, and those that are foreseen in all
    budget : a number of simulations, or a time such as "10 min", after which no further fit begins; None: any
    pool : keys of a [pool] table that takes the place of the file's

    Returns
    -------
    what discovery.json says, and the path of the extended study (None where none was written)

    Raises
    ------
    CalibError : a mistake in the study file or the budget, or the study has not been calibrated
    """
    limit = Budget.of(budget)
    file = load(path, jobs=jobs, out=out, pool=pool)
    values = calibrated_values(file, file.folder)
    with kept_simulations(file, SIMULATIONS, on_stage) as kept:
        discovery = discover(
            file.study, file.others, values, file.suspects(), seed=file.study.seed if seed is None else seed,
            on_stage=on_stage, on_progress=on_progress, budget=limit, kept=kept,
        )  # fmt: skip
        result = write_discovery(discovery_result(discovery, values), file.folder)
        if not discovery.cut_short:
            kept.remove()
    figure = found_force_figure(result)
    if figure is None:
        (file.folder / FORCE_PICTURE).unlink(missing_ok=True)
    else:
        with whole(file.folder / FORCE_PICTURE) as temporary:
            temporary.write_bytes(png(figure))
    rebuild_file(file)
    return result, apply_force(file, discovery) if apply else None
