"""Figure 6: without locating the impacts, a fixed step makes a band of the period-1 motion.

    python studies/paper_minimal/figure_6.py

The steps do not divide the period: where they do, the error locks to the grid and there is no band to be seen.
"""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.simulators.four_dof import FourDof
from calib.study_file import load

HERE = Path(__file__).parent
REQUEST = Request(periods=100, samples=400, settle=400)
STEPS = (125.37, 250.37, 500.37, 1000.37)  # per period


def motion(**options: Any) -> xr.Dataset:
    """Record of 100 periods at restitution 0.05, from the simulator with these options."""
    setting = load(HERE).setting({"restitution": 0.05})
    return Model(FourDof(**options)).run(setting.values, setting.excitation, REQUEST)


def spread(record: xr.Dataset, body: str = "q3") -> float:
    """Width of the band [m]: range of the displacement at one phase over all periods, the median over the phases."""
    displacement = record.displacement.sel(body=body).values.reshape(REQUEST.periods, REQUEST.samples)
    return float(np.median(np.ptp(displacement, axis=0)))


def main() -> None:
    """Draw the figure in out/ and print the widths of the bands."""
    located, banded = motion(), motion(mode="fixed_step", steps_per_period=250.37)
    kept = [spread(motion(mode="fixed_step", steps_per_period=n)) for n in STEPS]
    put_back = [spread(motion(mode="fixed_step", steps_per_period=n, onto_surface=True)) for n in STEPS]
    figure = Figure(figsize=(12.0, 4.2), layout="constrained")
    panels = figure.subplots(1, 3)
    for axes, record, title in zip(panels, (located, banded), ("impacts located", "fixed step T/250.37"), strict=False):
        layer = record.sel(body="q3")
        axes.plot(1e3 * layer.displacement, layer.velocity, color="#0072B2", linewidth=0.4, rasterized=True)
        axes.set(title=title, xlabel="q3 displacement [mm]", ylabel="velocity [m/s]")
    steps = 1.0 / np.array(STEPS)
    panels[2].loglog(steps, 1e3 * np.array(kept), "o-", color="#D55E00", label="velocity reset only")
    panels[2].loglog(steps, 1e3 * np.array(put_back), "s-", color="#009E73", label="put back on the surface too")
    panels[2].loglog(steps, 1e3 * kept[0] * steps / steps[0], color="#999999", linewidth=0.8, label="first order")
    panels[2].set(title="width of the band", xlabel="step [periods]", ylabel="spread of q3 [mm]")
    panels[2].legend(frameon=False, loc="upper left")
    panels[2].set_xticks(steps, [f"1/{n:g}" for n in STEPS])
    panels[2].xaxis.set_minor_locator(NullLocator())
    for axes in panels:
        axes.grid(color="#e4e4e4")
    (HERE / "out").mkdir(exist_ok=True)
    figure.savefig(HERE / "out" / "figure_6.png", dpi=150)
    print(f"located: {1e3 * spread(located):.1e} mm")
    for n, one, other in zip(STEPS, kept, put_back, strict=True):
        print(f"T/{n}: {1e3 * one:.4f} mm, put back on the surface {1e3 * other:.4f} mm")


if __name__ == "__main__":
    main()
