"""Masses and stiffnesses of the minimal model: four displacements of a beam with one delaminated layer.

q1, q4 are the ends of the delamination, q2 the middle of the remaining beam, q3 the middle of the layer. The outer
parts are rigid and turn about the suspension nodes; the inner beams are clamped to them (Euler and Bernoulli).
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

MODAL_MASS_SHARE = 0.384  # of an inner beam's mass that moves with its middle


class Lumped(NamedTuple):
    """Matrices (4, 4) of the body alone [kg], [N/m], and the stiffness of the shaker's spring [N/m]."""

    mass: np.ndarray
    stiffness: np.ndarray
    spring: float


def lumped(values: Mapping[str, float]) -> Lumped:
    """Masses and stiffnesses from the geometry; `values` as in `four_dof.PARAMETERS`, SI."""
    b = 0.5 * values["delamination"]
    a = 0.5 * values["length"] - b
    node = values["node_position"] * values["length"]
    c = a - node  # arm from the suspension to the end of the delamination
    slenderness = b / c

    area = values["width"] * np.array([values["beam_thickness"], values["layer_thickness"]])  # m^2: beam, layer
    mu1, mu2 = values["density"] * area * [1.0, values["layer_mass"]]  # kg/m
    bending = values["young_modulus"] * area * np.array([values["beam_thickness"], values["layer_thickness"]]) ** 2 / 12
    k1, k2 = values["stiffness_factor"] * bending / b**3 * [1.0, values["layer_stiffness"]]  # N/m

    m2, m3 = MODAL_MASS_SHARE * mu1 * 2.0 * b, MODAL_MASS_SHARE * mu2 * 2.0 * b
    mu = mu1 + mu2
    edge = 0.5 * (mu * 2.0 * b - m2 - m3)
    inertia = mu * a * (a**2 / 12.0 + (0.5 * a - node) ** 2) + edge * c**2  # about the suspension
    m1 = inertia / c**2

    k = k1 + k2
    k11 = k * (7.5 + 9.0 * slenderness + 3.5 * slenderness**2)
    k14 = k * (4.5 + 3.0 * slenderness + 0.5 * slenderness**2)
    k12, k13 = -k1 * (12.0 + 6.0 * slenderness), -k2 * (12.0 + 6.0 * slenderness)
    stiffness = np.array(
        [
            [k11, k12, k13, k14],
            [k12, 24.0 * k1, 0.0, k12],
            [k13, 0.0, 24.0 * k2, k13],
            [k14, k12, k13, k11],
        ]
    )
    return Lumped(np.diag([m1, m2, m3, m1]), stiffness, values["drive_stiffness"] * k11)
