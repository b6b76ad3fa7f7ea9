"""A force law that is a free function of one or two arguments: the coefficients of cubic B-splines are its parameters.

Breakpoints t_0 < ... < t_m of each argument span the region that the records visit; end knots are repeated, so that m
intervals have m + 3 basis functions (de Boor, A Practical Guide to Splines, 2001, chapter 9). Beyond the region each
function is continued linearly. The force is linear in its coefficients, and absent where all of them are zero.

An odd function has opposite values at opposite states. Coefficients of basis functions that mirror each other at zero
are then opposite, and the upper half of them are its parameters.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

from calib.modelling.effect import Effect
from calib.modelling.laws import Law, force
from calib.modelling.parameter import Parameter

DISPLACEMENT, VELOCITY = "displacement", "velocity"
UNITS = {DISPLACEMENT: "m", VELOCITY: "m/s"}
SYMBOLS = {DISPLACEMENT: "x", VELOCITY: "v"}
INTERVALS = {(DISPLACEMENT,): 12, (VELOCITY,): 16, (DISPLACEMENT, VELOCITY): 5}  # of each argument  [count]
GRADE = 2.2  # exponent by which breakpoints of the velocity alone are denser at rest, where friction turns about  [1]
DEGREE = 3  # of the splines
SURFACE_COEFFICIENTS = (INTERVALS[DISPLACEMENT, VELOCITY] + DEGREE) ** 2


@njit(cache=True)
def _weights(
    u: float, p: np.ndarray, first: int, intervals: int
) -> tuple[int, float, float, float, float]:  # pragma: no cover - compiled
    """Number of the first of the four basis functions that act at u, and their values; continued linearly outside.

    The breakpoints are p[first : first + intervals + 1]. Piegl & Tiller, The NURBS Book (1997), algorithm A2.2.
    """
    last = first + intervals
    if u <= p[first]:
        s = 3.0 * (u - p[first]) / (p[first + 1] - p[first])
        return 0, 1.0 - s, s, 0.0, 0.0
    if u >= p[last]:
        s = 3.0 * (u - p[last]) / (p[last] - p[last - 1])
        return intervals - 1, 0.0, 0.0, -s, 1.0 + s
    i = first
    while u >= p[i + 1]:
        i += 1
    l1, l2, l3 = u - p[i], u - p[max(i - 1, first)], u - p[max(i - 2, first)]
    r1, r2, r3 = p[i + 1] - u, p[min(i + 2, last)] - u, p[min(i + 3, last)] - u
    n0, n1 = r1 / (r1 + l1), l1 / (r1 + l1)
    a, b = n0 / (r1 + l2), n1 / (r2 + l1)
    n0, n1, n2 = r1 * a, l2 * a + r2 * b, l1 * b
    a, b, c = n0 / (r1 + l3), n1 / (r2 + l2), n2 / (r3 + l1)
    return i - first, r1 * a, l3 * a + r2 * b, l2 * b + r3 * c, l1 * c


@njit(cache=True)
def curve(u: float, p: np.ndarray) -> float:  # pragma: no cover - compiled
    """Function of one argument: p holds the number of intervals m, m + 1 breakpoints, m + 3 coefficients."""
    m = int(p[0])
    i, a, b, c, d = _weights(u, p, 1, m)
    k = m + 2 + i
    return a * p[k] + b * p[k + 1] + c * p[k + 2] + d * p[k + 3]


@njit(cache=True)
def _mirrored(k: int, p: np.ndarray, first: int, count: int) -> float:  # pragma: no cover - compiled
    """Coefficient k of `count` of an odd function, the upper half of which p holds from `first` on."""
    lower = count - count // 2
    if k >= lower:
        return p[first + k - lower]
    if k < count // 2:
        return -p[first + count - 1 - k - lower]
    return 0.0


@njit(cache=True)
def odd_curve(u: float, p: np.ndarray) -> float:  # pragma: no cover - compiled
    """Odd function of one argument: p as of `curve`, but for the coefficients: the upper half of them."""
    m = int(p[0])
    i, a, b, c, d = _weights(u, p, 1, m)
    total = 0.0
    for k, weight in enumerate((a, b, c, d)):
        total += weight * _mirrored(i + k, p, m + 2, m + 3)
    return total


@force
def odd_along_x(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2] at the displacement x [m]: an odd function."""
    return odd_curve(x, p)


@force
def odd_along_v(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2] at the velocity v [m/s]: an odd function."""
    return odd_curve(v, p)


@force
def along_x(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2] at the displacement x [m]: sum of c_k B_k(x)."""
    return curve(x, p)


@force
def along_v(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2] at the velocity v [m/s]: sum of c_k B_k(v)."""
    return curve(v, p)


@njit(cache=True)
def surface(x: float, v: float, p: np.ndarray) -> float:  # pragma: no cover - compiled
    """Function of two arguments.

    p holds the numbers of intervals m and n, m + 1 breakpoints of x, n + 1 of v, (m + 3) (n + 3) coefficients, those of
    one k after the other.
    """
    m, n = int(p[0]), int(p[1])
    i, a0, a1, a2, a3 = _weights(x, p, 2, m)
    j, b0, b1, b2, b3 = _weights(v, p, m + 3, n)
    row = n + 3
    k = m + n + 4 + i * row + j
    total = a0 * (b0 * p[k] + b1 * p[k + 1] + b2 * p[k + 2] + b3 * p[k + 3])
    k += row
    total += a1 * (b0 * p[k] + b1 * p[k + 1] + b2 * p[k + 2] + b3 * p[k + 3])
    k += row
    total += a2 * (b0 * p[k] + b1 * p[k + 1] + b2 * p[k + 2] + b3 * p[k + 3])
    k += row
    return total + a3 * (b0 * p[k] + b1 * p[k + 1] + b2 * p[k + 2] + b3 * p[k + 3])


@force
def over_states(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2] at x [m] and v [m/s]: sum of c_kl B_k(x) B_l(v)."""
    return surface(x, v, p)


@njit(cache=True)
def odd_surface(x: float, v: float, p: np.ndarray) -> float:  # pragma: no cover - compiled
    """Odd function of two arguments: p as of `surface`, but for the coefficients: the upper half of them."""
    m, n = int(p[0]), int(p[1])
    i, a0, a1, a2, a3 = _weights(x, p, 2, m)
    j, b0, b1, b2, b3 = _weights(v, p, m + 3, n)
    total = 0.0
    for k, a in enumerate((a0, a1, a2, a3)):
        for q, b in enumerate((b0, b1, b2, b3)):
            total += a * b * _mirrored((i + k) * (n + 3) + j + q, p, m + n + 4, (m + 3) * (n + 3))
    return total


@force
def odd_over_states(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2] at x [m] and v [m/s]: opposite at opposite states."""
    return odd_surface(x, v, p)


LAWS: dict[tuple[str, ...], Law] = {
    (DISPLACEMENT,): along_x,
    (VELOCITY,): along_v,
    (DISPLACEMENT, VELOCITY): over_states,
}
ODD_LAWS: dict[tuple[str, ...], Law] = {
    (DISPLACEMENT,): odd_along_x,
    (VELOCITY,): odd_along_v,
    (DISPLACEMENT, VELOCITY): odd_over_states,
}


@dataclass(frozen=True, eq=False)
class FreeForce:
    """A force on a body that is a free function of its state.

    Attributes
    ----------
    body : on which it acts
    arguments : "displacement", "velocity", or both in this order
    breaks : of each argument, its increasing breakpoints (m + 1,)  [m] or [m/s]
    odd : whether it is opposite at opposite states; breakpoints are then the same on both sides of zero
    """

    body: str
    arguments: tuple[str, ...]
    breaks: tuple[np.ndarray, ...]
    odd: bool = False

    @property
    def name(self) -> str:
        """Name of its effect."""
        return f"free_force_{self.body}_{''.join(SYMBOLS[a] for a in self.arguments)}"

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Names of its coefficients  [m/s^2]."""
        count = self._basis_functions // 2 if self.odd else self._basis_functions
        return tuple(f"{self.name}_c{k:02d}" for k in range(count))

    @property
    def _basis_functions(self) -> int:
        """Number of all basis functions."""
        return int(np.prod([t.size - 1 + DEGREE for t in self.breaks]))

    @cached_property
    def effect(self) -> Effect:
        """Effect of the force, absent where all coefficients are zero; breakpoints are held parameters of it."""
        counts = [float(t.size - 1) for t in self.breaks]
        held = [Parameter(f"{self.name}_intervals_{a}", "1", n, f"intervals of the {a}", low=1.0)
                for a, n in zip(self.arguments, counts, strict=True)]  # fmt: skip
        for argument, breaks in zip(self.arguments, self.breaks, strict=True):
            held += [
                Parameter(f"{self.name}_{argument}_{k:02d}", UNITS[argument], float(t), f"breakpoint of the {argument}")
                for k, t in enumerate(breaks)
            ]
        free = [Parameter(name, "m/s^2", 0.0, "coefficient of a B-spline", null=0.0) for name in self.coefficients]
        return Effect(
            name=self.name,
            site="force",
            law=(ODD_LAWS if self.odd else LAWS)[self.arguments],
            parameters=(*held, *free),
            meaning=f"a free{' odd' * self.odd} function of {' and '.join(self.arguments)} on {self.body}",
            equation=f"f({', '.join(SYMBOLS[a] for a in self.arguments)})",
            bodies=(self.body,),
            cite="de Boor, A Practical Guide to Splines (2001), chapter 9",
        )

    def matrix(self, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Values (n, coefficients) of the basis functions at displacements x (n,) [m] and velocities v (n,) [m/s]."""
        weights = [
            _weight_matrix(np.ascontiguousarray(v if a == VELOCITY else x, dtype=float), t)
            for a, t in zip(self.arguments, self.breaks, strict=True)
        ]
        if len(weights) == 1:
            return self._halved(weights[0])
        return self._halved((weights[0][:, :, None] * weights[1][:, None, :]).reshape(len(x), -1))

    def _halved(self, columns: np.ndarray) -> np.ndarray:
        """Columns (n, coefficients) of columns (n, p) of all basis functions."""
        half = columns.shape[1] // 2
        return columns[:, -half:] - columns[:, :half][:, ::-1] if self.odd else columns

    def all_coefficients(self, own: np.ndarray) -> np.ndarray:
        """Coefficients (p,) of all basis functions, of its own (coefficients,)  [m/s^2]."""
        return self._halved(np.eye(self._basis_functions)) @ own

    @cached_property
    def roughness(self) -> tuple[np.ndarray, ...]:
        """Rows (k, coefficients) of each argument: second differences along it over local distances  [m/s^2].

        The penalty of Eilers & Marx (Statistical Science 11 (1996) 89) for unequal knots: divided differences of the
        coefficients over the means of their knots, times the square of the local distance. Zero for linear functions.
        """
        own = [_second_differences(t) for t in self.breaks]
        if len(own) == 1:
            return (self._halved(own[0]),)
        first, second = (np.eye(d.shape[1]) for d in own)
        return self._halved(np.kron(own[0], second)), self._halved(np.kron(first, own[1]))


def free_force(
    body: str,
    arguments: Sequence[str],
    visited: Mapping[str, tuple[float, float]],
    in_contact: bool = False,
    odd: bool = False,
) -> FreeForce:
    """Return a free force over a visited region.

    Parameters
    ----------
    body : on which it acts
    arguments : "displacement", "velocity", or both
    visited : argument -> its least and largest value in the records  [m], [m/s]
    in_contact : whether the displacement is a clearance that a compliant contact makes negative: half of its intervals
        are then in contact, and half out of it
    odd : whether it is opposite at opposite states: the region is then as wide on both sides of zero
    """
    intervals = INTERVALS[tuple(arguments)]
    grade = GRADE if tuple(arguments) == (VELOCITY,) else 1.0
    breaks = []
    for argument in arguments:
        low, high = visited[argument]
        if odd:
            low, high = -max(-low, high), max(-low, high)
        if in_contact and argument == DISPLACEMENT and low < 0.0 < high:
            within = intervals // 2
            out = breakpoints(0.0, high, intervals - within)
            breaks.append(np.concatenate([breakpoints(low, 0.0, within), out[1:]]))
        else:
            breaks.append(breakpoints(low, high, intervals, grade))
    return FreeForce(body, tuple(arguments), tuple(breaks), odd)


def breakpoints(low: float, high: float, intervals: int, grade: float = 1.0) -> np.ndarray:
    """Breakpoints (intervals + 1,) from low to high; where zero is inside, denser there by an exponent."""
    s = np.linspace(-1.0, 1.0, intervals + 1)
    if grade != 1.0 and low < 0.0 < high:
        graded = np.sign(s) * np.abs(s) ** grade
        return np.where(graded < 0.0, -low * graded, high * graded)
    return low + 0.5 * (1.0 + s) * (high - low)


@njit(cache=True)
def _weight_matrix(u: np.ndarray, breaks: np.ndarray) -> np.ndarray:  # pragma: no cover - compiled
    """Values (n, m + 3) of the basis functions of breakpoints (m + 1,) at u (n,)."""
    m = breaks.size - 1
    matrix = np.zeros((u.size, m + 3))
    for row in range(u.size):
        i, a, b, c, d = _weights(u[row], breaks, 0, m)
        matrix[row, i], matrix[row, i + 1], matrix[row, i + 2], matrix[row, i + 3] = a, b, c, d
    return matrix


def _second_differences(breaks: np.ndarray) -> np.ndarray:
    """Second differences (m + 1, m + 3) of the coefficients of breakpoints (m + 1,)."""
    knots = np.concatenate([[breaks[0]] * DEGREE, breaks, [breaks[-1]] * DEGREE])
    place = np.array([knots[k + 1 : k + 1 + DEGREE].mean() for k in range(breaks.size - 1 + DEGREE)])
    first = np.diff(np.eye(place.size), axis=0) / np.diff(place)[:, None]
    spread = 0.5 * (place[2:] - place[:-2])
    return np.diff(first, axis=0) * spread[:, None]
