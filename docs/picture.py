"""Draw docs/minimal.png from the results of studies/minimal: python docs/picture.py."""

from pathlib import Path

from calib.records import read
from calib.report.plots.motion import phase_curves
from calib.report.plots.records import aligned_simulation
from calib.study_file import load

ROOT = Path(__file__).parents[1]

file = load(ROOT / "studies" / "minimal")
objective = file.study.objective
measured = objective.references["clapping"].record
simulated = aligned_simulation(objective, "clapping", read(file.folder / "best.nc"))
phase_curves(measured, simulated).savefig(ROOT / "docs" / "minimal.png", dpi=110)
