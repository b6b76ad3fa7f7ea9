"""Outputs of programs, in every format that there is a reader for."""

# ruff: noqa: E501 - one case a line

import base64
import random
import zipfile
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import h5py
import meshio
import numpy as np
import xarray as xr
from fuzzing.case import OwnError
from fuzzing.kinds.record import restructured
from fuzzing.mutations import damaged, text_damaged
from scipy.io import savemat

from calib.simulators.command.options import OutputReading
from calib.simulators.command.reading import Instants, OutputFault, read_columns, record_of

TIME = np.arange(20.0) / 10
PLACES = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]])
MESH = meshio.Mesh(PLACES, [("line", [[0, 1]])], point_data={"u": np.ones((3, 3)), "p": np.ones(3)})
POINTS = {"points": {"tip": 1}}
DAT = "".join(
    f"\n displacements (vx,vy,vz) for set NTIP and time  {t:.7E}\n\n        17  {t:.6E} {-t:.6E}  {t:.6E}\n"
    for t in TIME
)
FRD = "".join(
    f"  100CL  101{t:12.5E}           1                     0    1           1\n -4  DISP        2    1\n"
    f" -5  D1          1    2    1    0\n -5  D2          1    2    2    0\n -1        17{t:12.5E}{-t:12.5E}\n -3\n"
    for t in TIME
)
FRD_BINARY = b"".join(
    f"  100CL  101{t:12.5E}           1                     0    1           2\n -4  DISP        1    1\n"
    " -5  D1          1    1    1    0\n".encode()
    + np.array([(17, t)], "<i4, <f4").tobytes()
    for t in TIME
)
PVD = '<VTKFile><Collection><DataSet timestep="0" file="one0.vtk"/><DataSet timestep="1" file="one1.vtk"/></Collection></VTKFile>'
BOMB = 3 * 10**9  # bytes that a few megabytes make


def _hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["time"] = TIME
        file["g/u"] = np.ones((20, 3))
        file.create_dataset("z", data=TIME, compression="gzip", chunks=(5,))


def _matlab_73(path: Path) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        file["t"], file["tip"] = TIME, TIME
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM")


def _collection(path: Path) -> None:
    path.write_text(PVD)
    for number in range(2):
        meshio.vtk.write(path.with_name(f"one{number}.vtk"), MESH)


def _vtu(**how: Any) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        for number in range(2):
            meshio.vtu.write(path.with_name(f"out{number}.vtu"), MESH, **how)

    return write


def _legacy(path: Path) -> None:
    for number in range(2):
        meshio.vtk.write(path.with_name(f"out{number}.vtk"), MESH)


class Format(NamedTuple):
    """An output: the reader, its options, the column that is a body, how it is written."""

    reader: str
    file: str
    column: str
    options: dict[str, Any]
    write: Callable[[Path], object]


FORMATS = {
    "delimited": Format("delimited", "out.csv", "x", {}, lambda p: p.write_text("time,x\n" + "".join(f"{t},{-t}\n" for t in TIME))),
    "fixed_width": Format("fixed_width", "out.txt", "2", {"widths": [9, 9]}, lambda p: p.write_text("".join(f"{t:9.4f}{-t:9.4f}\n" for t in TIME))),
    "npy": Format("numpy", "out.npy", "2", {}, lambda p: np.save(p, np.column_stack([TIME, TIME]))),
    "npz": Format("numpy", "out.npz", "u[1]", {}, lambda p: np.savez_compressed(p, t=TIME, u=np.ones((3, 20)))),
    "matlab": Format("matlab", "out.mat", "u[1]", {}, lambda p: savemat(p, {"t": TIME, "u": np.ones((3, 20)), "s": {"a": TIME}})),
    "matlab compressed": Format("matlab", "out.mat", "tip", {}, lambda p: savemat(p, {"t": TIME, "tip": TIME}, do_compression=True)),
    "matlab 4": Format("matlab", "out.mat", "tip", {}, lambda p: savemat(p, {"t": TIME, "tip": TIME}, format="4")),
    "matlab 7.3": Format("matlab", "out.mat", "tip", {}, _matlab_73),
    "hdf5": Format("hdf5", "out.h5", "g/u[1]", {}, _hdf5),
    "netcdf": Format("netcdf", "out.nc", "u", {}, lambda p: xr.Dataset({"u": ("time", TIME)}, {"time": TIME}).to_netcdf(p)),
    "netcdf classic": Format("netcdf", "out.nc", "u", {}, lambda p: xr.Dataset({"u": ("time", TIME)}, {"time": TIME}).to_netcdf(p, format="NETCDF3_CLASSIC")),
    "calculix_dat": Format("calculix_dat", "out.dat", "NTIP.U1", {}, lambda p: p.write_text(DAT)),
    "calculix_frd": Format("calculix_frd", "out.frd", "17.D1", {}, lambda p: p.write_text(FRD)),
    "calculix_frd binary": Format("calculix_frd", "out.frd", "17.D1", {}, lambda p: p.write_bytes(FRD_BINARY)),
    "pvd": Format("vtk", "out.pvd", "tip.p", POINTS, _collection),
    "vtu text": Format("vtk", "out0.vtu", "tip.p", POINTS | {"step": 1.0}, _vtu(binary=False)),
    "vtu zlib": Format("vtk", "out0.vtu", "tip.p", POINTS | {"step": 1.0}, _vtu()),
    "vtu lzma": Format("vtk", "out0.vtu", "tip.p", POINTS | {"step": 1.0}, _vtu(compression="lzma")),
    "vtu uncompressed": Format("vtk", "out0.vtu", "tip.p", POINTS | {"step": 1.0}, _vtu(compression=None)),
    "vtk legacy": Format("vtk", "out0.vtk", "tip.p", POINTS | {"step": 1.0}, _legacy),
}  # fmt: skip
TEXTUAL = (".csv", ".txt", ".dat", ".frd", ".pvd", ".vtu")


@cache
def _files() -> dict[str, dict[str, bytes]]:
    found = {}
    with TemporaryDirectory() as temporary:
        for name, form in FORMATS.items():
            folder = Path(temporary) / name
            folder.mkdir()
            form.write(folder / form.file)
            found[name] = {path.name: path.read_bytes() for path in folder.iterdir()}
    return found


@cache
def _squeezed(size: int) -> bytes:
    """Zeros, compressed."""
    packer = zlib.compressobj(9)
    parts = [packer.compress(bytes(2**20)) for _ in range(size // 2**20)]
    return b"".join(parts) + packer.flush()


def _bomb(path: Path, form: Format, rng: random.Random) -> str | None:
    """A small file that is large when it is unpacked."""
    size = rng.choice([BOMB, 2**28, 2**26])
    if path.suffix == ".npz":
        with (
            zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
            archive.open("t.npy", "w", force_zip64=True) as file,
        ):
            file.write(
                b"\x93NUMPY\x01\x00v\x00"
                + f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({size // 8},), }}".ljust(117).encode()
                + b"\n"
            )
            for _ in range(size // 2**20):
                file.write(bytes(2**20))
        return f"{size} bytes in an archive"
    if path.suffix == ".vtu" and b"vtkZLib" in path.read_bytes():
        packed = _squeezed(size)
        blocks = rng.choice([1, 3])
        head = np.array([blocks, size, size, *[len(packed)] * blocks], "<u4").tobytes()
        data = base64.b64encode(head) + base64.b64encode(packed * blocks)
        text = path.read_bytes()
        at = text.index(b">", text.index(b"<DataArray", text.index(b"PointData"))) + 1
        path.write_bytes(text[:at] + data + text[text.index(b"</DataArray>", at) :])
        return f"{blocks} blocks of {size} bytes"
    if path.suffix == ".mat":
        savemat(path, {"t": TIME, "tip": np.zeros(size // 8 if size < BOMB else 2**24)}, do_compression=True)
        return f"{size} bytes of zeros"
    if path.suffix in (".h5", ".nc"):
        with h5py.File(path, "w") as file:
            file.create_dataset("time", data=np.arange(size // 8.0 / 4) if size == 2**26 else TIME)
            rows = file["time"].size
            file.create_dataset("u", (rows, size // 8 // rows), "f8", compression="gzip", chunks=True)
        return f"{size} bytes that were never written"
    return None


class _Outputs:
    name = "reader"

    def samples(self) -> list[str]:
        return list(FORMATS)

    def make(self, sample: str, rng: random.Random | None, folder: Path) -> list[str]:
        form = FORMATS[sample]
        (folder / "format").write_text(sample)
        for name, content in _files()[sample].items():
            (folder / name).write_bytes(content)
        if rng is None:
            return []
        path = folder / rng.choice([form.file, *_files()[sample]])
        if rng.random() < 0.02:
            done = _bomb(path, form, rng)
            if done is not None:
                return [done]
        if rng.random() < 0.03:
            target = rng.choice(
                ["../outside/secret.txt", "../outside/secret.nc", path.name, "/dev/zero", "/etc/passwd", ".."]
            )
            path.unlink()
            path.symlink_to(target)
            return [f"a symbolic link to {target}"]
        if path.suffix in (".h5", ".nc") and b"HDF" in path.read_bytes()[:8] and rng.random() < 0.6:
            return restructured(path, rng, folder)
        content = path.read_bytes()
        path.write_bytes((text_damaged if path.suffix in TEXTUAL and rng.random() < 0.7 else damaged)(content, rng))
        return ["bytes"]

    def read(self, folder: Path) -> None:
        form = FORMATS[(folder / "format").read_text()]
        stated = {
            "reader": form.reader,
            "file": form.file,
            "bodies": {"tip": {"displacement": {"column": form.column, "unit": "mm"}}},
        }
        reading = OutputReading.of({**stated, **form.options})
        try:
            columns = read_columns(folder, reading, None)
            record_of(columns, reading, Instants(np.linspace(0.0, 0.9, 10)), {})
        except OutputFault as fault:
            raise OwnError(f"{fault.status}: {fault.reason}") from fault

    def readable(self, folder: Path) -> frozenset[str]:
        return frozenset()


OUTPUT = _Outputs()
