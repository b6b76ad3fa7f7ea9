"""The seeker: records and a study file are all it gets."""

from functools import partial
from pathlib import Path

from calib.diagnosis.diagnose import Diagnosis, diagnose
from calib.pool import InProcess
from calib.store import Store
from calib.study import evaluate
from calib.study_toml import load


def seek(folder: Path, without: tuple[str, ...] = (), only: tuple[str, ...] = ()) -> Diagnosis:
    """Calibrate the study in `folder`, and diagnose it in this process.

    without : effects that are taken out of the library
    only : effects that the library is reduced to, unless empty
    """
    file = load(folder)
    study = file.study
    found = study.run(Store(folder / "out"), InProcess(partial(evaluate, study.without_search())))
    values = {**study.space.fixed, **found.best.values}
    effects = [e for e in file.suspects() if e.name not in without and (not only or e.name in only)]
    return diagnose(study, file.others, values, effects, seed=study.seed, pool=InProcess)
