"""The record of a stationary motion: the stable one, where a run stays irregular beside it."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import xarray as xr

from calib.dynamics.motion import rank, stable_cycles
from calib.dynamics.pseudo_orbit import pseudo_orbit
from calib.dynamics.settling import kind_of_cycle
from calib.dynamics.tangent import knows_derivative
from calib.errors import CalibError
from calib.modelling.model import Model
from calib.modelling.orbit import PeriodMap
from calib.modelling.simulator import Request
from calib.records import OK, STATE
from calib.records.cycles.motion import BESIDE_ATTRIBUTE, IRREGULAR, UNDECIDED, kind_of_motion
from calib.records.excitation import Excitation

SETTLE_PERIODS = 500  # dropped of an irregular motion
SEARCH_PERIODS = 1000  # in which close returns are sought


def stationary_record(
    model: Model, values: Mapping[str, float], excitation: Excitation, request: Request
) -> xr.Dataset:
    """Simulate the stationary motion; where it is irregular, the stable periodic one beside it if there is one.

    Which of them a run comes to is decided by rounding where a chaotic transient leads to the stable motion, so that a
    score of the run itself would be the processor's. Newton's method looks for the stable motion from the closest
    returns of 1000 periods, once the record has been found to be irregular, at about the cost of the run. The record
    says what was done in its attribute `beside`, and the evidence of its kind repeats it. Where the simulator has no
    period map that knows its derivative, the record stays as it is.

    Parameters
    ----------
    values : SI; the nominal value stands in for what they lack

    Raises
    ------
    CalibError : an unknown parameter, or an excitation that the simulator cannot take
    """
    record = model.run(values, excitation, request)
    if record.attrs["status"] != OK or not excitation.harmonic or request.settle == 0:
        return record
    motion = kind_of_motion(record)
    if motion.kind not in (IRREGULAR, UNDECIDED):
        return record
    try:
        map = model.period_map(values, excitation)
    except CalibError:  # none is offered, or an effect is explicit in time
        return record
    if not knows_derivative(map, map.initial):
        return record
    state = stable_state(map)
    if state is None:
        text = f"no stable periodic motion was found beside it within {SETTLE_PERIODS + SEARCH_PERIODS} periods"
        return record.assign_attrs({BESIDE_ATTRIBUTE: text})
    stable = model.run(values, excitation, replace(request, initial_state=state))
    if stable.attrs["status"] != OK or kind_of_motion(stable).period is None:
        return record
    text = f"found by Newton's method beside a motion that is {motion.kind}: {motion.evidence}"
    return stable.assign_attrs({BESIDE_ATTRIBUTE: text})


def stable_state(map: PeriodMap) -> np.ndarray | None:
    """State of a stable periodic motion beside an irregular one, as `Request.initial_state` takes it; None without one.

    Of several it is that of the shortest period.
    """
    orbit = pseudo_orbit(map, map.initial, SETTLE_PERIODS + SEARCH_PERIODS)
    if orbit.status != OK:
        return None
    motions = [kind_of_cycle(map, cycle) for cycle in stable_cycles(map, orbit.states[SETTLE_PERIODS:])]
    stable = sorted((motion for motion in motions if motion.regular), key=rank)
    return _as_initial_state(map, stable[0].state) if stable else None


def _as_initial_state(map: PeriodMap, state: np.ndarray) -> np.ndarray:
    """State of the map with the bodies that the excitation prescribes, and which it does not hold, at rest."""
    named = dict(zip(map.names, state.tolist(), strict=True))
    components = [f"{body}.{channel}" for channel in STATE for body in map.bodies]
    if not named.keys() & set(components):
        return state
    inner = [value for name, value in named.items() if name not in components]
    return np.array([named.get(component, 0.0) for component in components] + inner)
