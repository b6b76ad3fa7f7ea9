"""The files that a run folder is given, and the program that reads them, as a study states them."""

import hashlib
import shlex
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from calib.errors import CalibError
from calib.execution.files import checksum
from calib.simulators.command.options import ProgramOptions
from calib.simulators.command.templates import SUFFIX, TemplateText, rendered

MAX_TEMPLATE_BYTES = 64 * 2**20  # of one template
VERSION_TIMEOUT_S = 30.0  # s, for the command line that gives the version
MAX_VERSION_BYTES = 400  # of what it prints


@dataclass(frozen=True)
class CopiedFile:
    """A file that is copied into each run folder.

    Attributes
    ----------
    source : its path; as a text, since it crosses to child processes
    name : in the run folder
    sha256 : of its content
    stamp : its size [byte] and time of change [ns] when the study was read
    """

    source: str
    name: str
    sha256: str
    stamp: tuple[int, int]

    def copy(self, folder: Path) -> None:
        """Copy it, with its permissions.

        Raises
        ------
        CalibError : it has changed since the study was read
        """
        if _stamp(Path(self.source)) != self.stamp:
            raise CalibError(f"{self.source} has changed since the study was read; run the study again")
        target = folder / self.name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(self.source, target)


@dataclass(frozen=True)
class Inputs:
    """Templates, copied files and command lines.

    Attributes
    ----------
    templates : by the name of the file that each becomes
    copied : files
    lines : templates of the command lines, one a rung
    programs : path of each program that a line names -> its version, or SHA-256
    reader : module of a reader of one's own -> SHA-256 or version
    """

    templates: Mapping[str, TemplateText]
    copied: tuple[CopiedFile, ...]
    lines: tuple[TemplateText, ...]
    programs: Mapping[str, str]
    reader: Mapping[str, str] = field(default_factory=dict)

    @property
    def texts(self) -> list[TemplateText]:
        """All that is rendered."""
        return [*self.templates.values(), *self.lines]

    @property
    def code(self) -> dict[str, str]:
        """Identity of the files, programs and the reader, by name."""
        templates = {f"file {one.name}": f"sha256 {_digest(one.text.encode())}" for one in self.templates.values()}
        copied = {f"file {one.name}": f"sha256 {one.sha256}" for one in self.copied}
        return {**templates, **copied, **self.programs, **self.reader}

    def deck(self, values: Mapping[str, object]) -> "Deck":
        """Render everything.

        Raises
        ------
        CalibError : a template cannot be rendered at these values
        """
        files = {name: rendered(template, values).encode() for name, template in self.templates.items()}
        lines = [shlex.split(rendered(line, values)) for line in self.lines]
        if not all(lines):
            raise CalibError("run: a command line is empty at these values; mend its template")
        return Deck(files, self.copied, tuple(map(tuple, lines)))


@dataclass(frozen=True)
class Deck:
    """What one run is given: rendered files, copied files, and the words of its command lines."""

    files: Mapping[str, bytes]
    copied: tuple[CopiedFile, ...]
    lines: tuple[tuple[str, ...], ...]

    def write(self, folder: Path) -> None:
        """Write all files into a run folder.

        Raises
        ------
        CalibError : a copied file has changed since the study was read
        """
        for name, content in self.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        for file in self.copied:
            file.copy(folder)

    @property
    def digest(self) -> str:
        """SHA-256 of all that the program is given."""
        parts = [f"{name} {_digest(content)}" for name, content in sorted(self.files.items())]
        parts += [f"{file.name} {file.sha256}" for file in sorted(self.copied, key=lambda file: file.name)]
        parts += [shlex.join(line) for line in self.lines]
        return _digest("\n".join(parts).encode())


def read_inputs(options: ProgramOptions, study: Path) -> Inputs:
    """Read templates and files of a study, and find its programs.

    Parameters
    ----------
    study : folder to which paths are relative

    Raises
    ------
    CalibError : a file is missing, too large or no text; two have one name; a program is missing
    """
    templates, copied = dict[str, TemplateText](), list[CopiedFile]()
    for stated in options.template:
        path = _located(stated, study)
        name = PurePosixPath(stated).name
        target = name.removesuffix(SUFFIX)
        if target in templates or target in {file.name for file in copied}:
            raise CalibError(f"template: {stated}: a second file {target!r} in the run folder; rename one of them")
        if name.endswith(SUFFIX):
            templates[target] = TemplateText(name, _text(path))
        else:
            copied.append(CopiedFile(str(path), target, checksum(path), _stamp(path)))
    lines = tuple(TemplateText(f"run[{index}]", line) for index, line in enumerate(options.run))
    given = {*templates, *(file.name for file in copied)}
    resolved = [_resolved(line, given, study) for line in lines]
    programs = _versions(options, [shlex.split(line.text)[0] for line in resolved], given, study)
    return Inputs(templates, tuple(copied), tuple(resolved), programs)


def _located(stated: str, study: Path) -> Path:
    path = study / stated
    with suppress(OSError, ValueError):  # a name that none can have
        if path.is_file():
            return path.resolve()
    raise CalibError(f"template: {stated:.200}: no such file in {study}; mend the path, relative to the study file")


def _text(path: Path) -> str:
    if path.stat().st_size > MAX_TEMPLATE_BYTES:
        raise CalibError(
            f"template: {path}: expected at most {MAX_TEMPLATE_BYTES / 2**20:g} MiB to render, got "
            f"{path.stat().st_size / 2**20:.3g} MiB; move what does not vary to a file that is copied"
        )
    try:
        return path.read_bytes().decode("utf-8")
    except UnicodeDecodeError as error:
        raise CalibError(f"template: {path}: not a text in UTF-8 (byte {error.start}); save it as UTF-8") from error


def _resolved(line: TemplateText, given: set[str], study: Path) -> TemplateText:
    """Return the line with a relative path of its program made absolute, unless it is of the run folder."""
    program, rest = shlex.split(line.text)[0], line.text
    if "/" not in program or program.startswith("/") or str(PurePosixPath(program)) in given or "{" in program:
        return line
    start = rest.index(program)
    absolute = shlex.quote(str((study / program).resolve()))
    return TemplateText(line.name, rest[:start] + absolute + rest[start + len(program) :])


def _versions(options: ProgramOptions, names: Sequence[str], given: set[str], study: Path) -> dict[str, str]:
    """Version or SHA-256 of each program that is named.

    Raises
    ------
    CalibError : there is none of that name, or the command line of the version fails
    """
    programs = dict[str, str]()
    for name in dict.fromkeys(names):
        if "{" in name or str(PurePosixPath(name)) in given:
            continue  # a placeholder; a file that is known already
        path = shutil.which(name, path=options.environment.get("PATH"))
        if path is None:
            raise CalibError(
                f"run: there is no program {name!r} that can be executed; install it, put its folder on PATH, or state "
                "its path, relative to the study file"
            )
        if options.version is None:
            programs[f"program {Path(name).name}"] = f"sha256 {checksum(Path(path))}"
    if options.version is not None:
        programs[f"program {Path(names[0]).name}"] = _version(options.version, study)
    return programs


def _version(line: str, study: Path) -> str:
    """Return what a command line prints, in one line.

    Raises
    ------
    CalibError : it cannot be executed, takes too long, or prints nothing
    """
    words = shlex.split(line)
    if "/" in words[0] and not words[0].startswith("/"):
        words[0] = str((study / words[0]).resolve())
    try:
        done = subprocess.run(
            words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False,
            timeout=VERSION_TIMEOUT_S,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired) as error:
        raise CalibError(f"version: {line!r} gives no version ({error}); mend it, or leave it out") from error
    text = " ".join(done.stdout[:MAX_VERSION_BYTES].decode(errors="replace").split())
    if not text:
        raise CalibError(f"version: {line!r} prints nothing; mend it, or leave it out")
    return text


def _stamp(path: Path) -> tuple[int, int]:
    try:
        stat = path.stat()
    except OSError as error:
        raise CalibError(f"{path}: {error.strerror}; put the file back, or run the study again") from error
    return stat.st_size, stat.st_mtime_ns


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
