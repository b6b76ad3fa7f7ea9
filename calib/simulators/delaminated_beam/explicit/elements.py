"""Nodal forces of corotational quadrilaterals.

The energy of an element is that of the Biot strain in the axes that turn with it,

    V [G/2 (D^2 + S^2) + K2/2 (r - 2)^2],    K2 = E / (2 (1 - nu)),
    D = F11 - F22,  S = F21 + F12,  A = F11 + F22,  B = F21 - F12,  r^2 = A^2 + B^2,

which is linear in all but r, and the bending of the product patterns in the turned axes (see `plane_stress`).
"""

import numpy as np
from numba import njit, uintp

from calib.simulators.compilation import INLINED, WITHIN
from calib.simulators.delaminated_beam.explicit.plan import COEFFICIENT_ROWS, FORCE_ROWS, ROW_LENGTH, ExplicitPlan

SHAPE_ROW = 5  # row of coefficients from which on they are of the stress-free shape
VECTOR = {**WITHIN, "fastmath": {"contract"}}


@njit(**VECTOR)
def spread(at: int, fx: float, fy: float, ax: float, ay: float, cx: float, cy: float, out: np.ndarray) -> None:
    """Write the nodal forces of an element from `at` on: of product pattern (f), ends (a) and sides (c)  [N].

    Rows of `out`: x of the lower line from the elements on the right and on the left of each node, y of it, then x and
    y of the upper line.
    """
    plus, minus = ax + cx, ax - cx
    out[at] = fx - plus
    out[at + uintp(ROW_LENGTH + 1)] = minus - fx
    out[at + uintp(4 * ROW_LENGTH)] = -minus - fx
    out[at + uintp(5 * ROW_LENGTH + 1)] = fx + plus
    plus, minus = ay + cy, ay - cy
    out[at + uintp(2 * ROW_LENGTH)] = fy - plus
    out[at + uintp(3 * ROW_LENGTH + 1)] = minus - fy
    out[at + uintp(6 * ROW_LENGTH)] = -minus - fy
    out[at + uintp(7 * ROW_LENGTH + 1)] = fy + plus


@njit(**VECTOR)
def forces_of_strip(
    count: int,
    w: np.ndarray,
    xl: int,
    yl: int,
    xu: int,
    yu: int,
    k: np.ndarray,
    at: int,
    turned: int | None,
    across: float,
    mean: float,
    shear: float,
    out: np.ndarray,
    to: int,
) -> None:
    """Nodal forces of the elements of a strip.

    Parameters
    ----------
    count : elements, padded
    w : displacements + beta velocities  [m]
    xl, yl, xu, yu : where those of the lower and of the upper line begin in it, (count + 1,) each
    k : coefficients, whose rows begin at `at`: 0.5 / length [1/m], 0.5 * height * width [m^2], 0.5 * length * width
        [m^2], a sixteenth of the bending stiffness of the two patterns [N/m]; zero in padding
    turned : where in k the rows of elements begin whose stress-free shape is a turned and slightly bent rectangle: 2
        cos, 2 sin of the angle by which an element stands turned [1], and 4 times the stress-free amplitudes of the
        pattern along x, along y and in turned axes [m]. None: rectangles that stand along x, compiled by themselves
    across : 0.5 / height  [1/m]
    mean, shear : K2, G  [Pa]
    out, to : see `spread`
    """
    for j in range(count):
        px, qx, rx = w[xl + uintp(1) + j] - w[xl + j], w[xu + uintp(1) + j] - w[xu + j], w[xu + j] - w[xl + j]
        py, qy, ry = w[yl + uintp(1) + j] - w[yl + j], w[yu + uintp(1) + j] - w[yu + j], w[yu + j] - w[yl + j]
        hx, hy = qx - px, qy - py
        along, end, side = k[at + j], k[at + uintp(ROW_LENGTH) + j], k[at + uintp(2 * ROW_LENGTH) + j]
        g11, g21 = along * (px + qx), along * (py + qy)
        g12, g22 = across * (2.0 * rx + hx), across * (2.0 * ry + hy)
        if turned is None:
            a, b = 2.0 + (g11 + g22), g21 - g12
        else:
            a, b = k[turned + j] + (g11 + g22), k[turned + uintp(ROW_LENGTH) + j] + (g21 - g12)
        q = 1.0 / np.sqrt(a * a + b * b)
        c, s = a * q, b * q
        pressure = mean - 2.0 * mean * q
        pa, pb, pd, ps = pressure * a, pressure * b, shear * (g11 - g22), shear * (g21 + g12)
        if turned is not None:
            hx, hy = hx + k[turned + uintp(2 * ROW_LENGTH) + j], hy + k[turned + uintp(3 * ROW_LENGTH) + j]
        tx, ty = c * hx + s * hy, c * hy - s * hx
        if turned is None:
            bx, by = k[at + uintp(3 * ROW_LENGTH) + j] * tx, k[at + uintp(4 * ROW_LENGTH) + j] * ty
        else:
            tx0, ty0 = k[turned + uintp(4 * ROW_LENGTH) + j], k[turned + uintp(5 * ROW_LENGTH) + j]
            bx, by = k[at + uintp(3 * ROW_LENGTH) + j] * (tx - tx0), k[at + uintp(4 * ROW_LENGTH) + j] * (ty - ty0)
        moment = (bx * ty - by * tx) * q
        mc, ms = moment * c, moment * s
        ax, ay = end * (pa + pd) - ms * along, end * (ps + pb) + mc * along
        cx, cy = side * (ps - pb) - mc * across, side * (pa - pd) - ms * across
        spread(to + j, c * bx - s * by, s * bx + c * by, ax, ay, cx, cy, out)


@njit(**INLINED)
def elastic(plan: ExplicitPlan, w: np.ndarray, out: np.ndarray) -> None:
    """Nodal forces of all elements at the displacements w, those of common nodes added up on the layer's line.

    out : (strips * FORCE_ROWS * ROW_LENGTH,) see `spread`; written  [N]
    """
    size = plan.size
    k, mean, shear = plan.factors, plan.mean, plan.shear
    for strip in range(len(plan.strips)):
        low, up, count = uintp(plan.strips[strip, 0]), uintp(plan.strips[strip, 1]), uintp(plan.strips[strip, 2])
        yl, yu, across = low + uintp(size), up + uintp(size), plan.across[strip]
        at, to = uintp(strip * COEFFICIENT_ROWS * ROW_LENGTH), uintp(strip * FORCE_ROWS * ROW_LENGTH)
        if plan.turned[strip]:
            turned = at + uintp(SHAPE_ROW * ROW_LENGTH)
            forces_of_strip(count, w, low, yl, up, yu, k, at, turned, across, mean, shear, out, to)
        else:
            forces_of_strip(count, w, low, yl, up, yu, k, at, None, across, mean, shear, out, to)
    below, above = plan.joint[0] * FORCE_ROWS * ROW_LENGTH, plan.joint[1] * FORCE_ROWS * ROW_LENGTH
    for stretch in range(len(plan.shared)):
        layer, beam, count = plan.shared[stretch, 0], plan.shared[stretch, 1], plan.shared[stretch, 2]
        for row in (0, 2):
            mine, other = uintp(above + row * ROW_LENGTH + layer), uintp(below + (row + 4) * ROW_LENGTH + beam)
            for j in range(uintp(count)):
                out[mine + j] += out[other + j] + out[other + uintp(ROW_LENGTH) + j]
