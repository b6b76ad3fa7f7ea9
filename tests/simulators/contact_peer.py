"""Compliant contact of the lumped simulators once more, with scipy's DOP853 and its events."""

from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

RTOL, ATOL = 2.3e-14, 1e-18


class ContactRun(NamedTuple):
    """Impacts, the state at the end, and how often parted bodies met anew before they had separated."""

    times: np.ndarray  # (k,) s
    speeds: np.ndarray  # (k,) m/s
    state: np.ndarray  # (2 n,)
    renewals: int


def dop853_in_contact(acceleration, normal, hit, gap, law, state, end, step):
    """Integrate from `state` (2 n,) at time 0 to `end` [s].

    acceleration(t, q, dq) -> (n,) out of contact; law: `contact_laws.ContactLaw`; step: longest in contact [s].
    """
    n, x, t, regime, speed = len(hit), np.asarray(state, dtype=float), 0.0, "free", 1.0
    times, speeds, renewals = [], [], 0

    def depth(t, x):
        return -(gap + normal @ x[:n])

    def factor(t, x):
        loss = law.loss / speed if law.by_speed else law.loss
        return 1.0 - loss * (normal @ x[n:])

    def force(t, x):
        return law.stiffness * max(0.0, depth(t, x)) ** law.exponent * factor(t, x) - law.damping * (normal @ x[n:])

    def free(t, x):
        return np.concatenate([x[n:], acceleration(t, x[:n], x[n:])])

    def pressed(t, x):
        return np.concatenate([x[n:], acceleration(t, x[:n], x[n:]) + hit * force(t, x)])

    def event(function, direction):
        def wrapped(t, x):
            return function(t, x)

        wrapped.terminal, wrapped.direction = True, direction
        return wrapped

    ending = force if law.damping > 0.0 else factor
    while t < end:
        if regime == "free":
            rate, events, longest = free, [event(depth, 1)], 8.0 * step
        elif regime == "pressed":
            rate, longest = pressed, step
            events = [event(ending, -1)] + ([] if law.damping > 0.0 else [event(depth, -1)])
        else:
            rate, events, longest = free, [event(ending, 1), event(depth, -1)], step
        run = solve_ivp(rate, (t, end), x, "DOP853", rtol=RTOL, atol=ATOL, events=events, max_step=longest)
        t, x = run.t[-1], run.y[:, -1]
        if run.status != 1:
            break
        which = next(i for i, at in enumerate(run.t_events) if len(at))
        if regime == "free":
            speed = -(normal @ x[n:])
            times.append(t)
            speeds.append(speed)
            regime = "pressed"
        elif which == 0:
            renewals += regime == "parted"
            regime = "parted" if regime == "pressed" else "pressed"
        else:
            regime = "free"
    return ContactRun(np.array(times), np.array(speeds), x, renewals)
