"""The loads over a step: those of tables and laws, where the problem has any."""

from calib.simulators.compilation import ENCLOSED
from calib.simulators.impact.collocation import LOADS_HOLD, collocate, set_given_loads
from calib.simulators.impact.kinds import by_loads
from calib.simulators.impact.problem import ImpactState, Problem
from calib.simulators.impact.scratch import Scratch


def _none_to_hold(problem: Problem, r: int, state: ImpactState, time: float, step: float, w: Scratch) -> int:
    """Leave the loads at zero, over however long a step."""
    return LOADS_HOLD


def _none_to_set(problem: Problem, state: ImpactState, time: float, step: float, w: Scratch) -> None:
    """Leave the loads at zero."""


set_loads = by_loads(_none_to_hold, collocate, ENCLOSED)
set_loads_without_laws = by_loads(_none_to_set, set_given_loads, ENCLOSED)
