"""Records: netCDF files changed in their structure or their bytes, and tables that a study file describes."""

# ruff: noqa: E501 - one case a line

import json
import random
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import h5py
import numpy as np
from echo_study import write_study
from fuzzing.case import write_files
from fuzzing.mutations import NUMBERS, TEXTS, damaged, text_damaged, tree_damaged
from scipy.io import savemat

from calib import records
from calib.cli.digitise import show_reference
from calib.study_file import load
from calib.workflows.new import new

CF_ATTRIBUTES = (
    "units", "scale_factor", "add_offset", "_FillValue", "missing_value", "_Unsigned", "coordinates", "calendar", "dtype",
    "valid_min", "valid_range", "_Encoding", "bounds", "grid_mapping", "flag_values", "_Netcdf4Dimid", "CLASS", "NAME",
    "DIMENSION_LIST", "REFERENCE_LIST", "_Netcdf4Coordinates", "source", "least_significant_digit",
)  # fmt: skip
ATTRIBUTES = (
    "status", "reason", "place", "quantity", "frequency", "amplitude", "phase", "cutoff", "prescribed", "nuisance",
    "nuisance_sigma", "recorded_interval", "source", "simulations", "_NCProperties", "Conventions", "resampled",
)  # fmt: skip
VARIABLES = (
    "time", "body", "displacement", "velocity", "displacement_sigma", "velocity_sigma", "excitation", "force", "state",
    "impact_time", "impact_speed", "section_displacement", "strain", "component", "period",
)  # fmt: skip


def _attribute(rng: random.Random) -> Any:
    """Something that an attribute of HDF5 can hold."""
    match rng.randrange(9):
        case 0 | 1 | 2:
            return rng.choice(
                [text for text in TEXTS if "\x00" not in text and "\ud800" not in text and len(text) < 60_000]
            )
        case 3 | 4:
            return rng.choice([x for x in NUMBERS if x is not None and not (isinstance(x, int) and abs(x) > 2**62)])
        case 5:
            return np.array(rng.choice([[], [1.0], [1.0, np.nan], [[1, 2], [3, 4]], [1 + 2j]]))
        case 6:
            return np.array([b"a", b"bc"]) if rng.random() < 0.5 else np.bytes_(b"\xff\xfe")
        case 7:
            return h5py.Empty("f") if rng.random() < 0.5 else np.zeros(1, [("a", "f8"), ("b", "S3")])
    return json.dumps(tree_damaged({"scale.velocity": 0.004}, rng)[0]).encode("ascii", "replace").decode()[:60_000]


def _set_attribute(file: h5py.File, rng: random.Random, folder: Path) -> str:
    names = [n for n in file if isinstance(file.get(n), h5py.Dataset)]
    holder = file if rng.random() < 0.5 or not names else file[rng.choice(names)]
    name = rng.choice(ATTRIBUTES if holder is file else CF_ATTRIBUTES)
    what = _attribute(rng)
    holder.attrs[name] = what
    return f"{holder.name} {name} = {what!r:.60}"


def _drop_attribute(file: h5py.File, rng: random.Random, folder: Path) -> str:
    holder = rng.choice([file, *(file[n] for n in file if isinstance(file.get(n), h5py.Dataset))])
    names = list(holder.attrs)
    if not names:
        return "no attribute"
    name = rng.choice(names)
    del holder.attrs[name]
    return f"{holder.name} without {name}"


def _replaced(rng: random.Random, shape: tuple[int, ...]) -> dict[str, Any]:
    """Arguments of a dataset of another type or shape."""
    shapes = [shape, shape[::-1], (*shape, 2), (), (0,), (1,), (3,), (2, 0), shape[:1], (1,) * 8]
    if rng.random() < 0.25:  # large, never written, almost nothing in the file
        size = rng.choice([10**5, 10**7, 10**8, 10**10, 2**40])
        width = rng.choice([(size,), (1, size), (size, 2)])
        return {"shape": width, "dtype": rng.choice(["f8", "f4", "i1", "S8"]), "chunks": True,
                "compression": rng.choice([None, "gzip", "lzf"]), "fillvalue": None}  # fmt: skip
    kinds: list[Any] = [
        "c16", "?", "f2", "f4", ">f8", "i1", "u8", "i8", "S5", h5py.string_dtype(), h5py.vlen_dtype("f8"),
        np.dtype([("a", "f8"), ("b", "i4")]), h5py.enum_dtype({"a": 1, "b": 2}), np.dtype("V16"), h5py.ref_dtype,
        np.dtype(("f8", (2,))), "f8",
    ]  # fmt: skip
    return {"shape": rng.choice(shapes), "dtype": rng.choice(kinds)}


def _replace(file: h5py.File, rng: random.Random, folder: Path) -> str:
    name = rng.choice(VARIABLES)
    shape = file[name].shape if name in file else (1, 100)
    if name in file:
        attributes = dict(file[name].attrs) if rng.random() < 0.5 else {}
        del file[name]
    else:
        attributes = {}
    how = _replaced(rng, shape)
    made = file.create_dataset(name, **how)
    for key, held in attributes.items():
        if key in ("units", "_Netcdf4Dimid", "NAME", "CLASS"):
            made.attrs[key] = held
    if made.dtype == h5py.string_dtype() and made.size and made.size < 10_000:
        made[...] = rng.choice(["a", "", "b" * 1000, "é"])
    return f"{name} is now {how}"


def _poke(file: h5py.File, rng: random.Random, folder: Path) -> str:
    names = [n for n in file if isinstance(file.get(n), h5py.Dataset) and file[n].dtype.kind in "fi" and file[n].size]
    if not names:
        return "nothing to change"
    name = rng.choice(names)
    values = file[name][()]
    number = rng.choice([x for x in NUMBERS if isinstance(x, float)])
    if values.dtype.kind == "f":
        if rng.random() < 0.5:
            values.flat[rng.randrange(values.size)] = number
        else:
            with np.errstate(all="ignore"):
                values = values * rng.choice([1e-300, 1e-9, 1e-3, 1e3, 1e9, 1e300, 0.0, -1.0])
        file[name][...] = values
    return f"a value of {name}"


def _link(file: h5py.File, rng: random.Random, folder: Path) -> str:
    """A link, a virtual dataset or external storage that leads elsewhere."""
    name = rng.choice(VARIABLES)
    if name in file:
        del file[name]
    outside = rng.choice(["../outside/secret.h5", str(folder.parent / "outside" / "secret.h5")])
    match rng.randrange(6):
        case 0:
            file[name] = h5py.ExternalLink(outside, "/x")
        case 1:
            file[name] = h5py.SoftLink(rng.choice(["/time", f"/{name}", "/nowhere", "../x"]))
        case 2:
            layout = h5py.VirtualLayout((20,), "f8")
            layout[:] = h5py.VirtualSource(outside, "x", (20,))
            file.create_virtual_dataset(name, layout)
        case 3:
            raw = outside.replace(".h5", ".raw")
            file.create_dataset(name, (20,), "f8", external=[(raw, 0, h5py.h5f.UNLIMITED)])
        case 4:
            group = file.create_group(name)
            group["again"] = file["/"]
            group["x"] = h5py.ExternalLink(outside, "/x")
        case 5:
            file[name] = file[rng.choice([n for n in file] or ["/"])]
    return f"{name} leads elsewhere"


def _bodies(file: h5py.File, rng: random.Random, folder: Path) -> str:
    if "body" in file:
        del file["body"]
    names: Any = rng.choice(
        [
            ["mass", "mass"],
            [""],
            ["\n"],
            ["a" * 100_000],
            ["mass\x1b[2J"],
            [1, 2],
            [1.5],
            ["é"],
            ["mass"] * 500,
            ["@"],
            ["a/b"],
        ]
    )
    texts = isinstance(names[0], str)
    file.create_dataset("body", data=names, dtype=h5py.string_dtype() if texts else None)
    file["body"].attrs["CLASS"] = np.bytes_(b"DIMENSION_SCALE")
    file["body"].attrs["NAME"] = np.bytes_(b"body")
    return f"body = {names!r:.40}"


def _many(file: h5py.File, rng: random.Random, folder: Path) -> str:
    count = rng.choice([100, 2000])
    if rng.random() < 0.5:
        for i in range(count):
            file.create_dataset(f"v{i}", (3,), "f8")
        return f"{count} more variables"
    for i in range(count):
        file.attrs[f"a{i}"] = "x" * 20
    return f"{count} more attributes"


def _texts(file: h5py.File, rng: random.Random, folder: Path) -> str:
    """Long texts of variable length, which take their place in the heap of the file."""
    size = rng.choice([100, 100_000])
    file.create_dataset("note", data=["x" * rng.choice([0, 10, 1000])] * size, dtype=h5py.string_dtype(), chunks=True)
    return f"{size} texts"


CHANGES: list[Callable[[h5py.File, random.Random, Path], str]] = [
    _set_attribute, _set_attribute, _set_attribute, _drop_attribute, _replace, _replace, _poke, _poke, _link, _bodies, _many,
    _texts,
]  # fmt: skip


def restructured(path: Path, rng: random.Random, folder: Path) -> list[str]:
    """Change the structure of an HDF5 file in a few places; say what was done."""
    done = []
    with h5py.File(path, "r+") as file:
        for _ in range(rng.randint(1, 3)):
            try:
                done.append(rng.choice(CHANGES)(file, rng, folder))
            except (ValueError, TypeError, OSError, RuntimeError, KeyError, OverflowError) as error:
                done.append(f"(not possible: {error!r:.60})")
    return done


@cache
def _files() -> dict[str, dict[str, bytes]]:
    """Files of each sample."""
    found = {}
    with TemporaryDirectory() as temporary:
        folder = Path(temporary)
        write_study(folder / _made(folder, "netcdf"))
        for form, model in (("netcdf classic", "NETCDF3_CLASSIC"), ("netcdf offset", "NETCDF3_64BIT")):
            write_study(folder / _made(folder, form))
            record = records.read(folder / form / "bench.nc")
            record.to_netcdf(folder / form / "bench.nc", format=model, engine="netcdf4")
        for form in ("csv", "json", "mat"):
            _table(folder, form)
        for place in sorted(folder.iterdir()):
            files = [path for path in sorted(place.rglob("*")) if path.is_file() and path.suffix != ".md"]
            found[place.name] = {str(path.relative_to(place)): path.read_bytes() for path in files}
    return found


def _made(folder: Path, name: str) -> str:
    (folder / name).mkdir()
    return name


def _table(folder: Path, form: str) -> None:
    """Write a study whose record is a table."""
    path = new("study", "spring", folder)[0]
    path.parent.rename(folder / form)
    place = folder / form
    table = next(p for p in place.iterdir() if p.suffix == ".csv")
    if form != "csv":
        lines = [line for line in table.read_text().splitlines() if line and not line.startswith("#")]
        names, rows = lines[0].split(","), [[float(x) for x in line.split(",")] for line in lines[1:]]
        table.unlink()
        text = (place / "study.toml").read_text().replace(table.name, f"{table.stem}.{form}")
        for at, name in enumerate(names, 1):
            text = text.replace(f'column = "{name}"', f"column = {at}" if form == "json" else f'column = "{name}"')
        (place / "study.toml").write_text(text)
        if form == "json":
            (place / f"{table.stem}.json").write_text(json.dumps(rows))
        else:
            columns = np.array(rows).T
            savemat(place / f"{table.stem}.mat", dict(zip(names, columns, strict=True)), do_compression=True)


class _Records:
    name = "record"

    def samples(self) -> list[str]:
        return ["netcdf", "netcdf", "netcdf", *_files()]

    def make(self, sample: str, rng: random.Random | None, folder: Path) -> list[str]:
        write_files(_files()[sample], folder)
        if rng is None:
            return []
        path = self._record(folder)
        if sample == "netcdf" and rng.random() < 0.75:
            return restructured(path, rng, folder)
        if path.suffix == ".json" and rng.random() < 0.5:
            tree, done = tree_damaged(json.loads(path.read_bytes()), rng)
            path.write_text(json.dumps(tree))
            return [done]
        path.write_bytes((text_damaged if path.suffix in (".csv", ".json") else damaged)(path.read_bytes(), rng))
        if rng.random() < 0.05:
            (folder / "show").touch()
        return ["bytes"]

    def read(self, folder: Path) -> None:
        path = self._record(folder)
        if path.suffix == ".nc":
            records.read(path)
        if (folder / "show").exists():
            show_reference(folder / "study.toml", None)
        load(folder / "study.toml")

    def readable(self, folder: Path) -> frozenset[str]:
        return frozenset()

    def _record(self, folder: Path) -> Path:
        return next(path for path in sorted(folder.iterdir()) if path.suffix in (".nc", ".csv", ".json", ".mat"))


RECORD = _Records()
