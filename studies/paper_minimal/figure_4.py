"""Figure 4: bifurcation diagram over the coefficient of restitution, 100 sections each.

    python studies/paper_minimal/figure_4.py

Transients are dropped by convergence, at most the paper's 1000 periods before the first verdict. `sweep` is the diagram
in three lines, with all motions that were met at a value. `branches` follows its periodic motions, stable or not, to
where they end.
"""

from pathlib import Path

import numpy as np
import xarray as xr

from calib.dynamics.branch import Branch, follow
from calib.report.plots.bifurcation import bifurcation_diagram, impact_diagram
from calib.report.plots.continuation import branch_diagram
from calib.study_file import load
from calib.sweep import NONE, Sweep, run
from calib.sweep.plan import Carry

HERE = Path(__file__).parent
NAME = "restitution"
WINDOW = (0.0, 0.8)
# restitution -> period and a state beside a stable periodic motion: q1..q4 [m] and q1'..q4' [m/s] at phase zero. What a
# run from rest comes to is no seed: in a window beside chaos rounding decides it.
SEEDS = {
    0.05: (1, (0.0015014, 0.0027378, 0.0042563, 0.0015362, 0.00068113, 0.014739, 0.22305, 0.014663)),
    0.20: (2, (0.0015021, 0.0027496, 0.0045245, 0.0015482, 0.00039299, 0.0066837, 0.27277, 0.0066508)),
    0.73: (2, (0.0015000, 0.0026762, 0.0047175, 0.0014750, -0.00036058, 0.0014278, 0.15910, 0.0011595)),
}


def sweep(out: Path, values: np.ndarray, carry: Carry = NONE) -> xr.Dataset:
    """Motions over the coefficient of restitution, from rest or carried along."""
    setting = load(HERE).setting()
    return run(Sweep(setting, {NAME: values}, carry=carry), out, jobs=2)


def branches() -> list[Branch]:
    """Branches of the periodic motions beside the states of `SEEDS`."""
    setting = load(HERE).setting()
    return [
        follow(lambda e: setting.map({NAME: e}), np.array(state), seed, WINDOW, period)
        for seed, (period, state) in SEEDS.items()
    ]


def main() -> None:
    """Draw the figure in out/."""
    out = HERE / "out"
    diagram = sweep(out / "figure_4.nc", np.linspace(*WINDOW, 401))
    bifurcation_diagram(diagram, ["q2", "q3"]).savefig(out / "figure_4.png", dpi=150)
    impacts = impact_diagram(diagram)
    if impacts is not None:
        impacts.savefig(out / "figure_4_impacts.png", dpi=150)
    followed = branches()
    datasets = [branch.dataset(NAME, "1").assign_attrs(model="four_dof", phase=0.0) for branch in followed]
    branch_diagram(datasets, "q3", diagram).savefig(out / "figure_4_branches.png", dpi=150)
    for branch in followed:
        print(f"period-{branch.periods}: restitution {branch.parameter.min():.5f} .. {branch.parameter.max():.5f}")
        for point in branch.points:
            print(f"  {point.kind} at {point.parameter:.6f} ({point.evidence})")


if __name__ == "__main__":
    main()
