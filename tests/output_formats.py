"""Outputs of programs in every format that is read: small files, written by the libraries of each."""

# ruff: noqa: E501 - one format a line

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import meshio
import numpy as np
import xarray as xr
from matlab_73 import save_73
from scipy.io import savemat

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


def hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["time"] = TIME
        file["g/u"] = np.ones((20, 3))
        file.create_dataset("z", data=TIME, compression="gzip", chunks=(5,))


def matlab_73(path: Path) -> None:
    save_73(path, {"t": TIME, "tip": TIME})


def collection(path: Path) -> None:
    path.write_text(PVD)
    for number in range(2):
        meshio.vtk.write(path.with_name(f"one{number}.vtk"), MESH)


def vtu(**how: Any) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        for number in range(2):
            meshio.vtu.write(path.with_name(f"out{number}.vtu"), MESH, **how)

    return write


def legacy_vtk(path: Path) -> None:
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
    "matlab 7.3": Format("matlab", "out.mat", "tip", {}, matlab_73),
    "hdf5": Format("hdf5", "out.h5", "g/u[1]", {}, hdf5),
    "netcdf": Format("netcdf", "out.nc", "u", {}, lambda p: xr.Dataset({"u": ("time", TIME)}, {"time": TIME}).to_netcdf(p)),
    "netcdf classic": Format("netcdf", "out.nc", "u", {}, lambda p: xr.Dataset({"u": ("time", TIME)}, {"time": TIME}).to_netcdf(p, format="NETCDF3_CLASSIC")),
    "calculix_dat": Format("calculix_dat", "out.dat", "NTIP.U1", {}, lambda p: p.write_text(DAT)),
    "calculix_frd": Format("calculix_frd", "out.frd", "17.D1", {}, lambda p: p.write_text(FRD)),
    "calculix_frd binary": Format("calculix_frd", "out.frd", "17.D1", {}, lambda p: p.write_bytes(FRD_BINARY)),
    "pvd": Format("vtk", "out.pvd", "tip.p", POINTS, collection),
    "vtu text": Format("vtk", "out0.vtu", "tip.p", POINTS | {"step": 1.0}, vtu(binary=False)),
    "vtu zlib": Format("vtk", "out0.vtu", "tip.p", POINTS | {"step": 1.0}, vtu()),
    "vtu lzma": Format("vtk", "out0.vtu", "tip.p", POINTS | {"step": 1.0}, vtu(compression="lzma")),
    "vtu uncompressed": Format("vtk", "out0.vtu", "tip.p", POINTS | {"step": 1.0}, vtu(compression=None)),
    "vtk legacy": Format("vtk", "out0.vtk", "tip.p", POINTS | {"step": 1.0}, legacy_vtk),
}  # fmt: skip
