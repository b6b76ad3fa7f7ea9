"""A tossed cube, up and down: a simulator by a third party of flight and impact of the lowest corner."""

import numpy as np
from numba import njit
from scipy.interpolate import CubicSpline

from calib.errors import CalibError
from calib.modelling.laws import STATES, at_site
from calib.modelling.parameter import Parameter
from calib.records import failed, make
from calib.simulators.law_calls import addresses
from calib.simulators.law_calls import force as force_law
from calib.simulators.law_calls import restitution as restitution_law

STEPS = 8  # from one sample of the rotation to the next
CUTS = 40  # of an interval in which the corner touches
MOST = 1000  # impacts that are noted


class CubeOnTable:
    """Vertical motion of the centre over the height at which the lowest corner touches.

    z'' = -g + laws in flight. The rotation is measured and put in: the `base motion` of the `table` is the height U(t)
    of the centre at which the lowest corner touches z = 0, a cubic spline through its samples. Where z - U + gap, the
    gap being the sum of its laws, falls to zero, the corner's velocity turns by Newton's restitution; when it would
    not leave within a step it stays, until the acceleration lifts it.
    """

    name = "cube_on_table"
    bodies = ("cube",)
    places = {"body": ("cube",)}
    excitations = frozenset({("base motion", "table")})
    sites = frozenset({"force", "gap", "restitution"})
    initial = {"initial_height": ("cube", "displacement"), "initial_velocity": ("cube", "velocity")}
    parameters = (
        Parameter("gravity", "m/s^2", 9.81, "gravity", low=0.0),
        Parameter("restitution", "1", 0.1, "Newton's coefficient of the corner", low=0.0, high=1.0),
        Parameter("initial_height", "m", 0.1, "height of the centre at the first sample"),
        Parameter("initial_velocity", "m/s", 0.0, "vertical velocity at the first sample"),
    )

    def run(self, values, excitation, laws, request):
        """Return the record of the centre at the times asked for, or at the samples of the rotation."""
        if (excitation.quantity, excitation.place) not in self.excitations or not excitation.recorded:
            raise CalibError(
                f"the cube takes a recorded base motion of the 'table', got {excitation.quantity} at {excitation.place}"
            )
        attrs = {"place": excitation.place, "quantity": excitation.quantity}
        for name, value in values.items():
            if not np.isfinite(value):
                return failed(self.bodies, "impossible value", f"{name} is {value}", **attrs)
        if request.step_budget < STEPS * excitation.time.size:
            return failed(self.bodies, "step budget", f"{STEPS * excitation.time.size} steps are needed", **attrs)
        gap = sum(law.function(0.0, law.p) for law in at_site(laws, "gap"))
        floor = CubicSpline(excitation.time, excitation.value - gap)
        motion, impacts = _bounce(
            floor.x,
            np.ascontiguousarray(floor.c),
            np.array([values[p.name] for p in self.parameters]),
            *addresses(laws, "force"),
            *addresses(laws, "restitution"),
        )
        if not np.isfinite(motion).all():
            return failed(self.bodies, "diverged", "the motion is not finite", **attrs)
        times = excitation.time if request.times is None else request.times
        seen = [np.interp(times, excitation.time, row)[None] for row in motion]
        channels = {"displacement": seen[0], "velocity": seen[1]}
        return make(times, self.bodies, channels, impacts=(impacts[:, 0], impacts[:, 1]), **attrs)


@njit(cache=True)
def _floor(c, s):
    """Height, rate and acceleration of the floor, `s` [s] after the start of its piece c (4,)."""
    height = c[3] + s * (c[2] + s * (c[1] + s * c[0]))
    return height, c[2] + s * (2.0 * c[1] + 3.0 * s * c[0]), 2.0 * c[1] + 6.0 * s * c[0]


@njit(cache=True)
def _acceleration(t, x, v, gravity, functions, p, count, z, dz):
    total = -gravity
    for i in range(count):
        total += force_law(functions[i], t, x, v, p[i], z[i], dz[i])
    return total


@njit(cache=True)
def _touch(c, s, x, v, a, h):
    """Part of the flight of `h` [s] from (x, v) at constant acceleration that lies above the floor."""
    low, high = 0.0, h
    for _ in range(CUTS):
        middle = 0.5 * (low + high)
        if x + middle * (v + 0.5 * middle * a) < _floor(c, s + middle)[0]:
            high = middle
        else:
            low = middle
    return high


@njit(cache=True)
def _restitution(e, speed, functions, p, count):
    for i in range(count):
        e += restitution_law(functions[i], e, speed, p[i])
    return min(max(e, 0.0), 1.0)


@njit(cache=True)
def _bounce(time, pieces, values, functions, p, count, e_functions, e_p, e_count):
    """Height and velocity (2, n) at the samples, and instant and closing speed (m, 2) of the impacts."""
    gravity, e, x, v = values
    motion, impacts, number = np.zeros((2, time.size)), np.zeros((MOST, 2)), 0
    z, dz = np.zeros((p.shape[0], STATES)), np.zeros((p.shape[0], STATES))
    resting = False
    motion[0, 0], motion[1, 0] = x, v
    for n in range(time.size - 1):
        c = pieces[:, n]
        h = (time[n + 1] - time[n]) / STEPS
        for k in range(STEPS):
            s, left = k * h, h
            while left > 0.0:
                a = _acceleration(time[n] + s, x, v, gravity, functions, p, count, z, dz)
                if resting and a > _floor(c, s)[2]:
                    resting = False
                if resting:
                    x, v, _ = _floor(c, s + left)
                    z += left * dz
                    break
                middle = x + 0.5 * left * v, v + 0.5 * left * a, z + 0.5 * left * dz
                a = _acceleration(time[n] + s + 0.5 * left, middle[0], middle[1], gravity, functions, p, count,
                                  middle[2], dz)  # fmt: skip
                part = left
                if x + left * (v + 0.5 * left * a) < _floor(c, s + left)[0]:
                    part = _touch(c, s, x, v, a, left)
                x, v, z = x + part * (v + 0.5 * part * a), v + part * a, z + part * dz
                s, left = s + part, left - part
                if left <= 0.0:
                    break
                x, rate, lift = _floor(c, s)
                speed = rate - v
                if speed > 0.0:
                    if number < MOST:
                        impacts[number, 0], impacts[number, 1] = time[n] + s, speed
                        number += 1
                    v = rate + _restitution(e, speed, e_functions, e_p, e_count) * speed
                resting = a <= lift and v - rate < 0.5 * h * (lift - a)
        motion[0, n + 1], motion[1, n + 1] = x, v
    return motion, impacts[:number]
