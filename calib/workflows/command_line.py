"""Command lines of calib that a user is told, as a shell takes them."""

import shlex
from pathlib import Path


def command_line(*words: str | Path) -> str:
    """Return `calib WORDS` for a POSIX shell: a path with a space in it is quoted."""
    return shlex.join(["calib", *map(str, words)])
