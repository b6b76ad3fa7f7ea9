"""What the decays say by themselves, of no model: frequency and damping ratio over amplitude.

python studies/sloshing/decays.py
"""

import os
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.io import loadmat

from calib.records.decay import amplitude_curves, smoothed_decay

FIRST = 31  # sample: the first second is left out, as in the study
AMPLITUDES = (4.0, 3.0, 2.0, 1.0, 0.5, 0.3, 0.2, 0.1)  # % of the tank's width
NOISE = 0.005  # % of the width, standard deviation as the study states it


def curves_of(time: np.ndarray, values: np.ndarray) -> xr.Dataset:
    """Return frequency and damping ratio over amplitude of one decay  [% of the width]."""
    return amplitude_curves(smoothed_decay(time.ravel()[FIRST:], values.ravel()[FIRST:], NOISE))


def told(path: Path) -> dict[str, np.ndarray]:
    """Return frequency and its uncertainty  [Hz], damping ratio and its uncertainty  [%], by decay: (4, amplitude)."""
    rows = {}
    for number, (time, values) in enumerate(loadmat(path)["xData"], start=1):
        curves = curves_of(time, values)
        at = np.log(curves.amplitude.values[::-1])
        columns = [
            np.interp(np.log(AMPLITUDES), at, factor * curves[name].values[::-1], left=np.nan, right=np.nan)
            for factor, quantity in ((1.0, "frequency"), (100.0, "damping_ratio"))
            for name in (quantity, f"{quantity}_sigma")
        ]
        rows[f"decay {number}"] = np.array(columns)
    return rows


def main() -> None:
    """Print a table: two standard uncertainties on either side."""
    rows = told(Path(os.environ["CALIB_DATA"]) / "sloshing" / "decays.mat")
    print("| amplitude |" + "".join(f" {name} |" for name in rows))
    print("|---" * (1 + len(rows)) + "|")
    for index, amplitude in enumerate(AMPLITUDES):
        cells = []
        for frequency, of_frequency, damping, of_damping in (one[:, index] for one in rows.values()):
            cell = f"{frequency:.4f} +- {2 * of_frequency:.4f} Hz, {damping:.2f} +- {2 * of_damping:.2f} %"
            cells.append("" if np.isnan(frequency) else cell)
        print(f"| {amplitude:g} % | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
