"""Root mean square error of every record of a study, at the values that `calib run` has found.

    calib run STUDY && python studies/rmse.py STUDY

The figure is that of public benchmarks: the simulated displacement against the measured one.
"""

import sys
from pathlib import Path

import numpy as np

from calib.errors import CalibError
from calib.modelling.parameter import values_for
from calib.study import result
from calib.study_file import load


def errors(study: Path, out: Path | None = None) -> dict[str, np.ndarray]:
    """Error (n,) [m] of the simulated displacement in each record, at the values in the folder `out` of the results."""
    file = load(study)
    folder = out or file.folder
    found = result.read(folder)
    if found is None:
        raise CalibError(f"{folder}: no result.json; run `calib run {study}` first")
    simulated = {}
    for name in [*file.study.objective.references, *file.others]:
        reference = file.reference(name)
        values = values_for({**file.study.space.fixed, **found.values}, name)
        run = file.study.model.run(values, reference.excitation, reference.request)
        measured = reference.record.displacement
        simulated[name] = (run.displacement.sel(body=measured.body).values - measured.values)[0]
    return simulated


if __name__ == "__main__":
    for study in sys.argv[1:]:
        for name, error in errors(Path(study)).items():
            print(f"{study} {name}: {1e3 * np.sqrt(np.mean(error**2)):.4g} mm, {error.size} samples")
