"""The drives of the minimal model: which displacements are free, and what loads them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calib.simulators.four_dof.lumped import Lumped
from calib.simulators.impact.modes import LinearStructure, Stop

BODIES = ("q1", "q2", "q3", "q4")
BEAM, LAYER = 1, 2  # the bodies that meet


@dataclass(frozen=True)
class DriveKind:
    """One way of driving.

    Attributes
    ----------
    place, quantity : of the excitations it takes
    prescribed : indices of the bodies whose displacement is the drive's
    spring : whether the drive acts through the shaker's spring, so that its amplitude follows from that of q1
    meaning : in one line
    """

    place: str
    quantity: str
    prescribed: tuple[int, ...]
    spring: bool
    meaning: str

    @property
    def coordinates(self) -> tuple[int, ...]:
        """Indices of the bodies that are free to move."""
        return tuple(i for i in range(len(BODIES)) if i not in self.prescribed)


DriveName = Literal["spring", "rigid", "symmetric", "force", "centre"]
DRIVES: dict[DriveName, DriveKind] = {
    "spring": DriveKind("end", "displacement", (), True, "a prescribed displacement behind a stiff spring at q1"),
    "rigid": DriveKind("end", "displacement", (0,), False, "q1 prescribed"),
    "symmetric": DriveKind("end", "displacement", (0, 3), False, "q1 and q4 prescribed"),
    "force": DriveKind("end", "force", (), False, "a force on q1"),
    "centre": DriveKind("centre", "displacement", (BEAM,), False, "q2 prescribed"),
}


def structure(
    kind: DriveKind, body: Lumped, rate: Callable[[np.ndarray], np.ndarray], gap: float, restitution: float
) -> LinearStructure:
    """Build the structure with the coordinates that a drive leaves free; gap [m], restitution [1].

    The mass matrix is diagonal, so a prescribed displacement loads the others through the stiffness alone.
    """
    stiffness = body.stiffness.copy()
    load = np.zeros(len(BODIES))
    if kind.spring:
        stiffness[0, 0] += body.spring
        load[0] = body.spring
    elif kind.quantity == "force":
        load[0] = 1.0
    else:
        load = -stiffness[:, kind.prescribed].sum(axis=1)
    free = list(kind.coordinates)
    normal = np.zeros(len(BODIES))
    normal[LAYER], normal[BEAM] = 1.0, -1.0  # r = g + q3 - q2
    hit = np.zeros(len(BODIES))
    hit[LAYER] = 1.0  # paper, eq. (2): only the layer's velocity jumps
    loads = np.zeros((len(free), 3))
    loads[:, 0] = load[free]
    return LinearStructure(
        mass=body.mass[np.ix_(free, free)],
        stiffness=stiffness[np.ix_(free, free)],
        rate=rate,
        load=loads,
        constant=np.zeros(len(free)),
        stop=Stop(normal[free], hit[free], gap, restitution, input=float(normal[list(kind.prescribed)].sum())),
    )
