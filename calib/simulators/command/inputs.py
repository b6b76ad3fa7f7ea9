"""The files that a run folder is given, and the program that reads them, as a study states them."""

import hashlib
import shlex
import shutil
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from calib.errors import CalibError
from calib.simulators.command.known_files import KnownFile, known_file
from calib.simulators.command.options import ProgramOptions
from calib.simulators.command.programs import Programs, read_programs
from calib.simulators.command.templates import SUFFIX, TemplateText, rendered

MAX_TEMPLATE_BYTES = 64 * 2**20  # of one template


@dataclass(frozen=True)
class CopiedFile:
    """A file that is copied into each run folder.

    Attributes
    ----------
    source : as it was when the study was read
    name : in the run folder
    """

    source: KnownFile
    name: str

    def copy(self, folder: Path) -> None:
        """Copy it, with its permissions."""
        target = folder / self.name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(self.source.path, target)


@dataclass(frozen=True)
class Inputs:
    """Templates, copied files and command lines.

    Attributes
    ----------
    templates : by the name of the file that each becomes
    copied : files
    lines : templates of the command lines, one a rung
    programs : that the lines name
    reader : files of a reader of one's own
    versions : distribution that has installed such a reader -> its version
    """

    templates: Mapping[str, TemplateText]
    copied: tuple[CopiedFile, ...]
    lines: tuple[TemplateText, ...]
    programs: Programs
    reader: tuple[KnownFile, ...] = ()
    versions: Mapping[str, str] = field(default_factory=dict)

    @property
    def texts(self) -> list[TemplateText]:
        """All that is rendered."""
        return [*self.templates.values(), *self.lines]

    @property
    def code(self) -> dict[str, str]:
        """Identity of the files, programs and the reader, by name."""
        templates = {f"file {one.name}": f"sha256 {_digest(one.text.encode())}" for one in self.templates.values()}
        known: dict[str, str] = {}
        for one in self._known:
            others = [text for text in (known.get(one.name),) if text not in (None, one.identity)]
            known[one.name] = ", ".join([*others, one.identity])
        return {**templates, **known, **self.versions}

    @property
    def _known(self) -> list[KnownFile]:
        return [*(one.source for one in self.copied), *self.programs.known, *self.reader]

    def check(self) -> None:
        """Compare all files that are used again by each run with what they were; templates are held in memory.

        Raises
        ------
        CodeChanged : one has changed since the study was read
        """
        for one in self._known:
            one.check()

    def deck(self, values: Mapping[str, object]) -> "Deck":
        """Render everything.

        Raises
        ------
        CalibError : a template cannot be rendered at these values
        """
        texts = rendered(self.texts, values)
        files = {name: text.encode() for name, text in zip(self.templates, texts, strict=False)}
        lines = [shlex.split(text) for text in texts[len(self.templates) :]]
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
        """Write all files into a run folder."""
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
        parts += [f"{file.name} {file.source.identity}" for file in sorted(self.copied, key=lambda file: file.name)]
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
            copied.append(CopiedFile(known_file(f"file {target}", path), target))
    lines = tuple(TemplateText(f"run[{index}]", line) for index, line in enumerate(options.run))
    given = {*templates, *(file.name for file in copied)}
    resolved = [_resolved(line, given, study) for line in lines]
    programs = read_programs(options, [line.text for line in resolved], given, study)
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


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
