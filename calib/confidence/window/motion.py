"""What bounds a kind of motion, of one evaluated point: multipliers, near misses and impacts of its periodic motion."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from calib.dynamics.orbits import Cycle, length_scale, shoot
from calib.dynamics.tangent import knows_derivative
from calib.errors import CalibError
from calib.modelling.orbit import PeriodMap
from calib.modelling.parameter import values_for
from calib.objective import Objective
from calib.objective.scalar_features import FeatureValue
from calib.records import OK
from calib.study import CalibrationStudy, Evaluation, evaluate

MULTIPLIER, CLEARANCE, CLOSING_SPEED = "largest multiplier", "nearest miss", "slowest impact"  # what is measured
CLOSEST_APPROACH = "closest approach"  # of the whole motion: clearance without contact, negative with it
MAX_CYCLE_SETTLING_PERIODS = 400  # from rest, in which the motion has to come close to a periodic one
SETTLING_CHUNK = 20  # periods between two looks
SETTLED_DISTANCE = 1e-4  # in units of the map's scale: change of the state over one return


@dataclass(frozen=True, eq=False)
class WindowEvaluation:
    """Evaluates a study's points, and looks at their periodic motions; it crosses to the child processes.

    Attributes
    ----------
    study : without its search
    """

    study: CalibrationStudy

    def __call__(self, values: Mapping[str, float]) -> Evaluation:
        """Simulate and score the values (SI); the features of the motions stand beside those of the records."""
        evaluation = evaluate(self.study, values)
        if evaluation.score.status != OK or evaluation.score.wrong:
            return evaluation
        found = [
            feature
            for name in self.study.objective.scored
            for feature in (
                *motion_features(self.study, self.study.objective, name, values),
                *approach_features(self.study, name, evaluation.records[name], values),
            )
        ]
        return replace(evaluation, features=[*evaluation.features, *found])


def motion_features(
    study: CalibrationStudy, objective: Objective, name: str, values: Mapping[str, float]
) -> list[dict[str, Any]]:
    """Modulus of the largest multiplier, nearest miss and slowest impact of the motion of the record `name`.

    Empty where the excitation is not harmonic, the simulator offers no period map that knows its derivative, or the
    motion does not settle from rest within `MAX_CYCLE_SETTLING_PERIODS`.
    """
    reference, periods = objective.references[name], int(objective.measured_periods.get(name) or 0)
    if not reference.excitation.harmonic or not periods:
        return []
    try:
        map = study.model.period_map(values_for(values, name), reference.excitation)
    except (CalibError, ValueError):  # none is offered, or an effect is explicit in time
        return []
    if not knows_derivative(map, map.initial):
        return []
    cycle = settled_cycle(map, periods)
    if cycle is None or not cycle.converged:
        return []
    sizes = [(MULTIPLIER, "1", float(abs(cycle.multipliers[0])), 1.0)]
    if np.isfinite(cycle.nearest):
        sizes.append((CLEARANCE, "m", cycle.nearest, length_scale(map, "m")))
    if np.isfinite(cycle.slowest) and cycle.orbit.contact == 0.0:
        sizes.append((CLOSING_SPEED, "m/s", cycle.slowest, length_scale(map, "m/s")))
    return [
        asdict(FeatureValue(label, name, "", unit, measured=0.0, simulated=size, tolerance=scale))
        for label, unit, size, scale in sizes
    ]


def approach_features(
    study: CalibrationStudy, name: str, record: xr.Dataset, values: Mapping[str, float]
) -> list[dict[str, Any]]:
    """Closest approach of the stop in the simulated motion of the record `name`, beside the motion's amplitude.

    Without contact it is the least clearance [m] over a period. With contact it is negative: minus the depth
    v^2 / (2 omega^2 A) to which a relative motion of amplitude A and angular frequency omega would go on at the closing
    speed v of the fastest impact, were there no stop. Both come to zero where the last impact grazes. Empty where the
    record lists no impacts, the excitation is not harmonic, or a motion without contact cannot be followed by a period
    map.
    """
    excitation = study.objective.references[name].excitation
    frequency = excitation.frequency
    if frequency is None or not excitation.harmonic or not {"impact_speed", "displacement"} <= set(record.variables):
        return []
    amplitude = 0.5 * float(np.ptp(record.variables["displacement"].values, axis=-1).max())
    if not amplitude > 0.0:
        return []
    speeds = record.variables["impact_speed"].values
    if speeds.size:
        rate = 2.0 * np.pi * frequency
        approach = -((float(speeds.max()) / rate) ** 2) / (2.0 * amplitude)
    elif record.attrs.get("contact_fraction", 0.0) > 0.0:
        return []
    else:
        approach = _least_clearance(study, name, values)
    if not np.isfinite(approach):
        return []
    return [
        asdict(FeatureValue(CLOSEST_APPROACH, name, "", "m", measured=0.0, simulated=approach, tolerance=amplitude))
    ]


def _least_clearance(study: CalibrationStudy, name: str, values: Mapping[str, float]) -> float:
    """Least clearance [m] over a period of the motion from rest, once it has settled; inf where it is not known."""
    reference = study.objective.references[name]
    periods = int(study.objective.measured_periods.get(name) or 1)
    try:
        map = study.model.period_map(values_for(values, name), reference.excitation)
    except (CalibError, ValueError):  # none is offered, or an effect is explicit in time
        return float("inf")
    state = settled_state(map, periods)
    return float("inf") if state is None else float(map.near_misses(state).min(initial=np.inf))


def settled_cycle(map: PeriodMap, periods: int) -> Cycle | None:
    """Periodic motion of so many periods that the map settles to from its initial state; None where it does not."""
    state = settled_state(map, periods)
    return None if state is None else shoot(map, state, periods)


def settled_state(map: PeriodMap, periods: int) -> np.ndarray | None:
    """State that returns after so many periods, to which the map settles from its initial one; None without one."""
    state = map.initial
    for _ in range(MAX_CYCLE_SETTLING_PERIODS // SETTLING_CHUNK):
        orbit = map.orbit(state, SETTLING_CHUNK)
        if orbit.status != OK:
            return None
        state = orbit.states[-1]
        if np.abs((orbit.states[-1 - periods] - state) / map.scale).max() < SETTLED_DISTANCE:
            return state
    return None
