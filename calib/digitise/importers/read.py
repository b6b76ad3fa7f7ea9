"""The importers by suffix."""

from pathlib import Path

from calib.digitise.importers.delimited import read_table
from calib.digitise.importers.engauge import read_dig
from calib.digitise.importers.imported import Imported
from calib.digitise.importers.webplotdigitizer import read_json, read_tar
from calib.errors import CalibError, nearest

_READERS = {
    ".json": read_json,
    ".tar": read_tar,
    ".dig": read_dig,
    ".csv": read_table,
    ".tsv": read_table,
    ".txt": read_table,
    ".dat": read_table,
}
SUFFIXES = tuple(_READERS)


def read(path: str | Path) -> Imported:
    """Read the curves of a file that another digitising tool wrote.

    Raises
    ------
    CalibError : no such file, another kind of file, or nothing in it that can be read, with the reasons
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in _READERS:
        raise CalibError(f"{path}: {suffix or 'a file without suffix'} is not read{nearest(suffix, SUFFIXES)}; "
                         f"known are {', '.join(SUFFIXES)}")  # fmt: skip
    imported = _READERS[suffix](path)
    if not imported.curves:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in imported.refused.items())
        raise CalibError(f"{path}: no curve can be read; {reasons or 'the file holds none'}")
    return imported
