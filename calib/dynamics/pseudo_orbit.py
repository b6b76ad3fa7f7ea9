"""Pseudo-orbits: runs of an irregular motion that are the same on all processors.

Two processors differ by 1e-16 at each step, and a chaotic map doubles that every few periods, so that after some
hundred periods they follow different orbits. Here the state is put onto a lattice of 6e-8 of the map's scale every 32
periods: until then rounding has grown to a small share of the lattice, and both go on from the same state. What is
followed is a pseudo-orbit, which a true orbit shadows for as long as the motion is hyperbolic.

Source: Hammel, Yorke and Grebogi, Journal of Complexity 3 (1987) 136-145 (shadowing of noisy orbits).
"""

import math

import numpy as np

from calib.dynamics.tangent import tangent
from calib.modelling.orbit import Orbit, PeriodMap, Tangent
from calib.records import OK

PERIODS_PER_PIECE = 32  # periods from one state of the lattice to the next
LATTICE_SPACING = 1e-7 / math.sqrt(3.0)  # of the lattice, as a share of the map's scale; no decimal but 0 lies on it


def on_lattice(map: PeriodMap, state: np.ndarray) -> np.ndarray:
    """State (dimension,) of the lattice that is nearest to another."""
    quantum = LATTICE_SPACING * map.scale
    return np.round(np.asarray(state, dtype=float) / quantum) * quantum


def pseudo_orbit(map: PeriodMap, state: np.ndarray, periods: int) -> Orbit:
    """Go on from `state` (dimension,) by whole periods, in pieces that begin on the lattice."""
    pieces: list[Orbit] = []
    gone = 0
    while gone < periods and (not pieces or pieces[-1].status == OK):
        piece = map.orbit(on_lattice(map, state), min(PERIODS_PER_PIECE, periods - gone))
        pieces.append(piece._replace(impacts=piece.impacts + np.array([gone, 0.0, 0.0])))
        gone += len(piece.states)
        state = piece.states[-1] if len(piece.states) else state
    lengths = [len(piece.states) for piece in pieces]
    return Orbit(
        np.concatenate([piece.states for piece in pieces]),
        np.concatenate([piece.displacement for piece in pieces], axis=1),
        np.concatenate([piece.velocity for piece in pieces], axis=1),
        np.concatenate([piece.impacts for piece in pieces]),
        float(np.dot(lengths, [piece.contact for piece in pieces]) / max(1, gone)),
        pieces[-1].status,
        pieces[-1].reason,
    )


def pseudo_tangent(map: PeriodMap, state: np.ndarray, vectors: np.ndarray, periods: int) -> Tangent:
    """Carry `vectors` (dimension, m), in units of the scale, along the pseudo-orbit from `state`."""
    pieces: list[Tangent] = []
    gone = 0
    while gone < periods:
        asked = min(PERIODS_PER_PIECE, periods - gone)
        piece = tangent(map, on_lattice(map, state), vectors, asked)
        pieces.append(piece)
        gone += len(piece.states)
        if len(piece.states) < asked:
            break
        state, vectors = piece.states[-1], piece.vectors
    return Tangent(
        np.concatenate([piece.states for piece in pieces]),
        pieces[-1].vectors,
        np.concatenate([piece.growth for piece in pieces]),
    )
