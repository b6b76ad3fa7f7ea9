"""Energy balance of the full kernel."""

import numpy as np
from numba import njit

from calib.simulators.compilation import COMPILED
from calib.simulators.delaminated_beam.explicit.elements import elastic
from calib.simulators.delaminated_beam.explicit.plan import FORCE_ROWS, ROW_LENGTH, ExplicitPlan, ExplicitState
from calib.simulators.delaminated_beam.explicit.stepping import step


@njit(**COMPILED)
def power(plan: ExplicitPlan, elastic: np.ndarray, velocity: np.ndarray) -> tuple[float, float]:
    """Power of the elements' nodal forces at the velocities (2 * size,): of free nodes, and of the driven one  [W]."""
    free, driven = 0.0, 0.0
    for k in range(len(plan.lines)):
        first, count, below, above = plan.lines[k]
        for component in range(2):
            row = 2 * component * ROW_LENGTH
            for j in range(count):
                node = first + component * plan.size + j
                force = 0.0
                if above >= 0:
                    upper = above * FORCE_ROWS * ROW_LENGTH + row + j
                    force += elastic[upper] + elastic[upper + ROW_LENGTH]
                if below >= 0:
                    lower = (below * FORCE_ROWS + 4) * ROW_LENGTH + row + j
                    force += elastic[lower] + elastic[lower + ROW_LENGTH]
                if node == plan.driven:
                    driven += force * velocity[node]
                elif plan.inverse_mass[node] > 0.0:
                    free += force * velocity[node]
    return free, driven


@njit(**COMPILED)
def audit(plan: ExplicitPlan, state: ExplicitState, time: float, drive: np.ndarray, energy: np.ndarray) -> None:
    """As `advance`, but recording the energies instead of the motion; several times slower.

    Parameters
    ----------
    energy : (6,) work of the drive; lost to alpha, to beta, in contact; kinetic energy of the free nodes at the first
        step and at the last, of the velocities before and after it; written  [J]. The work of force laws is left out
    """
    other = np.zeros_like(state.elastic)
    energy[:] = 0.0
    for n in range(len(drive)):
        old = state.v.copy()
        u = state.w - plan.beta * old
        elastic(plan, u, other)
        closed, _ = step(plan, state, time + n * plan.step, drive[n])
        mean = 0.5 * (old + state.v)
        free, driven = power(plan, other, mean)
        damped, _ = power(plan, state.elastic, mean)
        energy[0] += plan.step * driven
        energy[2] += plan.step * (damped - free)
        kinetic, alpha = 0.0, 0.0
        for k in range(len(mean)):
            if plan.inverse_mass[k] > 0.0:
                mass = 1.0 / plan.inverse_mass[k]
                kinetic += 0.5 * mass * old[k] * state.v[k]
                alpha += mass * mean[k] ** 2
        energy[1] += plan.step * plan.alpha * alpha
        for k in range(closed):
            i = state.active[k]
            s, m, f, weight = plan.slave[i], plan.master[i], plan.following[i], plan.weight[i]
            rate = mean[s] - (1.0 - weight) * mean[m] - weight * mean[f]
            energy[3] -= plan.step * state.push[k] * rate
            if m == plan.driven:
                energy[0] += plan.step * state.push[k] * (1.0 - weight) * mean[m]
            if f == plan.driven:
                energy[0] += plan.step * state.push[k] * weight * mean[f]
        if n == 0:
            energy[4] = kinetic
        energy[5] = kinetic
