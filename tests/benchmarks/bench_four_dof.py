"""Speed of `four_dof` against scipy's DOP853 with events and against heyoka, in one run: ratios, not seconds.

    python tests/benchmarks/bench_four_dof.py

CPU seconds, compiled before they are timed; the default set at e = 0.05, 0.20, 0.50. Each peer's event times are
compared with the simulator's first, over the first 20 impacts, so that the speeds belong to equal accuracy.
"""

import time

import numpy as np
from simulators.four_dof_peer import dop853, spring_drive

from calib.records.excitation import Excitation
from calib.simulators.four_dof import FourDof
from calib.simulators.impact import kernel
from calib.simulators.impact.initial_state import start
from calib.simulators.impact.problem import IMPACTS
from calib.simulators.impact.scratch import scratch

FREQUENCY = 26.24  # Hz
NOMINAL = {p.name: p.nominal for p in FourDof.parameters}


def cpu(function, repeat=3):
    """CPU seconds of the fastest of some calls, and what the call gave."""
    best, result = np.inf, None
    for _ in range(repeat):
        begin = time.process_time()
        result = function()
        best = min(best, time.process_time() - begin)
    return best, result


def ours(values, periods):
    """Times of the impacts of the first periods from rest [s]."""
    problem = FourDof().problem(values, Excitation("end", "displacement", frequency=FREQUENCY, amplitude=1.5e-3))
    state = start(problem, np.zeros(4), np.zeros(4))
    rows, none, impacts = np.zeros((periods, 10)), np.zeros((0, 10)), np.zeros((20_000, 10))
    kernel.advance(problem, state, scratch(problem), periods, 0.0, 10**9, rows, np.zeros(0), none, impacts)
    return impacts[: min(len(impacts), int(state.counters[IMPACTS])), 0]


def heyoka(values):
    """Make the function periods -> times of impacts [s] of heyoka's Taylor integrator with a terminal event."""
    import heyoka as hy

    mass, stiffness, damping, load = spring_drive(values, 1.5e-3)
    gap, e = values["gap"], values["restitution"]
    q, v = hy.make_vars(*(f"q{i}" for i in range(4))), hy.make_vars(*(f"v{i}" for i in range(4)))
    drive = load * hy.cos(2.0 * np.pi * FREQUENCY * hy.time)
    equations = []
    for i in range(4):
        force = hy.sum([*(-stiffness[i, j] * q[j] for j in range(4)), *(-damping[i, j] * v[j] for j in range(4))])
        equations.append((v[i], (force + (drive if i == 0 else 0.0)) / mass[i, i]))
    equations = [(q[i], v[i]) for i in range(4)] + equations
    times = []

    def strike(integrator, d_sgn):
        times.append(integrator.time)
        x = integrator.state
        x[6] += (1.0 + e) * (x[5] - x[6])
        return True

    event = hy.t_event(gap + q[2] - q[1], callback=strike, direction=hy.event_direction.negative)
    integrator = hy.taylor_adaptive(equations, np.zeros(8), tol=1e-15, t_events=[event])

    def run(periods):
        times.clear()
        integrator.time = 0.0
        integrator.state[:] = 0.0
        integrator.reset_cooldowns()
        integrator.propagate_until(periods / FREQUENCY)
        return np.array(times)

    return run


def main():
    """Print accuracy and ratios."""
    for e in (0.05, 0.20, 0.50):
        values = {**NOMINAL, "restitution": e}
        run = heyoka(values)
        run(1), ours(values, 1)
        reference = dop853(values, FREQUENCY, 1.5e-3, 20)
        first = reference.times[reference.speeds > 1e-3]
        periods = int(first[-1] * FREQUENCY) + 2
        mine, his = ours(values, periods), run(periods)

        def error(times, first=first):
            return max(np.abs(times - t).min() for t in first)

        fast, _ = cpu(lambda values=values: ours(values, 1000))
        taylor, _ = cpu(lambda run=run: run(1000))
        stepwise, _ = cpu(lambda values=values: dop853(values, FREQUENCY, 1.5e-3, 10**9, end=20.0 / FREQUENCY), 1)
        print(
            f"e {e:.2f}: {1e3 * fast:6.2f} ms per 1000 periods; heyoka {taylor / fast:5.1f} times, "
            f"DOP853 {50.0 * stepwise / fast:7.0f} times as long; largest difference from DOP853 over 20 impacts: "
            f"ours {error(mine):.1e} s, heyoka {error(his):.1e} s"
        )


if __name__ == "__main__":
    main()
