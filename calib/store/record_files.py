"""The record files of the trials, and those of the best one."""

import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, get_args
from urllib.parse import quote

import xarray as xr

from calib.errors import CalibError
from calib.execution.files import whole
from calib.records import read, write
from calib.store.ledger import write_errors_reported

Keep = Literal["best", "improving", "all"]
KEEP = get_args(Keep)


def file_of(stem: str, record: str, first: bool) -> str:
    """Name of the file of a record among those of a trial, of which the first has the bare stem."""
    return f"{stem}.nc" if first else f"{stem}-{quote(record, safe='')}.nc"


def best_records(folder: Path) -> dict[str, xr.Dataset]:
    """Records of the best trial of the study in `folder`, by name; empty where there are none."""
    return _by_name([*folder.glob("best.nc"), *sorted(folder.glob("best-*.nc"))])


def _by_name(paths: Sequence[Path]) -> dict[str, xr.Dataset]:
    """Records in files of trials, by the name that each states."""
    records = {}
    for path in paths:
        record = read(path)
        name = record.attrs.get("record")
        if not isinstance(name, str):
            raise CalibError(f"{path}: attribute record: expected the name of a record, got {name!r}; delete the file")
        records[name] = record
    return records


class RecordFiles:
    """`records/` and `best.nc` of a study's folder.

    The first record of a trial lies in `records/<number>.nc`, further ones in `records/<number>-<record>.nc` (the name
    percent-encoded); those of the best trial also in `best.nc` and `best-<record>.nc`. Each file is a record by itself,
    whole or absent. Its attribute `provenance` holds values, score, study, versions and processor as one JSON text.
    Where the best trial was confirmed, its records by the confirming simulator take the place of the search's in
    `best.nc`; on opening these are back, until it is confirmed again.
    """

    def __init__(self, folder: Path, keep: Keep):
        if keep not in KEEP:
            raise CalibError(f"keep is one of {', '.join(map(repr, KEEP))}, got {keep!r}")
        self._folder, self._records, self._keep = folder, folder / "records", keep

    def open(self, best: int | None) -> None:
        """Delete unfinished files of a killed run, and bring `best.nc` up to trial `best`."""
        with write_errors_reported(self._records):
            self._records.mkdir(exist_ok=True)
            for unfinished in [*self._records.glob(".*"), *self._folder.glob(".best*.nc.*")]:
                unfinished.unlink()
        if best is not None:
            self.promote(best)

    def wants(self, improves: bool) -> bool:
        """Whether the records of a trial are to be kept."""
        return improves or self._keep == "all"

    def write(self, number: int, records: Mapping[str, xr.Dataset], provenance: Mapping[str, Any]) -> None:
        """Write the records of a trial."""
        self._write(self._records, f"{number:06d}", number, records, provenance)

    def write_best(self, number: int, records: Mapping[str, xr.Dataset], provenance: Mapping[str, Any]) -> None:
        """Write records of trial `number` as the best ones, other than those kept of it."""
        self._write(self._folder, "best", number, records, provenance)

    def _write(
        self, folder: Path, stem: str, number: int, records: Mapping[str, xr.Dataset], provenance: Mapping[str, Any]
    ) -> None:
        text = json.dumps(provenance)
        with write_errors_reported(folder):
            for index, (name, record) in enumerate(records.items()):
                stamped = record.assign_attrs(trial=number, record=name, provenance=text)
                write(stamped, folder / file_of(stem, name, index == 0))

    def promote(self, number: int) -> None:
        """Make the records of trial `number` the best ones; nothing happens where none were kept."""
        paths = self._paths(number)
        with write_errors_reported(self._folder / "best.nc"):
            for path in paths:
                with whole(self._folder / path.name.replace(f"{number:06d}", "best", 1)) as temporary:
                    shutil.copyfile(path, temporary)
            if paths and self._keep == "best":
                for other in set(self._records.glob("*.nc")) - set(paths):
                    other.unlink()

    def numbers(self) -> set[int]:
        """Trials whose records are kept."""
        stems = [path.stem.partition("-")[0] for path in self._records.glob("*.nc")]
        return {int(stem) for stem in stems if stem.isdigit()}

    def read(self, number: int) -> dict[str, xr.Dataset]:
        """Read the records kept of a trial, by name; empty where none were."""
        return _by_name(self._paths(number))

    def _paths(self, number: int) -> list[Path]:
        return [*self._records.glob(f"{number:06d}.nc"), *sorted(self._records.glob(f"{number:06d}-*.nc"))]
