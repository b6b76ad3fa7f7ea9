"""Readers by name, their options checked before and their columns after each call."""

import inspect
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, TypeAdapter, ValidationError

from calib import plugins
from calib.errors import CalibError, nearest
from calib.execution.module_code import module_code, module_files
from calib.simulators.command.readers.columns import Columns

GROUP = "calib.readers"
STRICT = ConfigDict(strict=True)  # a text that looks like a number is none

Reader = Callable[..., Columns]


def reader(name: str, modules: Path | None = None) -> Reader:
    """Return a reader, which is called as ``read(path, **options)``.

    Parameters
    ----------
    name : of a reader of the group ``calib.readers``, or "module:function" of a function of one's own that takes the
        path and options and returns `Columns`, or time and the columns by name: ``time, {"tip": displacement}``
    modules : folder in which such a module is looked for too

    Raises
    ------
    CalibError : the name is not known or does not load; the reader raises one where an option is unknown or the file
        cannot be read
    """
    function = _function(name, modules)
    return partial(_read, name, function)


def check_options(name: str, options: Mapping[str, Any], modules: Path | None = None) -> None:
    """Check the options of a reader before there is a file.

    Raises
    ------
    CalibError : one that is unknown, missing, or of another type
    """
    _check(name, _function(name, modules), options)


@dataclass(frozen=True)
class ReaderCode:
    """Where the code of a reader that is not of calib stands: see `module_code`.

    Attributes
    ----------
    files : module -> its source file
    versions : name of the distribution that installed it -> with its version
    """

    files: Mapping[str, Path] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)


def reader_code(name: str, modules: Path | None = None) -> ReaderCode:
    """Return where the code of a reader stands; nowhere for one of calib."""
    module = plugins.module_name(GROUP, name)
    stated = getattr(sys.modules.get(module), "__file__", None)
    if module.partition(".")[0] == "calib" or stated is None:
        return ReaderCode()
    file, folders = Path(stated).resolve(), [] if modules is None else [modules.resolve()]
    files = module_files(module, file, folders)
    return ReaderCode(files) if files else ReaderCode(versions=module_code(module, file, folders))


def _function(name: str, modules: Path | None) -> Callable[..., Any]:
    function = plugins.load(GROUP, name, modules)
    if not callable(function):
        raise CalibError(
            f"reader {name!r} is an object of type {type(function).__name__}; name a function that takes a path"
        )
    return function


def _read(name: str, function: Callable[..., Any], path: Path, /, **options: Any) -> Columns:
    _check(name, function, options)
    path = Path(path)
    if not path.is_file():
        kind = "a folder or a device" if path.exists() else "no such file"
        raise CalibError(f"{path}: expected an output file to read, got {kind}")
    try:
        return _columns(function(path, **options))
    except CalibError as error:
        raise error if str(path) in str(error) else CalibError(f"{path}: reader {name!r}: {error}") from error
    except Exception as error:  # of a function that somebody else wrote, on a file that may be anything
        raise CalibError(f"{path}: the reader {name!r} failed: {error!r}; mend it, or what it reads") from error


def _columns(result: Any) -> Columns:
    """Return what a function returned as columns."""
    if isinstance(result, Columns):
        return result
    if isinstance(result, tuple) and len(result) == 2:
        return Columns(*result)
    raise CalibError(f"expected Columns, or time and {{name: array}}, got {type(result).__name__}")


def _check(name: str, function: Callable[..., Any], options: Mapping[str, Any]) -> None:
    parameters = inspect.signature(function).parameters.values()
    kinds = (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    path = next(iter(parameters), None)
    known = {p.name: p for p in parameters if p.kind in kinds and p is not path}
    free = any(p.kind is p.VAR_KEYWORD for p in parameters)
    for option, value in options.items():
        if option not in known and not free:
            if option == "time":
                raise CalibError(
                    f"the reader {name!r} has no choice of time: it returns time itself, in seconds; where that is in "
                    'another unit, state it alone, as in time = { unit = "ms" }'
                )
            takes = f"takes {', '.join(known)}" if known else "takes none"
            raise CalibError(f"unknown option {option!r} of the reader {name!r}{nearest(option, known)}; it {takes}")
        if option in known and ":" not in name:
            _check_type(name, option, known[option].annotation, value)
    missing = [p.name for p in known.values() if p.default is p.empty and p.name not in options]
    if missing:
        raise CalibError(f"the reader {name!r} needs {', '.join(missing)}")


def _check_type(name: str, option: str, annotation: Any, value: Any) -> None:
    if annotation is inspect.Parameter.empty or isinstance(annotation, str):
        return
    try:
        TypeAdapter(annotation, config=STRICT).validate_python(value)
    except ValidationError as error:
        texts = [problem["msg"].removeprefix("Value error, ") for problem in error.errors()]
        problems = dict.fromkeys(text[:1].lower() + text[1:] for text in texts)
        raise CalibError(
            f"option {option!r} of the reader {name!r}: {'; or '.join(problems)}; got {value!r}"
        ) from error
