"""The seeker: records and a study file are all it gets."""

from functools import partial
from pathlib import Path

from calib.diagnosis.diagnose import Diagnosis, diagnose
from calib.execution.pool import InProcess
from calib.store import Store
from calib.study import evaluate
from calib.study_file import load


def seek(
    folder: Path, without: tuple[str, ...] = (), only: tuple[str, ...] = (), next_measurement: bool = False
) -> Diagnosis:
    """Calibrate the study in `folder`, and diagnose it in this process.

    without : effects that are taken out of the library, and those that contain them with them
    only : effects that the library is reduced to, unless empty
    next_measurement : whether it is sought, where several causes are left
    """
    file = load(folder)
    study = file.study
    found = study.run(Store(folder / "out"), InProcess(partial(evaluate, study.without_search())))
    values = {**study.space.fixed, **found.best.values}
    kept = [e for e in file.suspects() if not {e.name, *e.generalises} & set(without)]
    effects = [e for e in kept if not only or e.name in only]
    laboratory = file.laboratory if next_measurement else None
    return diagnose(study, file.others, values, effects, seed=study.seed, pool=InProcess, laboratory=laboratory)
