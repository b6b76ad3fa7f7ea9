"""Figure 5: phase portraits of beam and layer at three coefficients of restitution, impacts located.

python studies/paper_minimal/figure_5.py
"""

from pathlib import Path

import xarray as xr
from matplotlib.figure import Figure

from calib.dynamics.motion import kind_of_orbit
from calib.dynamics.orbit_kind import OrbitKind
from calib.modelling.simulator import Request
from calib.study_file import load

HERE = Path(__file__).parent
RESTITUTIONS = (0.05, 0.20, 0.50)
REQUEST = Request(periods=400, samples=750, settle=1000)  # a sample each T/750, the step of the paper's figure


def portrait(restitution: float) -> xr.Dataset:
    """Record of 400 periods after 1000."""
    setting = load(HERE).setting({"restitution": restitution})
    return setting.model.run(setting.values, setting.excitation, REQUEST)


def kind(restitution: float) -> OrbitKind:
    """Kind of the motion, which the record alone does not tell: it pauses near a period-4 motion at 0.50."""
    return kind_of_orbit(load(HERE).setting({"restitution": restitution}).map())


def main() -> None:
    """Draw the figure in out/."""
    figure = Figure(figsize=(11.0, 6.4), layout="constrained")
    panels = figure.subplots(2, len(RESTITUTIONS), sharex="row", sharey="row")
    for column, restitution in zip(panels.T, RESTITUTIONS, strict=True):
        record = portrait(restitution)
        column[0].set_title(f"restitution {restitution:g}: {kind(restitution).kind}")
        for axes, body in zip(column, ("q2", "q3"), strict=True):
            one = record.sel(body=body)
            axes.plot(1e3 * one.displacement, one.velocity, color="#0072B2", linewidth=0.3, rasterized=True)
            axes.set_xlabel(f"{body} displacement [mm]")
            axes.grid(color="#e4e4e4")
    for axes in panels[:, 0]:
        axes.set_ylabel("velocity [m/s]")
    (HERE / "out").mkdir(exist_ok=True)
    figure.savefig(HERE / "out" / "figure_5.png", dpi=150)


if __name__ == "__main__":
    main()
