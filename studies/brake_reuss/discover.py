"""Force that the linear mode misses, sought in every fourth measured point, and the levels that it predicts.

    python studies/brake_reuss/discover.py

The search is that of `calib discover`, cut short by a budget after the free functions. Printed: what is found, its
describing function, and the distance of `frequency_response` without and with the force on
all points of the fitted levels and of the seven that were held out.
"""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.diagnosis.discovery.discover import discover
from calib.diagnosis.discovery.serialise import discovery_result
from calib.diagnosis.effort import Budget
from calib.dynamics.swept_response import swept_response
from calib.execution.pool import InProcess
from calib.modelling.effect import Effect
from calib.modelling.parameter import Space
from calib.objective import Objective
from calib.records.response import sweeps
from calib.study_file import StudyFile, load

STRIDE = 4  # of the points of a level
MASS = 1.95  # held, for a linear mode does not determine it  [kg]
CALIBRATED = {"mass": MASS, "stiffness": 496_400.0, "damping": 4.09}  # N/m, N s/m
BUDGET = "330"  # simulations, after which no further fit begins
RECORDS = ("held", "between", "driven")  # the first is searched


def main() -> None:
    """Search, and print."""
    file = load(Path(__file__).parent / "study.toml")
    study, held = file.study, file.study.objective.references["held"]
    points = np.concatenate([points[::STRIDE] for _, points in sweeps(held.record)])
    thinned = replace(held, record=held.record.isel(point=points))
    windows = {name: window for name, window in study.space.windows.items() if name != "mass"}
    searched = replace(
        study, objective=Objective({"held": thinned}, study.objective.terms), space=Space(windows, {"mass": MASS})
    )
    found = discover(
        searched, {}, CALIBRATED, [], pool=InProcess, budget=Budget.of(BUDGET), on_progress=_progress, on_stage=_stage
    )
    result = discovery_result(found, CALIBRATED)
    print(f"\n{points.size} points, {result.simulations} simulations: {result.summary}")
    for trial in result.trials:
        print(f"  {trial.functions}: chi-square {trial.chi2:.0f}, left out {trial.left_out_deviance:.0f}")
    if found.chosen is None:
        return
    point = found.chosen.fitted.fit.point
    own = result.describing_function
    if own is not None:
        print("but for constants that calibration absorbs:")
        print("amplitude [mm]  stiffness of the force over the mass [1/s^2]  damping of the force [N s/m]")
        for amplitude, stiffness, damping in zip(own.amplitudes, own.stiffness, own.damping, strict=True):
            print(f"{1e3 * amplitude:14.3f}  {stiffness:44.0f}  {MASS * damping:27.1f}")
    for name in RECORDS:
        without, beside = (_distance(file, name, *own) for own in ((CALIBRATED, ()), (point.values, point.effects)))
        print(f"{name}: {without:.3f} without the force, {beside:.3f} with it")


def _distance(file: StudyFile, name: str, values: Mapping[str, float], effects: Sequence[Effect]) -> float:
    """Distance of a record from the simulation with effects; infinite where that fails."""
    objective = file.study.objective
    reference = objective.references.get(name) or file.reference(name)
    response = swept_response(file.study.model.extended(*effects), values, reference.excitation, reference.record)
    return objective.on({name: reference})({name: response}).cost


def _stage(text: str) -> None:
    print(f"\r{text:60s}", file=sys.stderr)


def _progress(done: int, foreseen: int) -> None:
    print(f"\r{done} of some {foreseen} simulations", end="", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
