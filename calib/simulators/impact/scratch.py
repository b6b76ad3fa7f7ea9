"""The arrays that a step is worked out in."""

from typing import NamedTuple

import numpy as np

from calib.laws import SLOTS, STATES


class Scratch(NamedTuple):
    """Arrays a step is worked out in; the last index counts coefficients in tau / step, or nodes."""

    input: np.ndarray  # (5,) U
    load: np.ndarray  # (n, 5) modal
    base: np.ndarray  # (n, 5) modal load of what does not depend on the motion
    added: np.ndarray  # (5,) to the witness
    law: np.ndarray  # (n, 5) accelerations by the laws at the nodes
    modal: np.ndarray  # (n, 5) at the nodes
    free_y: np.ndarray  # (n, 5) unloaded motion at the nodes
    free_v: np.ndarray
    answer_y: np.ndarray  # (n, 5, 5) node, coefficient: modal motion per unit load
    answer_v: np.ndarray
    z: np.ndarray  # (SLOTS, n + 1, STATES, 5) internal states at the nodes
    dz: np.ndarray  # their rates
    own: np.ndarray  # (2, STATES) internal states of one law at one place, and their rates
    y: np.ndarray  # (n,) modal motion at an instant
    v: np.ndarray
    q: np.ndarray  # (n,) coordinates
    dq: np.ndarray


def scratch(n: int) -> Scratch:
    """Allocate for n coordinates."""
    return Scratch(
        np.zeros(5), np.zeros((n, 5)), np.zeros((n, 5)), np.zeros(5), np.zeros((n, 5)), np.zeros((n, 5)),
        np.zeros((n, 5)), np.zeros((n, 5)), np.zeros((n, 5, 5)), np.zeros((n, 5, 5)),
        np.zeros((SLOTS, n + 1, STATES, 5)), np.zeros((SLOTS, n + 1, STATES, 5)),
        np.zeros((2, STATES)), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n),
    )  # fmt: skip
