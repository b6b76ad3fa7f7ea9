"""What is wrong in a study file, or another one in TOML: every mistake with its line, reported at once."""

import re
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from calib.errors import CalibError, nearest
from calib.study_file.lines import dotted, line_of, lines
from calib.study_file.partial_check import without_mistakes
from calib.study_file.schema import StudyToml

MAX_MISTAKES = 50  # that are told at once
MAX_MESSAGE_CHARACTERS = 4000  # of one mistake, which may name texts of any length
VIEW_KEY = ("store", "view")  # location of an address, which may hold a password
PASSWORD_PART = re.compile(":.*@")  # of an address that is none
Tables = TypeVar("Tables", bound=BaseModel)
_EXPECTED = {
    "int_type": "expected a whole number",
    "float_type": "expected a number",
    "string_type": "expected a text",
    "list_type": "expected a list",
    "dict_type": "expected a table",
    "model_type": "expected a table",
}


@dataclass(frozen=True)
class PythonOrigin:
    """A study that was stated in Python: its mistakes name the argument, not the line of the file that stands for it.

    Attributes
    ----------
    modules : folder in which modules of the study lie; None: all are on Python's path
    """

    modules: Path | None = None


class Mistakes:
    """Collects mistakes; each names file, line and key.

    Parameters
    ----------
    path, text : of the TOML file, or of another file that begins with such a text
    schema : its shape, from which known keys are named
    origin : where the text was stated, if not in the file
    """

    def __init__(self, path: Path, text: str, schema: type[BaseModel] = StudyToml, origin: PythonOrigin | None = None):
        self.path = path
        self.schema = schema
        self._lines = lines(text)
        self._origin = origin
        self._messages: list[str] = []
        self._keys: list[tuple[str | int, ...]] = []

    @property
    def from_python(self) -> bool:
        """Whether the study was stated in Python, so that remedies are in Python's form."""
        return self._origin is not None

    @property
    def modules(self) -> Path | None:
        """Folder in which modules of the study lie beside Python's path."""
        return self.path.parent if self._origin is None else self._origin.modules

    def place(self, *key: str | int) -> str:
        """Write where `key` stands: ``study.toml:12: windows.gap``, or the key alone of what was stated in Python."""
        if self._origin is not None:
            return dotted(key)
        line = line_of(self._lines, key)
        return f"{self.path}{'' if line is None else f':{line}'}: {dotted(key)}"

    def add(self, key: Sequence[str | int], message: str) -> None:
        """Note a mistake at `key`."""
        cut = message if len(message) <= MAX_MESSAGE_CHARACTERS else f"{message[:MAX_MESSAGE_CHARACTERS]} ..."
        self._messages.append(f"{self.place(*key)}: {cut}")
        self._keys.append(tuple(key))

    def within(self, *key: str | int) -> bool:
        """Whether a mistake was noted at `key` or below it."""
        return any(noted[: len(key)] == key for noted in self._keys)

    @contextmanager
    def at(self, *key: str | int) -> Iterator[None]:
        """Note a CalibError raised inside as a mistake at `key`, and go on behind the block."""
        try:
            yield
        except CalibError as error:
            self.add(key, str(error))

    def tell(self) -> None:
        """Raise what was noted.

        Raises
        ------
        CalibError : one line a mistake
        """
        if len(self._messages) == 1:
            raise CalibError(self._messages[0])
        if self._messages:
            subject = self.path if self._origin is None else "the study"
            more = len(self._messages) - MAX_MISTAKES
            rest = [f"... and {more} more"] if more > 0 else []
            shown = self._messages[:MAX_MISTAKES]
            raise CalibError("\n".join([f"{subject} has {len(self._messages)} mistakes:", *shown, *rest]))


def located(path: str | Path) -> Path:
    """Path of the study file: `path` itself, or the `study.toml` in that folder.

    Raises
    ------
    CalibError : there is no such file
    """
    path = Path(path)
    path = path / "study.toml" if path.is_dir() else path
    if not path.is_file():
        raise CalibError(f"{path}: no such study file; expected a .toml file or a folder with a study.toml")
    return path


def read_toml(schema: type[Tables], path: Path, origin: PythonOrigin | None = None) -> tuple[Tables, Mistakes]:
    """Read a TOML file into a schema; `origin` says where its text was stated, if not in the file.

    Returns
    -------
    the checked tables and the (still empty) list of mistakes

    Raises
    ------
    CalibError : no UTF-8, no TOML, unknown or missing keys, values of another kind; each with file, line and key
    """
    return read_as(schema, path, _text(path), origin)


def read_as(schema: type[Tables], path: Path, text: str, origin: PythonOrigin | None = None) -> tuple[Tables, Mistakes]:
    """Read a TOML text into a schema.

    Parameters
    ----------
    path : of the file that the text is, or begins
    origin : where the text was stated, if not in the file

    Returns
    -------
    the checked tables and the (still empty) list of mistakes

    Raises
    ------
    CalibError : no TOML, unknown or missing keys, values of another kind; each with file, line and key
    """
    tables = _parsed(path, text)
    mistakes = Mistakes(path, text, schema, origin)
    shape = _validated(schema, tables, mistakes)
    if shape is None:
        mistakes.tell()
        raise AssertionError("the schema refuses the text, and no mistake says why")
    return shape, mistakes


def read_study(path: Path, origin: PythonOrigin | None = None) -> tuple[StudyToml, Mistakes]:
    """Read a study file whose values may be mistaken, so that what does not depend on those can be checked too.

    Returns
    -------
    its tables, with stand-ins where a mistake is noted (see `calib.study_file.partial_check`), and the mistakes so far

    Raises
    ------
    CalibError : no UTF-8, no TOML
    """
    text = _text(path)
    tables = _parsed(path, text)
    mistakes = Mistakes(path, text, StudyToml, origin)
    shape = _validated(StudyToml, tables, mistakes)
    return without_mistakes(tables, mistakes.within) if shape is None else shape, mistakes


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise CalibError(f"{path}: not a text in UTF-8 (byte {error.start}); save it as UTF-8") from error


def _parsed(path: Path, text: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise CalibError(f"{path}:{_line_of_error(str(error), text)}: this is not TOML: {error}") from error


def _validated(schema: type[Tables], tables: dict[str, Any], mistakes: Mistakes) -> Tables | None:
    """Check tables against a schema; what does not fit is noted, and leaves None."""
    try:
        return schema.model_validate(tables)
    except ValidationError as invalid:
        for detail in invalid.errors():
            mistakes.add(detail["loc"], _phrase(detail, schema))
    return None


def _line_of_error(message: str, text: str) -> int:
    """Line that tomllib names as "(at line 3, column 5)", or the last one where it says "(at end of document)"."""
    line = message.partition("at line ")[2].partition(",")[0]
    return int(line) if line else text.rstrip("\n").count("\n") + 1


def _phrase(error: ErrorDetails, schema: type[BaseModel]) -> str:
    *above, name = error["loc"]
    if error["type"] == "extra_forbidden":
        known = list(_table(above, schema).model_fields)
        return f"unknown key{nearest(str(name), known)}; known here are {', '.join(known)}"
    if error["type"] == "missing":
        return f"this is required in [{dotted(above)}]" if above else f"the table [{name}] is missing"
    got = repr(error["input"])
    if error["loc"] == VIEW_KEY:
        got = PASSWORD_PART.sub(":***@", got)
    message = error["msg"].removeprefix("Value error, ").replace("Input should be", "expected")
    if error["type"] == "too_short":
        return _too_short(error)
    text = _EXPECTED.get(error["type"], message)
    expected = error.get("ctx", {}).get("expected", "")
    hint = nearest(error["input"], expected.split("'")[1::2]) if error["type"] == "literal_error" else ""
    return f"{text}, got {got if len(got) < 60 else got[:57] + '...'}{hint}"


def _too_short(error: ErrorDetails) -> str:
    least, came = error["ctx"]["min_length"], error["ctx"]["actual_length"]
    return f"expected at least {least} {'entry' if least == 1 else 'entries'}, got {came or 'none'}"


def _table(key: Sequence[str | int], table: type[BaseModel]) -> type[BaseModel]:
    for part in key:
        if part in table.model_fields:  # not an index, nor the free name of a window
            table = _inside(table.model_fields[part].annotation) or table
    return table


def _inside(annotation: object) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((model for part in get_args(annotation) if (model := _inside(part))), None)
