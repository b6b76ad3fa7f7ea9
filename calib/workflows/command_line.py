"""Command lines of calib that a user is told, as a shell takes them."""

import shlex
from pathlib import Path

from calib.study_file import results_folder


def command_line(*words: str | Path) -> str:
    """Return `calib WORDS` for a POSIX shell: a path with a space in it is quoted."""
    return shlex.join(["calib", *map(str, words)])


def calibrating(study: Path, folder: Path, *flags: str) -> str:
    """Return the command line that calibrates a study file with its results in a folder, which is named if need be."""
    return command_line("run", study, *(() if folder == results_folder(study) else ("--out", folder)), *flags)
