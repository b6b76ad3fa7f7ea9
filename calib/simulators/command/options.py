"""Options of the simulator `command`: flat in a study file, here sorted by what they are about."""

import inspect
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from pathlib import PurePosixPath
from typing import Any, Literal, TypeVar, get_args

from calib.errors import CalibError, nearest
from calib.records import CHANNELS
from calib.records.text_pattern import text_pattern
from calib.units import is_si, to_si

KeepFolders = Literal["none", "failed", "best", "all"]
MAX_NAME_CHARACTERS = 200  # of an output file
DEFAULT_SETTLE_PERIODS = 0  # periods dropped where neither study nor option says how many


@dataclass(frozen=True)
class ProgramOptions:
    """The program, and what it is given.

    Attributes
    ----------
    template : files, relative to the study file, that each run folder is given: those that end in ".j2" are rendered
        and lose this ending, all others are copied
    run : command lines, run without a shell in the run folder: the second where the first fails, and so on; they are
        rendered as templates are
    parameters : name -> nominal value with its unit, or a table of nominal, low, high, null and meaning
    cores : cores that one run uses: what `cores` is in templates, and the number of threads of OpenMP and BLAS
    environment : variables of the program's environment, added to those of `calib`
    version : command line whose output is the version of the program; without it the file of the program is known by
        its SHA-256
    folder : to which paths of files and programs are relative; without it that of the study file, or of a study in
        Python the working folder
    """

    template: Sequence[str] = ()
    run: Sequence[str] = ()
    parameters: Mapping[str, Any] = field(default_factory=dict)
    cores: int = 1
    environment: Mapping[str, str] = field(default_factory=dict)
    version: str | None = None
    folder: str | None = None

    def __post_init__(self) -> None:
        """Refuse what is no list of files or command lines."""
        object.__setattr__(self, "template", _texts("template", self.template, '["deck.inp.j2", "mesh.inc"]'))
        object.__setattr__(self, "run", _texts("run", self.run, '["ccx -i deck"]'))
        if not self.run:
            raise CalibError('run: expected one command line at least, such as run = ["ccx -i deck"]')
        for line in self.run:
            _check_line("run", line)
        for name in ("version", "folder"):
            if not isinstance(getattr(self, name), str | None):
                raise CalibError(f"{name}: expected a text, got {getattr(self, name)!r:.60}")
        if self.version is not None:
            _check_line("version", self.version)
        if isinstance(self.cores, bool) or not isinstance(self.cores, int) or self.cores < 1:
            raise CalibError(f"cores: expected a whole number from 1 on, got {self.cores!r}")
        for name, value in _table("environment", self.environment).items():
            if not isinstance(value, str) or "\0" in value or "=" in name or "\0" in name or not name:
                raise CalibError(f'environment: {name}: expected a text such as "2", got {value!r:.60}')


@dataclass(frozen=True)
class ReadingOptions:
    """What is read from the output of the program.

    Attributes
    ----------
    read : table of `reader` (a name, or "module:function"), `file` (or a list of one for each command line), `time`
        (column and unit; without it the reader's own, in seconds), `bodies` (body -> column of its displacement in
        metres, or a table of channels, each with column and unit), and further options of the reader
    prescribed : channels that the excitation prescribes, as "body.channel"
    drives : quantity of an excitation -> place, or places, at which the templates apply it; without it any is taken
    settle : periods that are dropped first, where the study does not say how many
    """

    read: Mapping[str, Any] = field(default_factory=dict)
    prescribed: Sequence[str] = ()
    drives: Mapping[str, str | Sequence[str]] | None = None
    settle: int = DEFAULT_SETTLE_PERIODS

    def __post_init__(self) -> None:
        """Refuse a table that lacks something, or has too much."""
        object.__setattr__(self, "prescribed", _texts("prescribed", self.prescribed, '["base.displacement"]'))
        if isinstance(self.settle, bool) or not isinstance(self.settle, int) or self.settle < 0:
            raise CalibError(f"settle: expected a whole number from 0 on, got {self.settle!r}")
        known = {f"{body}.{channel.name}" for body, own in self.reading.channels.items() for channel in own}
        for one in self.prescribed:
            if one not in known:
                raise CalibError(f"prescribed: {one!r} is not read{nearest(one, known)}; read are {', '.join(known)}")
        for quantity, places in _table("drives", {} if self.drives is None else self.drives).items():
            _texts(f"drives: {quantity}", places, '"tip"')

    @property
    def reading(self) -> "OutputReading":
        """The table `read`, checked."""
        return OutputReading.of(self.read)

    @property
    def excitations(self) -> frozenset[tuple[str, str]] | None:
        """Pairs of quantity and place that are taken; None: all."""
        if self.drives is None:
            return None
        return frozenset(
            (quantity, place) for quantity, places in self.drives.items() for place in _texts("drives", places, "")
        )


@dataclass(frozen=True)
class KeepingOptions:
    """When a run is given up, and what is left of it.

    Attributes
    ----------
    keep : run folders that are kept: "none", "failed" (default, the last 50), "best" (those of the final evaluation) or
        "all"
    cache : whether the same inputs are answered by what the same program gave before
    fail_if : texts in the output by which a run has failed, whatever its exit code; "/.../" is a regular expression
    inactivity : time without output, to the log or to a file of the run folder, after which a run is given up
    """

    keep: KeepFolders = "failed"
    cache: bool = True
    fail_if: str | Sequence[str] = ()
    inactivity: str | float | None = None

    def __post_init__(self) -> None:
        """Refuse what is none of the choices."""
        if self.keep not in get_args(KeepFolders):
            known = get_args(KeepFolders)
            raise CalibError(
                f"keep: expected one of {', '.join(known)}, got {self.keep!r}{nearest(str(self.keep), known)}"
            )
        if not isinstance(self.cache, bool):
            raise CalibError(f"cache: expected true or false, got {self.cache!r}")
        object.__setattr__(self, "fail_if", _texts("fail_if", self.fail_if, '"ERROR"'))
        _ = self.patterns
        if self.inactivity is not None and not self.inactivity_seconds > 0.0:
            raise CalibError(f"inactivity: expected a time above 0 s, got {self.inactivity!r}")

    @property
    def patterns(self) -> tuple[re.Pattern[str], ...]:
        """What the output must not match."""
        try:
            return tuple(text_pattern(text) for text in self.fail_if)
        except CalibError as error:
            raise CalibError(f"fail_if: {error}") from error

    @property
    def inactivity_seconds(self) -> float:
        """The limit of inactivity [s]; infinite without one."""
        return float("inf") if self.inactivity is None else to_si(self.inactivity, "s")


@dataclass(frozen=True)
class ReadChannel:
    """A channel of a body in the output.

    Attributes
    ----------
    name : of the channel, such as "displacement"
    column : of the output
    unit : of the numbers in it
    si : unit of the channel in a record
    """

    name: str
    column: str
    unit: str
    si: str

    @property
    def factor(self) -> float:
        """Factor from the numbers of the output to SI."""
        return to_si(f"1 {self.unit}", self.si) if self.unit not in ("", "1") else 1.0


@dataclass(frozen=True)
class OutputReading:
    """The table `read`.

    Attributes
    ----------
    reader, file : name of the reader; file of the run folder that it reads
    files : that file of each command line, where they write files of other names; else empty
    time_factor : from the time of the output to seconds
    channels : body -> its channels; all bodies have the same ones
    options : of the reader, its column of time among them where one is stated
    """

    reader: str
    file: str
    files: tuple[str, ...]
    time_factor: float
    channels: Mapping[str, tuple[ReadChannel, ...]]
    options: Mapping[str, Any]

    def of_rung(self, rung: int) -> "OutputReading":
        """Return the same for the file of a command line, counted from 1."""
        return replace(self, file=self.files[rung - 1]) if self.files else self

    @classmethod
    def of(cls, stated: Mapping[str, Any]) -> "OutputReading":
        """Check the table.

        Raises
        ------
        CalibError : what is missing or of another kind, with its key
        """
        stated = _table("read", stated)
        for key, example in (("reader", '"delimited"'), ("file", '"out.csv"'), ("bodies", '{ tip = "u_tip" }')):
            if key not in stated:
                raise CalibError(f"read: {key} is missing, as in read = {{ {key} = {example}, ... }}")
        if not isinstance(stated["reader"], str) or not stated["reader"]:
            raise CalibError(f"read: reader: expected a text, got {stated['reader']!r:.60}")
        files = _texts("read: file", stated["file"], '"out.csv", or one for each command line')
        if not files:
            raise CalibError('read: file: expected a name such as "out.csv", or one for each command line; got none')
        for file in files:
            path = PurePosixPath(file)
            if path.is_absolute() or ".." in path.parts or "\0" in file or len(file) > MAX_NAME_CHARACTERS:
                raise CalibError(f"read: file: expected a file of the run folder, got {file!r:.80}")
        bodies = _table("read: bodies", stated["bodies"])
        if not bodies:
            raise CalibError('read: bodies: expected one body at least, as in { tip = "u_tip" }')
        channels = {body: _channels(f"read: bodies: {body}", entry) for body, entry in bodies.items()}
        first, *others = channels
        for other in others:
            unlike = {one.name for one in channels[first]} ^ {one.name for one in channels[other]}
            if unlike:
                raise CalibError(
                    f"read: bodies: {', '.join(sorted(unlike))} is read of one of {first!r} and {other!r} only; read "
                    "the same channels of all bodies"
                )
        options = {key: value for key, value in stated.items() if key not in ("reader", "file", "bodies", "time")}
        column, factor = _time(stated.get("time", {"unit": "s"}))
        if column is not None:
            options["time"] = column
        each = () if isinstance(stated["file"], str) else files
        return cls(stated["reader"], files[0], each, factor, channels, options)


def _time(stated: Any) -> tuple[str | int | None, float]:
    """Column of time, None for the reader's own choice, and the factor from its numbers to seconds."""
    table = {"column": stated} if isinstance(stated, str | int) else stated
    if not isinstance(table, Mapping) or not set(table) <= {"column", "unit"}:
        raise CalibError(
            f'read: time: expected {{ column = "time", unit = "s" }}, or one of the two, got {stated!r:.80}'
        )
    column, unit = table.get("column"), table.get("unit", "s")
    if isinstance(column, bool) or not isinstance(column, str | int | None) or not isinstance(unit, str):
        raise CalibError(f"read: time: expected a column and the text of a unit, got {column!r:.40} and {unit!r:.40}")
    try:
        return column, to_si(f"1 {unit}", "s")
    except CalibError as error:
        raise CalibError(f"read: time: {error}") from error


def _channels(where: str, stated: Any) -> tuple[ReadChannel, ...]:
    if isinstance(stated, str):
        stated = {"displacement": {"column": stated, "unit": "m"}}
    if not isinstance(stated, Mapping) or not stated:
        raise CalibError(
            f"{where}: expected the column of its displacement in metres, or a table such as {{ displacement = "
            f'{{ column = "u", unit = "mm" }} }}, got {stated!r:.60}'
        )
    return tuple(_channel(f"{where}: {name}", name, entry, CHANNELS.get(name)) for name, entry in stated.items())


def _channel(where: str, name: str, stated: Any, si: str | None) -> ReadChannel:
    if isinstance(stated, str) and si is not None:
        stated = {"column": stated, "unit": si}
    if not isinstance(stated, Mapping) or set(stated) != {"column", "unit"}:
        raise CalibError(f'{where}: expected {{ column = "...", unit = "{si or "V"}" }}, got {stated!r:.80}')
    column, unit = stated["column"], stated["unit"]
    if not isinstance(column, str) or not isinstance(unit, str):
        raise CalibError(f"{where}: expected texts for column and unit, got {column!r:.40} and {unit!r:.40}")
    try:
        if si is None and not is_si(unit):
            raise CalibError(
                f"{name} is none of {', '.join(CHANNELS)}, so its unit is one of SI without a factor, got {unit!r}"
            )
        channel = ReadChannel(name, column, unit, unit if si is None else si)
        _ = channel.factor
    except CalibError as error:
        raise CalibError(f"{where}: {error}") from error
    return channel


def _texts(name: str, value: Any, example: str) -> tuple[str, ...]:
    """Return a text, or a list of texts, as a tuple."""
    texts = (value,) if isinstance(value, str) else value
    if not isinstance(texts, Sequence) or not all(isinstance(text, str) and text for text in texts):
        raise CalibError(f"{name}: expected a list of texts, such as {example}, got {value!r:.60}")
    return tuple(texts)


def _table(name: str, value: Any) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise CalibError(f"{name}: expected a table, got {value!r:.60}")
    return value


def _check_line(name: str, line: str) -> None:
    try:
        words = shlex.split(line)
    except ValueError as error:
        raise CalibError(f"{name}: {line!r} is no command line ({error}); close its quotation marks") from error
    if not words or "\0" in line:
        raise CalibError(f'{name}: expected a command line such as "ccx -i deck", got {line!r}')


GROUPS = (ProgramOptions, ReadingOptions, KeepingOptions)
OptionGroup = TypeVar("OptionGroup", ProgramOptions, ReadingOptions, KeepingOptions)


@dataclass(frozen=True)
class CommandOptions:
    """All options of the simulator, in groups."""

    program: ProgramOptions
    reading: ReadingOptions
    keeping: KeepingOptions

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> "CommandOptions":
        """Sort flat options.

        Raises
        ------
        CalibError : an option that is unknown or cannot be
        """
        known = list(SIGNATURE.parameters)
        for name in options:
            if name not in known:
                raise CalibError(
                    f"unknown option {name!r} of 'command'{nearest(name, known)}; it takes {', '.join(known)}"
                )
        program, reading = _of_options(ProgramOptions, options), _of_options(ReadingOptions, options)
        files = reading.reading.files
        if files and len(files) != len(program.run):
            raise CalibError(
                f"read: file: expected one name, or one for each of the {len(program.run)} command line(s) of run, got "
                f"{len(files)}"
            )
        return cls(program, reading, _of_options(KeepingOptions, options))


def _of_options(group: type[OptionGroup], options: Mapping[str, Any]) -> OptionGroup:
    return group(**{option.name: options[option.name] for option in fields(group) if option.name in options})


def _signature() -> inspect.Signature:
    """Return the flat options as keywords; those without which nothing can run have no default."""
    return inspect.Signature(
        [
            inspect.Parameter(
                option.name,
                inspect.Parameter.KEYWORD_ONLY,
                default=inspect.Parameter.empty if option.name in ("run", "read") else _default(option.default),
                annotation=option.type,
            )
            for group in GROUPS
            for option in fields(group)
        ]
    )


def _default(value: Any) -> Any:
    """Return a default as it is shown; that of a table is an empty one."""
    return {} if value is MISSING else value


SIGNATURE = _signature()


def described() -> str:
    """List all options as the docstrings of their groups describe them."""
    texts = [(inspect.getdoc(group) or "").partition(f"{'-' * 10}\n")[2] for group in GROUPS]
    return "\n".join(text.strip() for text in texts)
