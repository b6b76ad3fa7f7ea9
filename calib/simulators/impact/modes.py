"""The modes of a linear structure out of contact with its stop, and in contact with it."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg import eigh, null_space

from calib.simulators.impact.problem import Regimes

STRUCTURES_KEPT = 64  # whose modes are known: a motion that is followed over its drive has one all along


@dataclass(frozen=True, eq=False)
class Stop:
    """A one-sided rigid stop: the clearance r = gap + normal . q + input U is never negative.

    Attributes
    ----------
    normal : (n,) of the clearance  [1]
    hit : (n,) change of the velocities per unit change of r' at an impact, normal . hit = 1; in permanent contact this
        coordinate is the one that is given by the others (paper, eq. (2): the beam is infinitely heavy at an impact)
    gap : clearance at rest  [m]
    restitution : Newton's coefficient  [1]
    input : weight of the drive U in the clearance, where the drive prescribes a touching body
    """

    normal: np.ndarray
    hit: np.ndarray
    gap: float
    restitution: float
    input: float = 0.0


@dataclass(frozen=True, eq=False)
class LinearStructure:
    """M q'' + C q' + K q = load . (U, U', U'') + constant, with modal damping.

    Attributes
    ----------
    mass, stiffness : (n, n)  [kg], [N/m]
    rate : (m,) eigenvalues [1/s^2] -> (m,) decay rates [1/s] of the modes of a regime
    load : (n, 3) loads per unit of the drive U, U', U''
    constant : (n,)  [N]
    stop : Stop or None
    """

    mass: np.ndarray
    stiffness: np.ndarray
    rate: Callable[[np.ndarray], np.ndarray]
    load: np.ndarray
    constant: np.ndarray
    stop: Stop | None = None


def modal(damping: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return the decay rates of a damping ratio that all modes share [1]."""
    return lambda eigenvalues: damping * np.sqrt(np.maximum(eigenvalues, 0.0))


def viscous(rate: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return one decay rate [1/s] for all modes: c / (2 m) of a single mass."""
    return lambda eigenvalues: np.full_like(eigenvalues, rate)


def _derivative_factors(omega: float) -> np.ndarray:
    """Return the complex factors of U, U', U'' (3,) for a harmonic U."""
    return np.array([1.0, 1j * omega, -(omega**2)])


def _real(amplitude: complex | np.ndarray, constant: float | np.ndarray) -> np.ndarray:
    """Stack the parts [cos, sin, constant] of Re(amplitude exp(i omega t)) + constant."""
    amplitude = np.asarray(amplitude, dtype=complex)
    return np.stack([amplitude.real, -amplitude.imag, np.broadcast_to(constant, amplitude.shape)], axis=-1)


def _modes(
    structure: LinearStructure, basis: np.ndarray, load: np.ndarray, constant: np.ndarray, drive: complex, omega: float
) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """Modes within the span of `basis` (n, m), and their motion under the drive.

    Returns the modal arrays of a regime by name, the complex harmonic (n,) and the static part (n,) of the coordinates.
    """
    stiffness, shape = _undamped(
        *(array.tobytes() for array in (structure.stiffness, structure.mass, basis)), *basis.shape
    )
    rate = structure.rate(stiffness)
    with np.errstate(all="ignore"):  # an undamped resonance: the run says that it diverges
        harmonic = shape.T @ load @ _derivative_factors(omega) * drive / (stiffness - omega**2 + 2j * rate * omega)
    static = shape.T @ constant
    flexible = stiffness != 0.0
    deflection = np.where(flexible, static / np.where(flexible, stiffness, 1.0), 0.0)
    arrays = {
        "stiffness": stiffness,
        "rate": np.asarray(rate, dtype=float),
        "shape": np.ascontiguousarray(shape),
        "project": np.ascontiguousarray(shape.T @ structure.mass),
        "load_input": np.ascontiguousarray(shape.T @ load),
        "load_constant": np.where(flexible, 0.0, static),
    }
    if drive == 0.0:
        harmonic = np.zeros(len(stiffness), dtype=complex)
    return arrays, shape @ harmonic, shape @ deflection


@lru_cache(maxsize=STRUCTURES_KEPT)
def _undamped(stiffness: bytes, mass: bytes, basis: bytes, n: int, m: int) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues (m,) [1/s^2] and mass-normalised shapes (n, m) within the span of `basis` (n, m), read-only."""
    k, within = np.frombuffer(stiffness).reshape(n, n), np.frombuffer(basis).reshape(n, m)
    if m == 0:
        eigenvalues, shape = np.zeros(0), np.zeros((n, 0))
    else:
        eigenvalues, vectors = eigh(within.T @ k @ within, within.T @ np.frombuffer(mass).reshape(n, n) @ within)
        shape = within @ vectors
    # an eigenvalue that is only rounding is none
    eigenvalues[np.abs(eigenvalues) < 1e-13 * np.abs(eigenvalues).max(initial=0.0)] = 0.0
    for array in (eigenvalues, shape):
        array.setflags(write=False)
    return eigenvalues, shape


@lru_cache(maxsize=STRUCTURES_KEPT)
def _along(normal: bytes) -> np.ndarray:
    """Orthonormal displacements (n, n - 1) that leave a clearance of this normal (n,) as it is, read-only."""
    basis = null_space(np.frombuffer(normal)[None, :])
    basis.setflags(write=False)
    return basis


def _free(structure: LinearStructure, drive: complex, omega: float) -> dict[str, np.ndarray]:
    """Work out the regime without contact; its witness is the clearance [m]."""
    n = len(structure.mass)
    arrays, harmonic, static = _modes(structure, np.eye(n), structure.load, structure.constant, drive, omega)
    arrays |= {"motion": _real(harmonic, static), "motion_input": np.zeros(n), "witness_v": np.zeros(n)}
    stop = structure.stop or Stop(np.zeros(n), np.zeros(n), 0.0, 0.0)
    return arrays | {
        "witness_y": stop.normal @ arrays["shape"],
        "witness": _real(stop.normal @ harmonic + stop.input * drive, stop.gap + stop.normal @ static),
        "witness_input": np.array([stop.input, 0.0, 0.0]),
        "witness_law": np.zeros(n),
    }


def _contact(
    structure: LinearStructure, stop: Stop, free: dict[str, np.ndarray], drive: complex, omega: float
) -> dict[str, np.ndarray]:
    """Work out the regime of permanent contact: q = T p - hit (gap + input U), T spanning the displacements with r = 0.

    Its witness is -r'' of the free regime at the same q, q' [m/s^2]: where that acceleration turns positive, the
    contact force has come down to zero.
    """
    mass, stiffness = structure.mass, structure.stiffness
    basis = _along(stop.normal.tobytes())
    held = np.outer(stiffness @ stop.hit, [stop.input, 0.0, 0.0]) + np.outer(mass @ stop.hit, [0.0, 0.0, stop.input])
    arrays, harmonic, static = _modes(
        structure, basis, structure.load + held, structure.constant + stiffness @ stop.hit * stop.gap, drive, omega
    )
    harmonic = harmonic - stop.hit * stop.input * drive
    static = static - stop.hit * stop.gap
    motion_input = -stop.hit * stop.input

    # r'' of the free regime = by_q . q + by_v . q' + by_load . (U, U', U'') + constant
    flexibility = np.linalg.solve(mass, stop.normal)
    by_q = -flexibility @ stiffness
    by_v = -(stop.normal @ free["shape"] * 2.0 * free["rate"]) @ free["project"]
    by_load = flexibility @ structure.load + np.array([0.0, 0.0, stop.input])
    opening = by_q @ harmonic + by_v @ harmonic * 1j * omega + by_load @ _derivative_factors(omega) * drive
    return arrays | {
        "motion": _real(harmonic, static),
        "motion_input": motion_input,
        "witness_y": -by_q @ arrays["shape"],
        "witness_v": -by_v @ arrays["shape"],
        "witness": _real(-opening, -(by_q @ static + flexibility @ structure.constant)),
        "witness_input": -(by_load + np.array([by_q @ motion_input, by_v @ motion_input, 0.0])),
        "witness_law": -stop.normal,
    }


def steady_motion(structure: LinearStructure, drive: complex, omega: float) -> np.ndarray:
    """Parts [cos, sin, constant] of the stationary motion (n, 3) out of contact under U = Re(drive exp(i omega t)).

    Raises
    ------
    numpy.linalg.LinAlgError, ValueError : as `regimes`
    """
    return _free(structure, drive, omega)["motion"]


def regimes(structure: LinearStructure, drive: complex, omega: float) -> Regimes:
    """Work out both regimes under U = Re(drive exp(i omega t)); without a stop the second repeats the first.

    Raises
    ------
    numpy.linalg.LinAlgError, ValueError : the mass matrix is not positive definite, or a number is not finite
    """
    free = _free(structure, drive, omega)
    contact = _contact(structure, structure.stop, free, drive, omega) if structure.stop else free

    def both(name: str) -> np.ndarray:
        pair = np.zeros((2, *free[name].shape))
        pair[0] = free[name]
        pair[1][tuple(slice(size) for size in contact[name].shape)] = contact[name]  # one mode less
        return pair

    return Regimes(**{name: both(name) for name in Regimes._fields})
