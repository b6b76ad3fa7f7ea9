"""A beam with a delaminated layer as another finite-element code would have it: Timoshenko elements, Hertzian contact.

Half of a beam of length L that is symmetric about x = 0. It consists of a remaining beam and a layer above it for
x < a, and of a solid beam beyond; at the tip of the delamination, x = a, the three have one cross-section, which stays
plane. The upper side of the remaining beam follows X(t) at x = 0 [m]; a support holds the solid beam at x = s.

Bending is that of Timoshenko elements of two nodes, with the exact static shapes of deflection w [m] and rotation
theta [1], consistent mass and rotary inertia (Przemieniecki, Theory of Matrix Structural Analysis, 1968, sections 5.6
and 11.3). Each member k of the delaminated part has an axial force that is uniform along it, after von Karman [N]

    N_k = (E A_k / a) (u_k + 1/2 integral of w_k'^2 over 0..a),  u_k = u - (y_k - y) theta(a)

with u the axial displacement of the solid beam, and y_k, y the heights of the centroids (Reddy, Nonlinear Finite
Element Analysis, 2004, section 4.2). Damping is alpha M + b K. With penetration p = w_beam - w_layer - g, contact
presses by (Hunt & Crossley, Journal of Applied Mechanics 42 (1975) 440)

    K p^(3/2) (1 + c p'), no less than 0                                                                    [Pa]

at two Gauss points of each element. All of that is projected upon modes with the drive held and the static shape of
the drive, and integrated by the classical Runge-Kutta method of order four. The plane cross-section at the tip is
stiffer than plane stress is there: 157 Hz for the first mode of `hidden.beam`, where quadrilaterals have 154 Hz.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.linalg import eigh

INNER, BEFORE, AFTER = 14, 3, 9  # elements from the middle to the tip, to the support, to the end of the beam
SHEAR_COEFFICIENT = 5.0 / 6.0  # of a rectangle  [1]
MODES = 44
STEPS = 6000  # of a period
CONTACT_STIFFNESS = 1.3e12  # K  [Pa/m^1.5]: a layer of 10 mm rests some 10 um deep
CONTACT_LOSS = 200.0  # c  [s/m]: an impact at 0.5 m/s takes 20 us and does not rebound
STIFFNESS_DAMPING = 4e-8  # b  [s]: 0.3 % of critical at 25 kHz
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(2)
POINTS, WEIGHTS = 0.5 * (1.0 + POINTS), 0.5 * WEIGHTS  # of elements from 0 to 1
FINE, FINE_WEIGHTS = np.polynomial.legendre.leggauss(4)  # exact for products of two of the shapes
FINE, FINE_WEIGHTS = 0.5 * (1.0 + FINE), 0.5 * FINE_WEIGHTS
SETTLED = 1e-8  # change of the state over a period, relative to its largest displacement and velocity
PERIODS = 60  # at most until then


class Section(NamedTuple):
    """Cross-section of a member: thickness, width [m], Young's modulus [Pa], Poisson's ratio [1], density [kg/m^3]."""

    thickness: float
    width: float
    young: float
    poisson: float
    density: float

    @property
    def area(self) -> float:
        """[m^2]."""
        return self.thickness * self.width

    @property
    def inertia(self) -> float:
        """Second moment of area  [m^4]."""
        return self.area * self.thickness**2 / 12.0

    def shear_ratio(self, length: float) -> float:
        """Phi = 12 E I / (kappa G A l^2) of an element of this length [m]  [1]."""
        shear = 0.5 * self.young / (1.0 + self.poisson)
        return 12.0 * self.young * self.inertia / (SHEAR_COEFFICIENT * shear * self.area * length**2)


class Plant(NamedTuple):
    """A beam in coordinates z = (q, X): n modes of unit mass, and the displacement of the drive.

    Attributes
    ----------
    square, decay : (n,) omega^2 [1/s^2] and alpha + b omega^2 [1/s]
    push : (n,) modal force of X'' + alpha X'  [kg^0.5]
    axial : (2, n + 1) u_k of remaining beam and layer by z
    bent : (2, n + 1, n + 1) integral of w_k' w_k' by z and z
    rigidity : (2,) E A_k / a  [N/m]
    opening : (m, n + 1) deflection of the layer less that of the remaining beam at the points of contact, by z
    gap, weight : (m,) clearance at rest [m], length that belongs to a point times the width [m^2]
    layer : (m, n + 1) deflection of the layer at these points, by z
    mass : (m,) of the layer that belongs to a point  [kg]
    centre : (n + 1,) deflection of the layer in the middle, by z
    alpha : [1/s]
    """

    square: np.ndarray
    decay: np.ndarray
    push: np.ndarray
    axial: np.ndarray
    bent: np.ndarray
    rigidity: np.ndarray
    opening: np.ndarray
    gap: np.ndarray
    weight: np.ndarray
    layer: np.ndarray
    mass: np.ndarray
    centre: np.ndarray
    alpha: float


class Settled(NamedTuple):
    """One period of a motion that returns, at equal steps from time zero, both ends included.

    Attributes
    ----------
    time : (k + 1,)  [s]
    displacement, velocity : (2, k + 1) of the middle of the remaining beam, and of the layer  [m], [m/s]
    pressed : (k + 1,) force of contact on the whole layer  [N]
    periods : until it returned
    """

    time: np.ndarray
    displacement: np.ndarray
    velocity: np.ndarray
    pressed: np.ndarray
    periods: int


def shapes(place: float, length: float, phi: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Deflection, rotation and slope of the deflection by an element's (w1, theta1, w2, theta2), (4,) each.

    place : along the element, 0 to 1; phi : ratio of the bending to the shear stiffness, see `Section`  [1]
    """
    z, scale = place, 1.0 / (1.0 + phi)
    w = np.array([
        1.0 - 3.0 * z**2 + 2.0 * z**3 + phi * (1.0 - z),
        length * (z - 2.0 * z**2 + z**3 + 0.5 * phi * (z - z**2)),
        3.0 * z**2 - 2.0 * z**3 + phi * z,
        length * (z**3 - z**2 - 0.5 * phi * (z - z**2)),
    ])  # fmt: skip
    theta = np.array([
        6.0 * (z**2 - z) / length,
        1.0 - 4.0 * z + 3.0 * z**2 + phi * (1.0 - z),
        6.0 * (z - z**2) / length,
        3.0 * z**2 - 2.0 * z + phi * z,
    ])  # fmt: skip
    slope = np.array([
        (6.0 * (z**2 - z) - phi) / length,
        1.0 - 4.0 * z + 3.0 * z**2 + 0.5 * phi * (1.0 - 2.0 * z),
        (6.0 * (z - z**2) + phi) / length,
        3.0 * z**2 - 2.0 * z - 0.5 * phi * (1.0 - 2.0 * z),
    ])  # fmt: skip
    return scale * w, scale * theta, scale * slope


def element(section: Section, length: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stiffness, mass and integral of w' w' of an element in (w1, theta1, w2, theta2), (4, 4) each."""
    phi, a = section.shear_ratio(length), length
    stiffness = section.young * section.inertia / (a**3 * (1.0 + phi)) * np.array([
        [12.0, 6.0 * a, -12.0, 6.0 * a],
        [6.0 * a, (4.0 + phi) * a**2, -6.0 * a, (2.0 - phi) * a**2],
        [-12.0, -6.0 * a, 12.0, -6.0 * a],
        [6.0 * a, (2.0 - phi) * a**2, -6.0 * a, (4.0 + phi) * a**2],
    ])  # fmt: skip
    mass, bent = np.zeros((4, 4)), np.zeros((4, 4))
    for place, weight in zip(FINE, FINE_WEIGHTS, strict=True):
        w, theta, slope = shapes(place, length, phi)
        carried = section.area * np.outer(w, w) + section.inertia * np.outer(theta, theta)
        mass += weight * length * section.density * carried
        bent += weight * length * np.outer(slope, slope)
    return stiffness, mass, bent


def plant(values: Mapping[str, float], support: float) -> Plant:
    """Return the beam at these values.

    Parameters
    ----------
    values : SI, by the names of a study: length, delamination, beam_thickness, layer_thickness, width, young_modulus,
        poisson_ratio, density, alpha, g_max, s
    support : distance of the supports from the middle  [m]
    """
    v = values
    a, half = 0.5 * v["delamination"], 0.5 * v["length"]
    h1, h2 = v["beam_thickness"], v["layer_thickness"]
    material = v["width"], v["young_modulus"], v["poisson_ratio"], v["density"]
    beam, layer, solid = (Section(h, *material) for h in (h1, h2, h1 + h2))
    inner = np.linspace(0.0, a, INNER + 1)
    outer = np.concatenate([np.linspace(a, support, BEFORE + 1), np.linspace(support, half, AFTER + 1)[1:]])
    # freedoms: (w, theta) of the remaining beam, of the solid one, of the layer but for its last node; then u
    start = 2 * (len(inner) + len(outer) - 1)
    tip, size = 2 * INNER, start + 2 * INNER + 1
    along_beam = np.arange(2 * len(inner))
    along_layer = np.concatenate([start + np.arange(2 * INNER), [tip, tip + 1]])
    along_solid = tip + np.arange(2 * len(outer))
    stiffness, mass, bent = np.zeros((size, size)), np.zeros((size, size)), np.zeros((2, size, size))
    for section, x, freedoms, member in (
        (beam, inner, along_beam, 0), (layer, inner, along_layer, 1), (solid, outer, along_solid, None),
    ):  # fmt: skip
        for i, length in enumerate(np.diff(x)):
            own = np.ix_(freedoms[2 * i : 2 * i + 4], freedoms[2 * i : 2 * i + 4])
            k, m, g = element(section, length)
            stiffness[own] += k
            mass[own] += m
            if member is not None:
                bent[member][own] += g
    axial, rigidity = np.zeros((2, size)), np.zeros(2)
    heights = 0.5 * h1 - 0.5 * (h1 + h2), h1 + 0.5 * h2 - 0.5 * (h1 + h2)
    for row, (section, height) in enumerate(zip((beam, layer), heights, strict=True)):
        axial[row, [-1, tip + 1]] = 1.0, -height
        rigidity[row] = section.young * section.area / a
        stiffness += rigidity[row] * np.outer(axial[row], axial[row])
        mass += section.density * section.area * a / 3.0 * np.outer(axial[row], axial[row])
    mass[-1, -1] += solid.density * solid.area * (half - a)
    opening, shown, gap, weight = _contact(inner, along_beam, along_layer, beam, layer, size, v["g_max"], v["s"])
    held = [1, start + 1, tip + 2 * BEFORE]  # no rotation in the middle; the support
    free = np.setdiff1d(np.arange(size), [0, *held])
    static = np.zeros(size)
    static[0] = 1.0
    static[free] = -np.linalg.solve(stiffness[np.ix_(free, free)], stiffness[free, 0])
    square, modes = eigh(stiffness[np.ix_(free, free)], mass[np.ix_(free, free)], subset_by_index=(0, MODES - 1))
    basis = np.zeros((size, MODES + 1))
    basis[free, :MODES], basis[:, MODES] = modes, static
    return Plant(
        square=square,
        decay=v["alpha"] + STIFFNESS_DAMPING * square,
        push=-basis[:, :MODES].T @ mass @ static,
        axial=axial @ basis,
        bent=np.array([basis.T @ g @ basis for g in bent]),
        rigidity=rigidity,
        opening=opening @ basis,
        gap=gap,
        weight=weight * v["width"],
        layer=shown @ basis,
        mass=weight * layer.density * layer.area,
        centre=basis[start].copy(),
        alpha=float(v["alpha"]),
    )


def _contact(inner, along_beam, along_layer, beam, layer, size, height, shift):
    """Opening and deflection of the layer by the freedoms, gap [m] and length [m] at the points of contact."""
    opening, shown, places, weights = [], [], [], []
    for i, length in enumerate(np.diff(inner)):
        for place, weight in zip(POINTS, WEIGHTS, strict=True):
            above, below = np.zeros(size), np.zeros(size)
            above[along_layer[2 * i : 2 * i + 4]] = shapes(place, length, layer.shear_ratio(length))[0]
            below[along_beam[2 * i : 2 * i + 4]] = shapes(place, length, beam.shear_ratio(length))[0]
            opening.append(above - below)
            shown.append(above)
            places.append((inner[i] + place * length) / inner[-1])
            weights.append(weight * length)
    z = np.array(places)
    gap = height * (1.0 - 3.0 * z**2 + 2.0 * z**3) + shift
    return np.array(opening), np.array(shown), gap, np.array(weights)


@njit(cache=True)
def rates(beam, time, omega, amplitude, drag, cubic, q, v, out):
    """Write q'' (n,) at the coordinates q and rates v (n + 1,), whose last place takes X and X'.

    Return the force of contact on half the layer [N].

    drag [1/m], cubic [1/(m^2 s^2)] : the layer has the force -drag w'|w'| - cubic w^3 on its unit mass besides
    """
    n = len(out)
    q[n], v[n] = amplitude * np.cos(omega * time), -omega * amplitude * np.sin(omega * time)
    pushed = -(omega**2) * q[n] + beam.alpha * v[n]
    out[:] = -beam.square * q[:n] - beam.decay * v[:n] + beam.push * pushed
    for k in range(2):
        turned = beam.bent[k] @ q
        stretch = 0.5 * (q @ turned)
        tension = beam.rigidity[k] * (beam.axial[k] @ q + stretch)
        out -= beam.rigidity[k] * stretch * beam.axial[k, :n] + tension * turned[:n]
    clear, rate = beam.opening @ q + beam.gap, beam.opening @ v
    total = 0.0
    for i in range(len(clear)):
        if clear[i] < 0.0:
            pressure = CONTACT_STIFFNESS * (-clear[i]) ** 1.5 * (1.0 - CONTACT_LOSS * rate[i])
            if pressure > 0.0:
                total += pressure * beam.weight[i]
                out += pressure * beam.weight[i] * beam.opening[i, :n]
    if drag != 0.0 or cubic != 0.0:
        place, speed = beam.layer @ q, beam.layer @ v
        for i in range(len(place)):
            force = -drag * speed[i] * abs(speed[i]) - cubic * place[i] ** 3
            out += beam.mass[i] * force * beam.layer[i, :n]
    return total


@njit(cache=True)
def period(beam, omega, amplitude, drag, cubic, q, v, steps, rows):
    """Go on by one period from time zero, q and v (n + 1,) in place; write rows (steps + 1, 5) at the ends of steps.

    A row is w and w' of the drive, the same of the middle of the layer, and the force of contact, SI.
    """
    n = len(q) - 1
    h = 2.0 * np.pi / omega / steps
    a1, a2, a3, a4 = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    p, s = q.copy(), v.copy()
    for step in range(steps + 1):
        t = step * h
        force = rates(beam, t, omega, amplitude, drag, cubic, q, v, a1)
        rows[step, 0], rows[step, 1] = q[n], v[n]
        rows[step, 2], rows[step, 3], rows[step, 4] = beam.centre @ q, beam.centre @ v, 2.0 * force
        if step == steps:
            break
        v1 = v[:n].copy()
        p[:n], s[:n] = q[:n] + 0.5 * h * v1, v1 + 0.5 * h * a1
        v2 = s[:n].copy()
        rates(beam, t + 0.5 * h, omega, amplitude, drag, cubic, p, s, a2)
        p[:n], s[:n] = q[:n] + 0.5 * h * v2, v1 + 0.5 * h * a2
        v3 = s[:n].copy()
        rates(beam, t + 0.5 * h, omega, amplitude, drag, cubic, p, s, a3)
        p[:n], s[:n] = q[:n] + h * v3, v1 + h * a3
        v4 = s[:n].copy()
        rates(beam, t + h, omega, amplitude, drag, cubic, p, s, a4)
        q[:n] += h / 6.0 * (v1 + 2.0 * v2 + 2.0 * v3 + v4)
        v[:n] += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)


def settled(
    beam: Plant, frequency: float, amplitude: float, drag: float = 0.0, cubic: float = 0.0, steps: int = STEPS
) -> Settled | None:
    """Motion that returns after a period, from rest on the static shape; None where there is none.

    Parameters
    ----------
    frequency, amplitude : of X = amplitude cos(2 pi frequency t)  [Hz], [m]
    drag, cubic : see `rates`
    steps : of a period
    """
    q, v = np.zeros(MODES + 1), np.zeros(MODES + 1)
    rows = np.zeros((steps + 1, 5))
    omega = 2.0 * np.pi * frequency
    for count in range(1, PERIODS + 1):
        before = q[:MODES].copy(), v[:MODES].copy()
        period(beam, omega, amplitude, drag, cubic, q, v, steps, rows)
        if not np.isfinite(q).all():
            return None
        moved = [np.abs(x[:MODES] - y).max() / np.abs(x[:MODES]).max() for x, y in zip((q, v), before, strict=True)]
        if max(moved) < SETTLED:
            time = np.linspace(0.0, 1.0 / frequency, steps + 1)
            return Settled(time, rows[:, [0, 2]].T.copy(), rows[:, [1, 3]].T.copy(), rows[:, 4].copy(), count)
    return None
