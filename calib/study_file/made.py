"""Things that a study file names, made with the options that it states."""

import inspect
from collections.abc import Callable, Mapping
from typing import Any

from calib.errors import CalibError, nearest
from calib.study_file.mistakes import Mistakes


def made(
    maker: Callable[..., Any],
    options: Mapping[str, Any],
    name: str,
    mistakes: Mistakes,
    key: tuple[str | int, ...],
    given: tuple[str, ...] = (),
) -> Any:
    """Return ``maker(**options)``, or None with the mistakes noted; only looked at where names are yet `given`."""
    if not callable(maker):
        raise CalibError(f"{name!r} is an instance of {type(maker).__name__}; name the class, not an instance")
    accepted = inspect.signature(maker).parameters.values()
    free = any(p.kind is p.VAR_KEYWORD for p in accepted)
    known = {p.name: p for p in accepted if p.kind in (p.KEYWORD_ONLY, p.POSITIONAL_OR_KEYWORD) and p.name not in given}
    unknown = [option for option in options if option not in known and not free]
    for option in unknown:
        takes = f"takes {', '.join(known)}" if known else "takes none"
        mistakes.add((*key, option), f"unknown option of {name!r}{nearest(option, known)}; it {takes}")
    missing = [p.name for p in known.values() if p.default is p.empty and p.name not in options]
    if missing:
        mistakes.add(key, f"{name!r} needs {', '.join(missing)}")
    if unknown or missing or given:
        return None
    with mistakes.at(*key):
        return _called(maker, options, name)
    return None


def _called(maker: Callable[..., Any], options: Mapping[str, Any], name: str) -> Any:
    try:
        return maker(**options)
    except (TypeError, ValueError) as error:
        raise CalibError(f"{name!r} does not take these options: {error}") from error
