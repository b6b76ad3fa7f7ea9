"""Names to things: the entry points of simulators, effects, features and optimisers."""

import importlib
import warnings
from functools import cache
from importlib.metadata import EntryPoint, entry_points

from calib.errors import CalibError, nearest

GROUPS = ("calib.simulators", "calib.effects", "calib.features", "calib.optimisers")


@cache
def _registered(group: str) -> dict[str, EntryPoint]:
    return {point.name: point for point in sorted(entry_points(group=group), key=lambda point: point.name)}


def names(group: str) -> list[str]:
    """Names registered in a group, such as ``"calib.effects"``, sorted."""
    return list(_registered(group))


def load(group: str, name: str):
    """Return the thing that `name` stands for: an entry point of the group, or ``"package.module:Thing"``.

    Raises
    ------
    CalibError : the name is not known, or its module does not import
    """
    if ":" in name:
        return _imported(name)
    known = _registered(group)
    if name not in known:
        kind = group.rpartition(".")[2].removesuffix("s")
        raise CalibError(
            f"unknown {kind} {name!r}{nearest(name, known)}; known are {', '.join(known)}, "
            'or give your own as "package.module:Thing"'
        )
    try:
        return known[name].load()
    except Exception as error:
        raise CalibError(f"{group}: {name!r} ({known[name].value}) does not load: {error!r}") from error


def load_all(group: str) -> dict[str, object]:
    """Return every thing of a group by name; one that does not load is skipped with a warning."""
    things = {}
    for name in names(group):
        try:
            things[name] = load(group, name)
        except CalibError as error:
            warnings.warn(f"skipped: {error}", stacklevel=2)
    return things


def _imported(path: str):
    module, _, attribute = path.partition(":")
    try:
        return getattr(importlib.import_module(module), attribute)
    except Exception as error:
        raise CalibError(f"{path!r} does not load: {error!r}; expected an importable 'package.module:Thing'") from error
