"""The kind of motion that one run of a period map settles to: periodic, quasi-periodic or chaotic."""

import numpy as np

from calib.dynamics.exponents import ALIGNMENT_PERIODS
from calib.dynamics.irregular import MAX_INTERMITTENT_PERIODS, kind_of_irregular
from calib.dynamics.orbit_kind import FAILED, OrbitKind
from calib.dynamics.recurrence import MAX_LAG_PERIODS, NEAR_CYCLE_DISTANCE, recurrence_of, size_of
from calib.dynamics.settling import TAIL_PERIODS, settled_orbit
from calib.dynamics.tangent import tangent
from calib.errors import CalibError
from calib.modelling.orbit import PeriodMap
from calib.records.cycles.motion import UNDECIDED

MIN_SECTION_CYCLES = 96  # kept: a third of them then see a return after 64 periods
RETRY_FACTOR = 5  # times `settle` that a motion gets to settle before it is given up as undecided


def kind_of_run(map: PeriodMap, state: np.ndarray, settle: int = 1000, cycles: int = 100) -> OrbitKind:
    """Return the kind of motion that one run settles to from a state.

    1. The transient is dropped: until the state returns after 1..64 periods within 1e-9 of the motion's size, at most
       `settle` periods. A motion that comes ever closer to a stable cycle is taken there by Newton's method.
    2. `cycles` periods are kept. The smallest n = 1..64 after which all of them return within 1e-6 is the period,
       unless by the multipliers the remaining transient could still lead to a shorter one.
    3. Otherwise the largest exponent over 400 periods (up to 3200 while it is not significant, and to 25600 where one
       of the two indicates chaos) and the 0-1 test on the section have to agree: chaotic above zero, quasi-periodic at
       zero. A motion that still settles is neither; one that returns after more than 64 periods is periodic where its
       multipliers show that it attracts.
    4. An undecided motion gets 5 times `settle` periods more, after a push off the unstable cycle of a laminar phase,
       and is undecided after that.

    A motion that does not return is followed as a pseudo-orbit (`calib.dynamics.pseudo_orbit`), which is the same one
    on all processors though it is chaotic.

    The size of a motion is the largest component of its section in units of the map's scale.

    Parameters
    ----------
    state : (dimension,) to start from
    settle : periods dropped at most before the first verdict
    cycles : periods kept, 96 or more

    Raises
    ------
    CalibError : fewer than 96 cycles
    """
    if cycles < MIN_SECTION_CYCLES:
        raise CalibError(
            f"expected at least {MIN_SECTION_CYCLES} cycles to keep, got {cycles}; "
            f"a return after {MAX_LAG_PERIODS} needs them"
        )
    motion = settled_orbit(map, state, settle, cycles)
    if motion.kind != UNDECIDED:
        return motion
    motion = kind_of_irregular(map, motion)
    if motion.kind != UNDECIDED or len(motion.visited) > MAX_INTERMITTENT_PERIODS:
        return motion
    start, gone = _beyond_laminar_phase(map, motion), motion.dropped + cycles
    again = settled_orbit(map, start, RETRY_FACTOR * settle, cycles, gone)
    if again.kind == FAILED and start is not motion.state:  # pushed to where there is no motion
        again = settled_orbit(map, motion.state, RETRY_FACTOR * settle, cycles, gone)
    return again if again.kind != UNDECIDED else kind_of_irregular(map, again)


def _beyond_laminar_phase(map: PeriodMap, motion: OrbitKind) -> np.ndarray:
    """State (dimension,) from which an undecided motion continues: its own, or one off the cycle of a laminar phase.

    A run that comes near such a cycle by chance stays for as many periods as 1 / exponent, many times over, and none of
    them tells what motion it belongs to (laminar phase of intermittency: Pomeau and Manneville, Communications in
    Mathematical Physics 74 (1980) 189). It is pushed along the direction that grows most, to the side to which it goes.
    """
    if not motion.laminar:
        return motion.state
    section = motion.visited[-TAIL_PERIODS:] / map.scale
    lag = int(np.argmin(recurrence_of(section))) + 1
    grown = tangent(map, motion.state, np.ones((motion.state.size, 1)), ALIGNMENT_PERIODS + 2 * lag)
    if len(grown.states) < ALIGNMENT_PERIODS + 2 * lag:
        return motion.state
    direction, going = grown.vectors[:, 0], (grown.states[-1] - grown.states[-1 - 2 * lag]) / map.scale
    side = -1.0 if going @ direction < 0.0 else 1.0  # after twice the lag, a cycle that flips is on the same side
    return grown.states[-1] + side * NEAR_CYCLE_DISTANCE * size_of(section) * direction * map.scale
