"""The entry points of simulators, effects, features, optimisers and readers, by name."""

import importlib
import sys
import warnings
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from calib.errors import CalibError, nearest

GROUPS = ("calib.simulators", "calib.effects", "calib.features", "calib.optimisers", "calib.readers")
_FOLDERS: set[Path] = set()  # of studies, which were added to Python's path


@cache
def _registered(group: str) -> dict[str, EntryPoint]:
    return {point.name: point for point in sorted(entry_points(group=group), key=lambda point: point.name)}


def names(group: str) -> list[str]:
    """Names registered in a group, such as ``"calib.effects"``, sorted."""
    return list(_registered(group))


def load(group: str, name: str, folder: Path | None = None) -> Any:
    """Return the thing that `name` stands for: an entry point of the group, or ``"package.module:Thing"``.

    folder : in which such a module is looked for too; child processes find it there as well

    Raises
    ------
    CalibError : the name is not known, or its module does not import
    """
    if ":" in name:
        return _imported(name, folder)
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


def module_name(group: str, name: str) -> str:
    """Return the module of the thing that `name` stands for, which loads: see `load`."""
    return name.partition(":")[0] if ":" in name else _registered(group)[name].module


def load_all(group: str) -> dict[str, Any]:
    """Return every thing of a group by name; one that does not load is skipped with a warning."""
    things = {}
    for name in names(group):
        try:
            things[name] = load(group, name)
        except CalibError as error:
            warnings.warn(f"skipped: {error}", stacklevel=2)
    return things


def _imported(path: str, folder: Path | None) -> Any:
    module, _, attribute = path.partition(":")
    folder = None if folder is None else folder.resolve()
    own = None if folder is None else module_file(folder, module)
    if folder is not None and own is not None and str(folder) not in sys.path:
        sys.path.append(str(folder))
        _FOLDERS.add(folder)
    try:
        imported = importlib.import_module(module)
        _check_place(path, module, imported, folder, own)
        return getattr(imported, attribute)
    except CalibError:
        raise
    except Exception as error:
        if isinstance(error, ModuleNotFoundError) and error.name == module.partition(".")[0]:
            places = "Python's path" if folder is None else f"{folder} or on Python's path"
            raise CalibError(f"{path!r} does not load: there is no module {error.name!r} in {places}") from error
        raise CalibError(f"{path!r} does not load: {error!r}; expected an importable 'package.module:Thing'") from error


def _check_place(path: str, module: str, imported: ModuleType, folder: Path | None, own: Path | None) -> None:
    """Refuse a module that was imported from the folder of another study."""
    file = getattr(imported, "__file__", None)
    place = None if file is None else Path(file).resolve()
    if own is not None and place != own and (place is None or place.read_bytes() != own.read_bytes()):
        raise CalibError(
            f"{path!r}: module {module!r} was imported from {file or 'Python itself'} already, not from {own}; "
            "rename one of the two, or load them in processes of their own"
        )
    elsewhere = [other for other in _FOLDERS - {folder} if place is not None and place == module_file(other, module)]
    if own is None and elsewhere:
        other = elsewhere[0]
        raise CalibError(f"{path!r}: module {module!r} is that of another study, in {other}; copy it to {folder}")


def module_file(folder: Path, module: str) -> Path | None:
    """File of a module in a folder, None where it is not there."""
    place = folder.joinpath(*module.split("."))
    return next((file for file in (place.with_suffix(".py"), place / "__init__.py") if file.is_file()), None)
