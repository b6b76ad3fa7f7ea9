"""A structure under a harmonic drive in modal coordinates, and the forces that depend on its motion."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from calib.modelling.orbit import PeriodMap


class Linear(NamedTuple):
    """Positions p that follow from the modal coordinates and the drive: mean + shape y + drive U.

    Attributes
    ----------
    shape : (p, n)  [kg^-1/2]
    drive : (p,) per unit of U
    mean : (p,)  [m]
    """

    shape: np.ndarray
    drive: np.ndarray
    mean: np.ndarray


class InnerStates(NamedTuple):
    """Internal states of forces along a periodic motion, q of them at m instants, and how its changes change them.

    Attributes
    ----------
    place : (q,) number of the place at which each acts
    value : (q, m)
    force_by_state : (q, m) derivative of the force per unit mass at its place by each
    by_position, by_rate : (q, m) derivatives of the states' rates by position and rate of their places
    by_state : (q, q, m) the same by the states
    changed : changes of position and rate (p, m, k) of the places and of the period, relative (k,) -> those of the
        forces per unit mass (p, m, k) by what the states then do, which repeat over a period too
    """

    place: np.ndarray
    value: np.ndarray
    force_by_state: np.ndarray
    by_position: np.ndarray
    by_rate: np.ndarray
    by_state: np.ndarray
    changed: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


class Forces(NamedTuple):
    """Forces (p, m) per unit mass at m instants [m/s^2], and their derivatives by position [1/s^2] and rate [1/s].

    The derivatives are those with internal states held, which `inner` tells; None without any.
    """

    value: np.ndarray
    by_position: np.ndarray
    by_rate: np.ndarray
    inner: InnerStates | None = None

    def changed(self, position: np.ndarray, rate: np.ndarray, stretch: np.ndarray) -> np.ndarray:
        """Change (p, m, k) of the forces with that of position and rate (p, m, k) and of the period, relative (k,)."""
        held = self.by_position[:, :, None] * position + self.by_rate[:, :, None] * rate
        return held if self.inner is None else held + self.inner.changed(position, rate, stretch)


@dataclass(frozen=True, eq=False)
class ModalSystem:
    """y'' + 2 rate y' + stiffness y = load . (U, U', U'') + constant + gain f, with U = A cos tau + distortion.

    Attributes
    ----------
    stiffness, rate : (n,) eigenvalues [1/s^2] and decay rates [1/s] of the modes
    load : (n, 3) modal load per unit of U, U', U''
    constant : (n,) modal load
    bodies : displacements of the simulator's bodies; `free`, indices of those that the state of the period map holds
    places : positions at which forces act
    gain : (n, p) modal load per unit of the force per unit mass at each place  [kg^1/2]
    forces : of positions and rates (p, m) at the places [m], [m/s], and times (m,) [s], evenly over one period
    loads : of the same -> the value (p, m) of these forces alone, without their derivatives
    kinked : whether forces have corners in position or rate, as that of a stop that yields
    marched : whether forces have internal states, which are marched from instant to instant
    clearance : of a rigid stop, one position; None without one, or where the stop yields and is among the places
    amplitude : A at the amplitude of the excitation that the system was made with, in its unit
    phase : tau at the section; tau = omega t + phase  [rad]
    distortion : of A and phases tau (m,) [rad] -> what effects add to U (m,), in its unit; None without any
    """

    stiffness: np.ndarray
    rate: np.ndarray
    load: np.ndarray
    constant: np.ndarray
    bodies: Linear
    free: tuple[int, ...]
    places: Linear
    gain: np.ndarray
    forces: Callable[[np.ndarray, np.ndarray, np.ndarray], Forces]
    loads: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
    kinked: bool
    marched: bool
    clearance: Linear | None
    amplitude: float
    phase: float
    distortion: Callable[[float, np.ndarray], np.ndarray] | None = None


@runtime_checkable
class ModalMap(PeriodMap, Protocol):
    """A period map that tells the modal system whose motion it maps; harmonic balance is served by it."""

    def modal_system(self) -> ModalSystem:
        """Return the system at the map's values.

        Raises
        ------
        CalibError : forces that are no function of position, rate, internal states and time, with a loss by the
            closing speed
        """
        ...
