"""The modal system of a problem: its linear part out of contact, and its laws and compliant stop as forces at places.

The forces that harmonic balance transforms between time and frequency are evaluated here, with their derivatives by
central differences of the laws themselves.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np
from numba import njit

from calib.errors import CalibError
from calib.modelling.laws import STATES
from calib.modelling.modal_system import Forces, Linear, ModalSystem
from calib.simulators.compilation import COMPILED
from calib.simulators.impact.law_states import LawAtPlace, at_places, inner_states, periodic_states, state_path
from calib.simulators.impact.problem import (
    EXCITATION_LAWS,
    FORCE_LAWS,
    FREE,
    PORT_LAWS,
    Compliance,
    Problem,
)
from calib.simulators.law_calls import excitation, force

LAW_DIFFERENCE = 1e-6  # of the largest position or rate at a place, for the derivatives of its laws


def modal_system(
    problem: Problem, bodies: int, free: tuple[int, ...], law_states: Sequence[tuple[int, int, int]]
) -> ModalSystem:
    """Make the modal system of a problem with `bodies` bodies: `free` are coordinates, the others move as the drive.

    law_states : as `calib.simulators.impact.period_map.ImpactMap` has them

    Raises
    ------
    CalibError : see `calib.modelling.modal_system.ModalMap`
    """
    _check(problem)
    regimes, compliance, n = problem.regimes, problem.compliance, len(problem.hit)
    shape = regimes.shape[FREE]
    coordinates = Linear(shape, np.zeros(n), regimes.motion[FREE, :, 2])
    clearance = _clearance(problem)
    rows = [b for b in range(n) if problem.acts[:, b].any()]
    places, gains = [_rows(coordinates, rows)], [regimes.project[FREE][:, rows]]
    columns = list(rows)
    if problem.counts[PORT_LAWS] > 0:
        places.append(clearance)
        gains.append((regimes.project[FREE] @ problem.push)[:, None])
        columns.append(n)
    if compliance is not None:
        places.append(clearance)
        gains.append(compliance.load[:, None])
    acts, with_states = np.ascontiguousarray(problem.acts[:, columns]), at_places(law_states, columns)
    forces, loads = _forces_at_places(problem, compliance, acts, with_states)
    whole = Linear(np.zeros((bodies, n)), np.ones(bodies), np.zeros(bodies))  # what is not free moves by U
    whole.shape[list(free)], whole.drive[list(free)], whole.mean[list(free)] = coordinates
    return ModalSystem(
        stiffness=regimes.stiffness[FREE],
        rate=regimes.rate[FREE],
        load=regimes.load_input[FREE],
        constant=regimes.load_constant[FREE],
        bodies=whole,
        free=free,
        places=Linear(*(np.concatenate(part) for part in zip(*places, strict=True))),
        gain=np.hstack(gains),
        forces=forces,
        loads=loads,
        kinked=compliance is not None,
        marched=bool(with_states),
        clearance=clearance if problem.stop and compliance is None else None,
        amplitude=problem.amplitude,
        phase=problem.phase,
        distortion=_distortion(problem),
    )


def _forces_at_places(
    problem: Problem, compliance: Compliance | None, acts: np.ndarray, with_states: Sequence[LawAtPlace]
) -> tuple[
    Callable[[np.ndarray, np.ndarray, np.ndarray], Forces], Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
]:
    """`forces` and `loads` of `ModalSystem`: of laws at places, as `acts` (law, place) has it, and of a stop."""
    laws = acts.shape[1]

    def forces(position: np.ndarray, rate: np.ndarray, times: np.ndarray) -> Forces:
        by_laws = _law_forces(problem, acts, with_states, position[:laws], rate[:laws], times)
        if compliance is None:
            return by_laws
        stop = _contact_forces(compliance, position[laws:], rate[laws:])
        return Forces(
            np.concatenate([by_laws.value, stop.value]),
            np.concatenate([by_laws.by_position, stop.by_position]),
            np.concatenate([by_laws.by_rate, stop.by_rate]),
            by_laws.inner,
        )

    def loads(position: np.ndarray, rate: np.ndarray, times: np.ndarray) -> np.ndarray:
        by_laws = _law_loads(problem, acts, with_states, position[:laws], rate[:laws], times)
        if compliance is None:
            return by_laws
        return np.concatenate([by_laws, _contact_forces(compliance, position[laws:], rate[laws:]).value])

    return forces, loads


def _check(problem: Problem) -> None:
    advice = "; take shooting"
    if problem.compliance is not None and problem.compliance.by_speed:
        raise CalibError(
            "harmonic balance does not serve a contact whose loss depends on the speed at which it began" + advice
        )
    if problem.compliance is not None and problem.compliance.damping:
        raise CalibError(
            "harmonic balance does not serve a contact whose force jumps where it begins, as that of kelvin_voigt does"
            + advice
        )


def _distortion(problem: Problem) -> Callable[[float, np.ndarray], np.ndarray] | None:
    """What the laws of the excitation add to it, by its amplitude and phases (m,) [rad]; None without laws."""
    count = int(problem.counts[EXCITATION_LAWS])
    if not count:
        return None

    def added(amplitude: float, phase: np.ndarray) -> np.ndarray:
        out, times = np.zeros(phase.size), (phase - problem.phase) / problem.omega
        _add_to_excitation(problem.excitation, problem.excitation_p, count, times, phase, amplitude, out)
        return out

    return added


@njit(**COMPILED)
def _add_to_excitation(
    laws: np.ndarray, parameters: np.ndarray, count: int, times: np.ndarray, phase: np.ndarray, amplitude: float,
    out: np.ndarray,
) -> None:  # fmt: skip
    """Add the laws of the excitation at times [s] and phases (m,) [rad] to `out` (m,)."""
    for j in range(phase.size):
        undistorted = amplitude * math.cos(phase[j])
        for i in range(count):
            out[j] += excitation(laws[i], times[j], phase[j], amplitude, undistorted, parameters[i])


def _rows(linear: Linear, rows: list[int]) -> Linear:
    return Linear(*(part[rows] for part in linear))


def _clearance(problem: Problem) -> Linear:
    """Clearance of the stop as a position of one row."""
    regimes = problem.regimes
    return Linear(regimes.witness_y[FREE][None, :], regimes.witness_input[FREE, :1], regimes.witness[FREE, 2][None])


def _contact_forces(compliance: Compliance, clearance: np.ndarray, rate: np.ndarray) -> Forces:
    """Forces (1, m) of a compliant stop per unit mass; see `calib.simulators.impact.problem.Compliance`."""
    depth, closing = np.maximum(-clearance, 0.0), -rate
    power = compliance.stiffness * depth**compliance.exponent
    value = power * (1.0 + compliance.loss * closing)
    pressing = (depth > 0.0) & (value > 0.0)
    slope = compliance.stiffness * compliance.exponent * depth ** (compliance.exponent - 1.0)
    by_depth = slope * (1.0 + compliance.loss * closing)
    value, by_clearance, by_rate = (
        np.where(pressing, part, 0.0) for part in (value, -by_depth, -power * compliance.loss)
    )
    return Forces(value, by_clearance, by_rate)


def _law_forces(
    problem: Problem, acts: np.ndarray, with_states: Sequence[LawAtPlace], position: np.ndarray, rate: np.ndarray,
    times: np.ndarray,
) -> Forces:  # fmt: skip
    out = np.zeros((3, *position.shape))
    count = int(problem.counts[FORCE_LAWS]) if position.size else 0
    if not count:
        return Forces(out[0], out[1], out[2])
    steps = np.array([np.abs(part).max(axis=1) for part in (position, rate)]) * LAW_DIFFERENCE
    steps[steps == 0.0] = LAW_DIFFERENCE
    states = np.zeros((len(position), times.size if with_states else 1, count, STATES))
    paths = []
    for law, a, size in with_states:
        own = position[a], rate[a], (float(steps[0, a]), float(steps[1, a]))
        paths.append(state_path(problem.force[law], problem.force_p[law], size, times, *own))
        states[a, :, law, :size] = paths[-1].value
    _evaluate(problem.force, problem.force_p, count, acts, position, rate, times, steps, states, out)
    inner = inner_states(with_states, paths, float(times[1] - times[0])) if paths else None
    return Forces(out[0], out[1], out[2], inner)


def _law_loads(
    problem: Problem, acts: np.ndarray, with_states: Sequence[LawAtPlace], position: np.ndarray, rate: np.ndarray,
    times: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Sums of the laws (place, instant), without their derivatives."""
    out = np.zeros((1, *position.shape))
    count = int(problem.counts[FORCE_LAWS]) if position.size else 0
    if count:
        states = np.zeros((len(position), times.size if with_states else 1, count, STATES))
        for law, a, size in with_states:
            own = position[a], rate[a]
            states[a, :, law, :size] = periodic_states(problem.force[law], problem.force_p[law], size, times, *own)
        steps = np.zeros((2, len(position)))
        _evaluate(problem.force, problem.force_p, count, acts, position, rate, times, steps, states, out)
    return out[0]


@njit(**COMPILED)
def _sum(
    laws: np.ndarray,
    parameters: np.ndarray,
    count: int,
    acts: np.ndarray,
    t: float,
    x: float,
    v: float,
    z: np.ndarray,
    dz: np.ndarray,
) -> float:
    """Sum of the laws that act at a place, as `acts` (laws,) says."""
    total = 0.0
    for i in range(count):
        if acts[i]:
            total += force(laws[i], t, x, v, parameters[i], z[i], dz)
    return total


@njit(**COMPILED)
def _evaluate(
    laws: np.ndarray,
    parameters: np.ndarray,
    count: int,
    acts: np.ndarray,
    position: np.ndarray,
    rate: np.ndarray,
    times: np.ndarray,
    steps: np.ndarray,
    states: np.ndarray,
    out: np.ndarray,
) -> None:
    """Write sums of the laws (3, place, instant): value, and derivatives by position and rate with `states` held.

    out : (1, place, instant) where the value alone is asked for
    states : (place, instant, law, STATES); without any, of one instant
    """
    dz = np.zeros(STATES)
    for a in range(position.shape[0]):
        own, hx, hv = acts[:, a], steps[0, a], steps[1, a]
        for j in range(times.size):
            t, x, v, z = times[j], position[a, j], rate[a, j], states[a, j % states.shape[1]]
            out[0, a, j] = _sum(laws, parameters, count, own, t, x, v, z, dz)
            if len(out) == 1:
                continue
            ahead = _sum(laws, parameters, count, own, t, x + hx, v, z, dz)
            behind = _sum(laws, parameters, count, own, t, x - hx, v, z, dz)
            out[1, a, j] = (ahead - behind) / (2.0 * hx)
            ahead = _sum(laws, parameters, count, own, t, x, v + hv, z, dz)
            behind = _sum(laws, parameters, count, own, t, x, v - hv, z, dz)
            out[2, a, j] = (ahead - behind) / (2.0 * hv)
