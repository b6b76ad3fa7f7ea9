"""Period maps in closed form that turn on tori, or meet a stop."""

import numpy as np
from dynamics.plain_maps import PlainMap

GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
SILVER = np.sqrt(2.0) - 1.0
PULL = 0.2  # of the circle: a distance from it shrinks by 1 - 2 PULL a period


def circle(turn=GOLDEN):
    """Turn by `turn` of a circle and a pull to radius 1: exponents 0 and ln(1 - 2 PULL)."""
    return PlainMap(lambda x: _turned(x, turn), lambda x: _turned_slope(x, turn), [0.3, 0.4])


def torus(turns=(GOLDEN, SILVER)):
    """Two circles at once: a torus of two dimensions in four."""

    def derivative(x):
        slope = np.zeros((4, 4))
        slope[:2, :2], slope[2:, 2:] = _turned_slope(x[:2], turns[0]), _turned_slope(x[2:], turns[1])
        return slope

    return PlainMap(
        lambda x: np.concatenate([_turned(x[:2], turns[0]), _turned(x[2:], turns[1])]), derivative, [0.3, 0.4, 0.5, 0.2]
    )


def spiral(shrink, turn=0.1234):
    """Turn and shrink to a fixed point at exactly zero, with exponent ln(shrink)."""
    return PlainMap(lambda x: shrink * _rotation(turn) @ x, lambda x: shrink * _rotation(turn), [0.3, 0.4])


class Struck:
    """A map that meets a stop, `strikes(x)` times in the period that begins at x."""

    impacting = True

    def __init__(self, map, strikes):
        self.map, self.strikes = map, strikes
        self.period, self.bodies, self.names, self.units = map.period, map.bodies, map.names, map.units
        self.scale, self.initial, self.tangent, self.near_misses = map.scale, map.initial, map.tangent, map.near_misses

    def orbit(self, state, periods):
        orbit = self.map.orbit(state, periods)
        begun = [state, *orbit.states[:-1]]
        rows = [(k, 0.5, 1.0) for k, x in enumerate(begun) for _ in range(self.strikes(x))]
        return orbit._replace(impacts=np.array(rows).reshape(-1, 3))


def _rotation(turn):
    c, s = np.cos(2.0 * np.pi * turn), np.sin(2.0 * np.pi * turn)
    return np.array([[c, -s], [s, c]])


def _turned(x, turn):
    return _rotation(turn) @ x * (1.0 + PULL * (1.0 - x @ x))


def _turned_slope(x, turn):
    return _rotation(turn) @ ((1.0 + PULL * (1.0 - x @ x)) * np.eye(2) - 2.0 * PULL * np.outer(x, x))
