"""The programs that the command lines of a study name, by which it is known what has made a record."""

import os
import re
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from calib.simulators.command.known_files import KnownFile, known_file, known_program, located
from calib.simulators.command.options import ProgramOptions
from calib.simulators.command.version import ProgramVersion, stated_version

# programs that run another one
LAUNCHERS = frozenset(("apptainer", "bash", "conda", "dash", "docker", "env", "julia", "mpiexec", "mpiexec.hydra",
    "mpirun", "nice", "nohup", "numactl", "octave", "orterun", "perl", "podman", "python", "python3", "setsid", "sh",
    "singularity", "srun", "stdbuf", "taskset", "time", "timeout", "wine", "xvfb-run", "zsh"))  # fmt: skip
SCRIPT_SUFFIXES = frozenset({".jl", ".m", ".pl", ".py", ".r", ".rb", ".sh"})  # of what such a one may be given
SCRIPT_BEGINS = b"#!"
PLACEHOLDER = re.compile(r"\{\{.*?\}\}|\{%.*?%\}")  # of a template


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
    found = [_Line(tuple(shlex.split(PLACEHOLDER.sub("{}", line))), given, search, study) for line in lines]
    named = dict.fromkeys(word for line in found for word in line.programs())
    if options.version is None:
        known = [_known(f"program {Path(word).name}", word, search) for word in named]
        return Programs(tuple(known), tuple(dict.fromkeys(remark for line in found for remark in line.remarks())))
    version = stated_version(options.version, str(study.resolve()))
    text = version.printed()
    if located(version.words[0], search) is not None:
        named[version.words[0]] = None
    name = f"program {Path(found[0].words[0]).name}"
    return Programs(tuple(_known(name, word, search, version, text) for word in named), ())


def _known(
    name: str, word: str, search: str | None, version: ProgramVersion | None = None, identity: str = ""
) -> KnownFile:
    """Return a program, or a script that a launcher is given."""
    path = Path(word)
    if _is_stated_script(path) and not os.access(path, os.X_OK):
        return replace(known_file(name, path, identity), version=version)
    return known_program(name, word, search, version, identity)


@dataclass(frozen=True)
class _Line:
    """The words of a command line, whose placeholders are "{}"; the rest as in `read_programs`."""

    words: tuple[str, ...]
    given: set[str]
    search: str | None
    study: Path

    def programs(self) -> Iterator[str]:
        """Yield the program, and those that it is given as arguments: paths, or names to be looked for on PATH."""
        if not self._is_open(self.words[0]):
            yield self.words[0]
        yield from self._arguments()

    def remarks(self) -> Iterator[str]:
        """Yield a remark where the line runs what its words do not name."""
        first, *others = self.words
        if self._is_open(first) or next(self._arguments(), None) is not None:
            return
        remedy = "state the command line of `version`, so that results of another one are told apart"
        path = located(first, self.search)
        if self._launches:
            if not any(str(PurePosixPath(word)) in self.given for word in others):
                yield f"{Path(first).name} runs a program that no word of {shlex.join(self.words)!r} names; {remedy}"
        elif path is not None and _is_script(path):
            yield f"{path.name} is a script: programs that it calls are no part of the identity of the study; {remedy}"

    def _arguments(self) -> Iterator[str]:
        for word in self.words[1:]:
            code = None if self._is_open(word) or word.startswith(("-", "/dev/")) else self._code(word)
            if code is not None:
                yield code

    def _code(self, word: str) -> str | None:
        """Return an argument that is a program: its path, or its name where a launcher looks for it on PATH."""
        path = self.study.resolve() / word
        if _is_stated_script(path) or (path.is_file() and os.access(path, os.X_OK)):
            return str(path)
        if self._launches and os.sep not in word and located(word, self.search) is not None:
            return word
        return None

    @property
    def _launches(self) -> bool:
        return Path(self.words[0]).name in LAUNCHERS

    def _is_open(self, word: str) -> bool:
        """Whether a word is a placeholder, or a file of the run folder."""
        return "{" in word or str(PurePosixPath(word)) in self.given


def _is_stated_script(path: Path) -> bool:
    return path.suffix.lower() in SCRIPT_SUFFIXES and path.is_file()


def _is_script(path: Path) -> bool:
    try:
        with open(path, "rb") as file:
            return file.read(len(SCRIPT_BEGINS)) == SCRIPT_BEGINS
    except OSError:
        return False
