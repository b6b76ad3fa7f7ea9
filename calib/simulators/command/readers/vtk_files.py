"""The files of a VTK series with their times."""

import re
from collections import Counter
from pathlib import Path, PurePosixPath

from defusedxml import ElementTree
from defusedxml.common import DefusedXmlException

from calib.errors import CalibError
from calib.execution.files import lies_within
from calib.simulators.command.readers.lines import check_size
from calib.simulators.command.readers.number import number

SUFFIXES = (".vtu", ".vtk")
COLLECTION = ".pvd"
MAX_COLLECTION_BYTES = 2**24  # bytes of a .pvd: 100 000 files
NUMBERED = re.compile(r"(.*?)([0-9]{1,9})")  # stem of a numbered file


def series_files(path: Path, step: float | None) -> list[tuple[float, Path]]:
    """Return time and path of each file, in the order of a .pvd or of the numbers.

    Raises
    ------
    CalibError : another kind of file, several files for one time, a file elsewhere, no step for numbered files
    """
    if path.suffix == COLLECTION:
        if step is not None:
            raise CalibError(f"{path}: a .pvd states its times; drop step")
        return _collected(path)
    if path.suffix not in SUFFIXES:
        raise CalibError(f"{path}: expected a .pvd, .vtu or .vtk file; of a .pvtu, have one file written for each time")
    return _numbered(path, step)


def _numbered(path: Path, step: float | None) -> list[tuple[float, Path]]:
    match = NUMBERED.fullmatch(path.stem)
    if match is None:
        raise CalibError(f"{path}: expected the first of numbered files, such as out_0000{path.suffix}")
    if step is None:
        raise CalibError(f"{path}: numbered files state no time; state step, the time between two numbers")
    files: dict[int, Path] = {}
    for other in path.parent.iterdir():
        own = NUMBERED.fullmatch(other.stem)
        if own and own[1] == match[1] and other.suffix == path.suffix and int(own[2]) >= int(match[2]):
            if int(own[2]) in files:
                raise CalibError(f"{other}: {files[int(own[2])].name} has the same number; remove one")
            _check_within(path, other.name)
            files[int(own[2])] = other
    return [(count * step, files[count]) for count in sorted(files)]


def _check_within(path: Path, name: str) -> None:
    if not lies_within(path.parent / name, path.parent):
        raise CalibError(f"{path}: expected files in its own folder, got {name!r}")


def _collected(path: Path) -> list[tuple[float, Path]]:
    check_size(path, MAX_COLLECTION_BYTES)
    try:
        root = ElementTree.fromstring(path.read_bytes(), forbid_dtd=True)
    except (ElementTree.ParseError, DefusedXmlException, ValueError, LookupError) as error:
        raise CalibError(f"{path}: not a readable .pvd file ({error}); did the program stop?") from error
    files = []
    for entry in root.iter("DataSet"):
        name = entry.get("file", "")
        if PurePosixPath(name).suffix not in SUFFIXES:
            raise CalibError(f"{path}: expected files of the kinds {', '.join(SUFFIXES)}, got {name!r}")
        file = path.parent / name
        _check_within(path, name)
        if not file.is_file():
            raise CalibError(f"{path}: {name!r} is not there; did the program stop?")
        files.append((number(entry.get("timestep", ""), path, 1, "timestep"), file))
    if not files:
        raise CalibError(f"{path}: expected a DataSet for each time, got none")
    time, times = Counter(time for time, _ in files).most_common(1)[0]
    if times > 1:
        raise CalibError(f"{path}: expected one file for each time, got {times} at {time:g}; have the parts merged")
    return files
