"""Records of some tosses, in SI, with the height at which the lowest corner touches: out/toss_NN.nc."""

import sys
from pathlib import Path

import numpy as np
import xarray as xr

from calib.execution.files import verified
from calib.records import make, write

UNIT = 0.0524  # m, half the width of the cube
TOSSES = (4, 5, 12)  # of those kept, the ones that fly longest before the first impact
SHA256 = "1e3081f0123ece19a4fe40230f101dd5dcd49526115d57f4db00b39c1a184942"
ORIGIN = "https://github.com/DAIRLab/contact-nets (commit c3dc21c9, data/tosses_processed; see README.md)"
CORNERS = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])  # half widths


def lowest(w: np.ndarray, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Height (n,) of the lowest corner below the centre for unit quaternions, in half widths."""
    upwards = np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x**2 + y**2)])
    return -(CORNERS @ upwards).min(axis=0)


def toss(rows: np.ndarray) -> xr.Dataset:
    """Record of the centre's vertical motion, driven by what the rotation makes of the table."""
    record = make(
        rows["t_s"],
        ["cube"],
        {
            "displacement": UNIT * rows["pz"][None],
            "velocity": UNIT * rows["vz"][None],
            "displacement_sigma": np.array([2e-5]),  # departure of the flight from a parabola
            "velocity_sigma": np.array([4e-3]),  # of a difference of two such
        },
        place="table",
        quantity="base motion",
        source=f"cube_tosses_000_079.csv, toss {int(rows['toss'][0])}, sha256 {SHA256}",
    )
    floor = UNIT * lowest(*(rows[q] for q in ("qw", "qx", "qy", "qz")))
    return record.assign(excitation=("time", floor, {"units": "m"}))


def make_records(file: str | Path, folder: str | Path) -> None:
    """Write the records of `TOSSES` into the folder."""
    verified(Path(file), SHA256, ORIGIN)
    table = np.genfromtxt(file, delimiter=",", names=True)
    Path(folder).mkdir(parents=True, exist_ok=True)
    for number in TOSSES:
        write(toss(table[table["toss"] == number]), Path(folder) / f"toss_{number:02d}.nc")


if __name__ == "__main__":
    make_records(sys.argv[1], Path(__file__).parent / "out")
