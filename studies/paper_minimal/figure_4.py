"""Figure 4: bifurcation diagram over the coefficient of restitution, 100 sections each.

    python studies/paper_minimal/figure_4.py

Transients are dropped by convergence, at most the paper's 1000 periods before the first verdict. `sweep` is the diagram
in three lines. `branches` follows its periodic motions, stable or not, to where they end.
"""

from pathlib import Path

import numpy as np
import xarray as xr

from calib.dynamics.branch import Branch, follow
from calib.dynamics.motion import kind_of_orbit
from calib.report.continuation import branch_diagram
from calib.report.diagrams import bifurcation_diagram, impact_diagram
from calib.study_toml import load
from calib.sweep import Sweep, run

HERE = Path(__file__).parent
NAME = "restitution"
WINDOW = (0.0, 0.8)
SEEDS = (0.05, 0.2, 0.73)  # where periodic motions are settled to that are then followed


def sweep(out: Path, values: np.ndarray, carry: str = "none") -> xr.Dataset:
    """Motions over the coefficient of restitution, from rest or carried along."""
    setting = load(HERE).setting()
    return run(Sweep(setting, {NAME: values}, carry=carry), out, jobs=2)


def branches(seeds: tuple[float, ...] = SEEDS) -> list[Branch]:
    """Branches of the periodic motions found at `seeds`, each with its least period."""
    setting = load(HERE).setting()
    found = []
    for seed in seeds:
        motion = kind_of_orbit(setting.map({NAME: seed}))
        found.append(follow(lambda e: setting.map({NAME: e}), motion.state, seed, WINDOW, motion.period))
    return found


def main() -> None:
    """Draw the figure in out/."""
    out = HERE / "out"
    diagram = sweep(out / "figure_4.nc", np.linspace(*WINDOW, 401))
    bifurcation_diagram(diagram, ["q2", "q3"]).savefig(out / "figure_4.png", dpi=150)
    impact_diagram(diagram).savefig(out / "figure_4_impacts.png", dpi=150)
    followed = branches()
    datasets = [branch.dataset(NAME, "1").assign_attrs(model="four_dof", phase=0.0) for branch in followed]
    branch_diagram(datasets, "q3", diagram).savefig(out / "figure_4_branches.png", dpi=150)
    for branch in followed:
        print(f"period-{branch.periods}: restitution {branch.parameter.min():.5f} .. {branch.parameter.max():.5f}")
        for point in branch.points:
            print(f"  {point.kind} at {point.parameter:.6f} ({point.evidence})")


if __name__ == "__main__":
    main()
