"""Curves of visited states: where all states lie on one, functions of displacement and of velocity coincide.

A force over one argument is then as well a force over the other, and no prediction of these records tells which. Of a
falling body, or of any motion that passes each displacement once, the velocity is a function of the displacement. A
steady motion is a closed curve, of which the square of the velocity is one: there even functions coincide.
"""

import numpy as np

from calib.diagnosis.discovery.free_force import DISPLACEMENT, VELOCITY, free_force
from calib.diagnosis.discovery.penalised import States
from calib.diagnosis.discovery.place import ForcePlace

DISTINCT = 1e-6  # of the visited range of an argument, by which states differ  [1]
MAX_UNEXPLAINED = 0.01  # variance of an argument beside a function of the other, over its own, of a curve  [1]


def is_open_curve(states: States) -> bool:
    """Whether one argument is a function of the other over the visited states."""
    by_x, by_v = _unexplained(states, DISPLACEMENT, states.v), _unexplained(states, VELOCITY, states.x)
    return min(by_x, by_v) < MAX_UNEXPLAINED


def is_closed_curve(states: States) -> bool:
    """Whether the square of the velocity is a function of the displacement over the visited states."""
    return _unexplained(states, DISPLACEMENT, states.v**2) < MAX_UNEXPLAINED


def curve_in_words(states: States, place: ForcePlace) -> str:
    """What coincides over the visited states, and which record would tell it apart; "" where nothing does."""
    if not states.x.size or any(low == high for low, high in states.region.values()):
        return ""
    x, v = place.in_words(DISPLACEMENT), place.in_words(VELOCITY)
    where = f"{place.preposition} {place.name} all records visit one curve of {x} and {v}"
    if is_open_curve(states):
        return (
            f"{where}: a force over one of them is as well a force over the other. A record that passes the same "
            "states of one with others of the other tells them apart: another initial velocity, amplitude or "
            'frequency, with use = "name"'
        )
    if is_closed_curve(states):
        return (
            f"{where}, a closed one: even functions of both, such as x^2 and v^2, coincide there, and products of both "
            'are not determined. Records of further amplitudes, or a free decay, tell them apart, with use = "name"'
        )
    return ""


def _unexplained(states: States, argument: str, values: np.ndarray) -> float:
    """Share of the variance of values (n,) that no smooth function of an argument explains; as many as few states tell.

    Not below what the function would explain of independent values.
    """
    centred = values - values.mean()
    basis = free_force("", (argument,), states.region).matrix(states.x, states.v)
    coefficients, _, rank, _ = np.linalg.lstsq(basis, centred, rcond=None)
    rest, known = centred - basis @ coefficients, _distinct(states)
    if known <= rank:  # the function passes through each of them, whatever they are
        return 1.0
    return float(rest @ rest) * known / (known - rank) / max(float(centred @ centred), 1e-300)


def _distinct(states: States) -> int:
    """Number of states that differ: the cycles of a steady motion repeat theirs."""
    both = np.column_stack([states.x, states.v])
    return len(np.unique(np.round(both / (DISTINCT * np.ptp(both, axis=0).clip(1e-300))), axis=0))
