"""The diagram of Figure 4 under other ways of driving: the paper's text does not decide between them.

    python studies/paper_minimal/drives.py

All amplitudes are such that the linear motion is that of set R1: 1.5 mm at the ends, 2.702 mm in the beam's middle.
"""

from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from calib.dynamics.setting import Setting
from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.records.excitation import Excitation
from calib.report.plots.sweeps import in_order, kind_colour, patch, plain_kind
from calib.simulators.four_dof import FourDof
from calib.simulators.four_dof.drives import DriveName
from calib.study_file import load
from calib.sweep import Sweep, run

HERE = Path(__file__).parent
END, MIDDLE = 1.5e-3, 2.702e-3  # m, linear amplitudes of q1 and q2
DRIVES: dict[DriveName, str] = {
    "spring": "displacement of q1 behind a stiff spring (default)",
    "rigid": "displacement of q1",
    "symmetric": "displacement of both ends",
    "force": "force on q1",
    "centre": "displacement of the beam's middle",
}


def setting(drive: DriveName) -> Setting:
    """Model and excitation of one way of driving."""
    model, frequency = Model(FourDof(drive)), load(HERE).setting().excitation.frequency
    if drive == "centre":
        return Setting(model, Excitation("centre", "displacement", frequency=frequency, amplitude=MIDDLE))
    if drive != "force":
        return Setting(model, Excitation("end", "displacement", frequency=frequency, amplitude=END))
    unit = Excitation("end", "force", frequency=frequency, amplitude=1.0)
    linear = model.run({"gap": 1.0}, unit, Request(periods=1))  # a gap that never closes
    return Setting(model, unit.scaled(END / float(linear.displacement.sel(body="q1").max())))


def sweep(drive: DriveName, out: Path, values: np.ndarray) -> xr.Dataset:
    """Motions over the coefficient of restitution, from rest."""
    return run(Sweep(setting(drive), {"restitution": values}), out, jobs=2)


def main() -> None:
    """Draw the diagrams of q3 one above the other in out/."""
    out = HERE / "out"
    figure = Figure(figsize=(9.0, 11.0), layout="constrained")
    kinds: set[str] = set()
    for axes, (drive, meaning) in zip(figure.subplots(len(DRIVES), 1, sharex=True), DRIVES.items(), strict=True):
        found = sweep(drive, out / f"drive_{drive}.nc", np.linspace(0.0, 0.8, 201))
        own = plain_kind(found.kind)
        for kind in np.unique(own):
            part = found.isel(restitution=own == kind)
            sections = 1e3 * part.displacement.sel(body="q3")
            places = np.broadcast_to(part.restitution.values, sections.shape)
            axes.plot(places.ravel(), sections.values.ravel(), ".", color=kind_colour(kind), markersize=1.2)
        kinds |= set(own.tolist())
        axes.set(title=f"{drive}: {meaning}", ylabel="q3 [mm]")
        axes.grid(color="#e4e4e4")
    axes.set_xlabel("restitution [1]")
    handles = [patch(kind_colour(kind), kind) for kind in in_order(kinds)]
    figure.legend(handles=handles, loc="outside lower center", ncols=6)
    figure.savefig(out / "drives.png", dpi=150)


if __name__ == "__main__":
    main()
