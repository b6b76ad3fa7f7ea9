"""The programs that the command lines of a study name, by which it is known what has made a record."""

import os
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from calib.simulators.command.known_files import KnownFile, known_file, known_program, located
from calib.simulators.command.options import ProgramOptions
from calib.simulators.command.version import stated_version

LAUNCHERS = frozenset(
    (
        "apptainer",
        "bash",
        "conda",
        "dash",
        "docker",
        "env",
        "julia",
        "mpiexec",
        "mpiexec.hydra",
        "mpirun",
        "nice",
        "nohup",
        "numactl",
        "octave",
        "orterun",
        "perl",
        "podman",
        "python",
        "python3",
        "setsid",
        "sh",
        "singularity",
        "srun",
        "stdbuf",
        "taskset",
        "time",
        "timeout",
        "wine",
        "xvfb-run",
        "zsh",
    )
)  # fmt: skip - programs that run another one
SCRIPT_SUFFIXES = frozenset({".jl", ".m", ".pl", ".py", ".r", ".rb", ".sh"})  # of what such a one may be given
SCRIPT_BEGINS = b"#!"


@dataclass(frozen=True)
class Programs:
    """The programs of all command lines.

    Attributes
    ----------
    known : files of programs, each with its identity
    remarks : on programs whose identity does not tell what they run
    """

    known: tuple[KnownFile, ...]
    remarks: tuple[str, ...]


def read_programs(options: ProgramOptions, lines: Sequence[str], given: set[str], study: Path) -> Programs:
    """Find the programs of command lines.

    Their identity is their SHA-256 or, for all together, what the command line of the version prints.

    Parameters
    ----------
    given : names of the files of the run folder, which are known already
    study : folder to which paths are relative

    Raises
    ------
    CalibError : there is none of that name, or the command line of the version fails
    """
    search = options.environment.get("PATH")
    words = [shlex.split(line) for line in lines]
    named = [word for line in words for word in _named(line, given, search)]
    if options.version is None:
        known = [_known(word, search) for word in dict.fromkeys(named)]
        remarks = tuple(dict.fromkeys(remark for line in words for remark in _hidden(line, given, search)))
        return Programs(tuple(known), remarks)
    version = stated_version(options.version, str(study.resolve()))
    text = version.printed()
    name = f"program {Path(words[0][0]).name}"
    every = [*named, *([version.words[0]] if located(version.words[0], search) else [])]
    return Programs(tuple(known_program(name, word, search, version, text) for word in dict.fromkeys(every)), ())


def _known(word: str, search: str | None) -> KnownFile:
    """Return a program, or a script that a launcher is given."""
    path = Path(word)
    if _is_stated_script(path) and not os.access(path, os.X_OK):
        return known_file(f"program {path.name}", path)
    return known_program(f"program {path.name}", word, search)


def _is_stated_script(path: Path) -> bool:
    return path.is_absolute() and path.suffix.lower() in SCRIPT_SUFFIXES and path.is_file()


def _named(line: Sequence[str], given: set[str], search: str | None) -> Iterator[str]:
    """Yield the program of a command line, and those that it is given as arguments."""
    first, *others = line
    if not _is_open(first, given):
        yield first
    for word in others:
        if not _is_open(word, given) and _is_code(word, _launches(first), search):
            yield word


def _is_open(word: str, given: set[str]) -> bool:
    """Whether a word is a placeholder, or a file of the run folder."""
    return "{" in word or str(PurePosixPath(word)) in given


def _launches(word: str) -> bool:
    return Path(word).name in LAUNCHERS


def _is_code(word: str, launched: bool, search: str | None) -> bool:
    """Whether an argument is a program; names are looked for on PATH where it may be `launched`."""
    if word.startswith(("-", "/dev/")):
        return False
    path = Path(word)
    if path.is_absolute():
        return _is_stated_script(path) or (path.is_file() and os.access(path, os.X_OK))
    return launched and os.sep not in word and located(word, search) is not None


def _hidden(line: Sequence[str], given: set[str], search: str | None) -> Iterator[str]:
    """Yield a remark where a command line runs what its words do not name."""
    first, *others = line
    if _is_open(first, given):
        return
    remedy = "state the command line of `version`, so that results of another one are told apart"
    path = located(first, search)
    if _launches(first):
        if not any(str(PurePosixPath(word)) in given or _is_code(word, True, search) for word in others):
            yield f"{Path(first).name} runs a program that no word of {shlex.join(line)!r} names; {remedy}"
    elif path is not None and _is_script(path):
        yield f"{path.name} is a script: programs that it calls are no part of the identity of the study; {remedy}"


def _is_script(path: Path) -> bool:
    try:
        with open(path, "rb") as file:
            return file.read(len(SCRIPT_BEGINS)) == SCRIPT_BEGINS
    except OSError:
        return False
