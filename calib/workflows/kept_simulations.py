"""Simulations of a diagnosis that outlive its process: one that was stopped or killed goes on from them."""

from collections.abc import Callable

from calib.store.environment import environment
from calib.store.kept_results import KeptResults
from calib.study_file import StudyFile
from calib.units import count

SIMULATIONS_FORMAT_VERSION = 1  # of the simulations: those of another are run anew


def kept_simulations(file: StudyFile, name: str, on_stage: Callable[[str], None]) -> KeptResults:
    """Open a file of simulations in the folder of a study's results.

    They belong to the study, its code and that of its candidates, and to the environment. How many are known is said.

    Parameters
    ----------
    name : of the file
    on_stage : called with a text

    Raises
    ------
    CalibError : the file cannot be opened, or a candidate does not load
    """
    code = {**file.candidate_code(), **file.study.code}
    kept = KeptResults(
        file.folder / name, [SIMULATIONS_FORMAT_VERSION, file.study.header.definition, code, environment()]
    )
    if kept.known:
        on_stage(f"going on with {count(kept.known, 'simulation')} of a run that did not end")
    return kept
