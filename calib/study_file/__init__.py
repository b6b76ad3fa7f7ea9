"""study.toml -> CalibrationStudy: the only room where names become things; no logic."""

from calib.study_file.candidates import stated_candidates
from calib.study_file.folder import EXTENDED, FORCE_FOUND, base_path, extended_part, results_folder
from calib.study_file.load import StudyFile, load
from calib.study_file.mistakes import PythonOrigin, located, read_toml
from calib.study_file.schema import StudyToml

__all__ = [
    "EXTENDED",
    "FORCE_FOUND",
    "PythonOrigin",
    "StudyFile",
    "StudyToml",
    "base_path",
    "extended_part",
    "load",
    "located",
    "read_toml",
    "results_folder",
    "stated_candidates",
]
