"""The arrays that a step is worked out in."""

from typing import NamedTuple

import numpy as np

from calib.modelling.laws import STATES
from calib.simulators.impact.problem import Problem

ORDER = 40  # highest, of the Taylor series of the motion in a compliant contact
TRUNCATION = 1e-13  # terms of the series below that share of the largest are left out
BRANCHES, TERMS = 12, 16  # at most, of its double series from the crossing on
COMPOSED = 13  # terms of the polynomials of the loads in a fictitious time
# rows of `Scratch.contact`: series of the penetration, its rate, the force and what these are made of; what is known of
# the series; in a fictitious time the impulse of the force and the way it makes; from `MODES` on the series of the
# modes, in a fictitious time of what they do beside the force, with velocities and accelerations
DEPTH, RATE, FORCE, POWER, WITNESS, BY_DEPTH, BY_RATE, BY_LOSS, KNOWN, IMPULSE, MOVED, MODES = range(12)
# entries of the row `KNOWN`: order of the series; whether the force has its part of d^n; what ends the step; length of
# step over which the series under the force held last [s]; time next to d = 0 over which d^n makes next to nothing of
# the velocity [s], both 0 before the first; which series serve, of `series` (TIME), of `crossing` (LATTICE) or of
# `fictitious_time` (FICTITIOUS); sums of the sizes of the terms beyond the first, of the penetration [m] and of its
# rate times the step [m]; when the contact began since the whole period, NaN where that is not known [s]; order of the
# modes beside the force; and from `PACE` on the rate of time over the fictitious one, by powers of that [s]
LAST, STIFF, END, HELD, SMALL, SERIES, SPREAD, SPREAD_OF_RATE, BEGAN, MODAL_LAST, PACE = range(11)
TIME, LATTICE, FICTITIOUS = range(3)  # entries of SERIES

# rows of `Scratch.place`: displacement [m] and velocity [m/s]; the sum of the force laws there, its derivative by the
# velocity and the sum that the loads are made of
POSITION, VELOCITY, SUM, BY_VELOCITY, LOADING = range(5)
SOLVED = 1  # entry of `Scratch.resolved_step`


class Scratch(NamedTuple):
    """Arrays a step is worked out in; the last index counts coefficients in tau / step (5) or nodes and probe (6)."""

    input: np.ndarray  # (5,) U
    load: np.ndarray  # (n, 5) modal
    base: np.ndarray  # (n, 5) modal load of what does not depend on the motion
    added: np.ndarray  # (5,) to the witness
    law: np.ndarray  # (n, 6) accelerations by the laws
    modal: np.ndarray  # (n, 5) at the nodes
    free_q: np.ndarray  # (n + 1, 6) motion without loads of the coordinates and, last, of the clearance
    free_dq: np.ndarray
    response_y: np.ndarray  # (n, 6, 5) point, coefficient: modal motion per unit load
    response_v: np.ndarray
    z: np.ndarray  # (force laws, n + 1, STATES, 6) internal states
    dz: np.ndarray  # their rates
    by_state: np.ndarray  # (force laws, n + 1, STATES, 5) derivative of each rate by its own state
    place: np.ndarray  # (5, n + 1, 6) of the coordinates and, last, of the clearance; rows as above
    coupling: np.ndarray  # (5 n + 5, 5 n + 5) velocity at a place and node per unit of the sum of laws at another
    equations: np.ndarray  # (5 n + 5, 5 n + 6) of the sums, or of one state, at the nodes; the right-hand side last
    law_state: np.ndarray  # (2, STATES) internal states of one law at one place, and their rates
    resolved_step: np.ndarray  # (2,) length of step over which laws held last [s]; whether they were solved for
    y: np.ndarray  # (n,) modal motion at an instant
    v: np.ndarray
    q: np.ndarray  # (n,) coordinates
    dq: np.ndarray
    contact: np.ndarray  # (MODES + 3 n, ORDER + 1) of a compliant contact, rows as above; None where the stop is rigid
    lattice: np.ndarray  # (8 + n, BRANCHES, TERMS) of the same, see `crossing`; None as `contact`
    last: np.ndarray  # (BRANCHES + 1,) last terms of its branches, and their number
    composed: np.ndarray  # (5, COMPOSED) series in a fictitious time of the powers of tau / step


def scratch(problem: Problem) -> Scratch:
    """Allocate what the steps of a problem are worked out in."""
    laws, n, compliant = len(problem.force), len(problem.hit), problem.compliance is not None
    return Scratch(
        np.zeros(5), np.zeros((n, 5)), np.zeros((n, 5)), np.zeros(5), np.zeros((n, 6)), np.zeros((n, 5)),
        np.zeros((n + 1, 6)), np.zeros((n + 1, 6)), np.zeros((n, 6, 5)), np.zeros((n, 6, 5)),
        np.zeros((laws, n + 1, STATES, 6)), np.zeros((laws, n + 1, STATES, 6)),
        np.zeros((laws, n + 1, STATES, 5)), np.zeros((5, n + 1, 6)), np.zeros((5 * n + 5, 5 * n + 5)),
        np.zeros((5 * n + 5, 5 * n + 6)),
        np.zeros((2, STATES)), np.array([np.inf, 0.0]), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n),
        np.zeros((MODES + 3 * n, ORDER + 1)) if compliant else None,  # type: ignore[arg-type]  # as `Problem.compliance`
        np.zeros((8 + n, BRANCHES, TERMS)) if compliant else None,  # type: ignore[arg-type]
        np.zeros(BRANCHES + 1, dtype=np.int64), np.zeros((5, COMPOSED)),
    )  # fmt: skip
