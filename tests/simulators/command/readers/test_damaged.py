"""A file with any bytes changed, lost or doubled is read, or refused by name, in little memory."""

import random
import tracemalloc

import h5py
import meshio
import numpy as np
import pytest
import xarray as xr
from scipy.io import savemat

from calib.errors import CalibError
from calib.simulators.command.readers import reader

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
    " -5  D1          1    2    1    0\n".encode()
    + np.array([(17, t)], "<i4, <f4").tobytes()
    for t in TIME
)
PVD = '<VTKFile><Collection><DataSet timestep="0" file="one0.vtk"/></Collection></VTKFile>'


def hdf5(path):
    with h5py.File(path, "w") as file:
        file["time"] = TIME
        file["g/u"] = np.ones((20, 3))
        file.create_dataset("z", data=TIME, compression="gzip", chunks=(5,))


def matlab_73(path):
    with h5py.File(path, "w", userblock_size=512) as file:
        file["t"], file["tip"] = TIME, TIME
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM")


def collection(path):
    path.write_text(PVD)
    meshio.vtk.write(path.with_name("one0.vtk"), MESH)


def fixed_width(path):
    path.write_text("".join(f"{t:9.4f}{-t:9.4f}\n" for t in TIME))


CASES = {
    "delimited": ("out.csv", {}, lambda p: p.write_text("t,x\n" + "".join(f"{t},{-t}\n" for t in TIME))),
    "fixed_width": ("out.txt", {"widths": [9, 9]}, fixed_width),
    "numpy": ("out.npy", {}, lambda p: np.save(p, np.column_stack([TIME, TIME]))),
    "numpy, archive": ("out.npz", {}, lambda p: np.savez_compressed(p, t=TIME, u=np.ones((3, 20)))),
    "matlab": ("out.mat", {}, lambda p: savemat(p, {"t": TIME, "u": np.ones((3, 20)), "s": {"a": TIME}})),
    "matlab, compressed": ("out.mat", {}, lambda p: savemat(p, {"t": TIME, "tip": TIME}, do_compression=True)),
    "matlab, version 4": ("out.mat", {}, lambda p: savemat(p, {"t": TIME, "tip": TIME}, format="4")),
    "matlab, version 7.3": ("out.mat", {}, matlab_73),
    "hdf5": ("out.h5", {}, hdf5),
    "calculix_dat": ("out.dat", {}, lambda p: p.write_text(DAT)),
    "calculix_frd": ("out.frd", {}, lambda p: p.write_text(FRD)),
    "calculix_frd, binary": ("out.frd", {}, lambda p: p.write_bytes(FRD_BINARY)),
    "vtk, collection": ("out.pvd", POINTS, collection),
    "vtk, text": ("out0.vtu", POINTS | {"step": 1.0}, lambda p: meshio.vtu.write(p, MESH, binary=False)),
    "vtk, binary": ("out0.vtu", POINTS | {"step": 1.0}, lambda p: meshio.vtu.write(p, MESH)),
    "vtk, legacy": ("out0.vtk", POINTS | {"step": 1.0}, lambda p: meshio.vtk.write(p, MESH)),
}  # fmt: skip
TRIES = 20
MAX_PEAK_BYTES = 2**26  # bytes: none of the files holds more than 10 kB


def damaged(content, rng):
    """Cut the content off, cut out of it, double a part of it, or change some of its bytes."""
    at, length = rng.randrange(len(content)), rng.randrange(1, 200)
    match rng.randrange(6):
        case 0:
            return content[:at]
        case 1:
            return content[:at] + content[at + length :]
        case 2:
            return content[: at + length] + content[at:]
    changed = bytearray(content)
    for _ in range(rng.choice([1, 2, 10])):
        changed[rng.randrange(len(content))] = rng.choice([*b'\n *9-E"', 0, 127, 128, 255, rng.randrange(256)])
    return bytes(changed)


@pytest.mark.parametrize("case", CASES)
def test_damaged_files_are_read_or_refused_by_name(tmp_path, case):
    name, options, write = CASES[case]
    read, path, rng = reader(case.partition(",")[0]), tmp_path / name, random.Random(7)
    write(path)
    content = path.read_bytes()
    assert len(read(path, **options).values) > 0
    tracemalloc.start()
    try:
        for _ in range(TRIES):
            path.write_bytes(damaged(content, rng))
            try:
                read(path, **options)
            except CalibError as error:
                if str(tmp_path) not in str(error) or "failed:" in str(error):
                    raise
        assert tracemalloc.get_traced_memory()[1] < MAX_PEAK_BYTES
    finally:
        tracemalloc.stop()


def test_a_netcdf_file_that_is_cut_off_is_refused_by_name(tmp_path):
    path = tmp_path / "out.nc"
    for version in ("NETCDF4", "NETCDF3_64BIT"):
        xr.Dataset({"u": ("time", TIME)}, {"time": TIME}).to_netcdf(path, format=version)
        content = path.read_bytes()
        for size in np.linspace(0, len(content) - 20, 9, dtype=int).tolist():
            path.write_bytes(content[:size])
            with pytest.raises(CalibError, match="out.nc"):
                reader("netcdf")(path)
