"""A latent force of Matern-3/2 covariance on a linear oscillator: Kalman filter, Rauch-Tung-Striebel smoother, bins.

The force is a Gaussian process in time, smoothed with the states (Rogers & Friis, Mechanical Systems and Signal
Processing 180 (2022) 109362; Sarkka & Solin, Applied Stochastic Differential Equations (2019), section 12.3), then
averaged over the states.
"""

import numpy as np
from benchmarks.peer_data import Data, Force
from numba import njit
from scipy.linalg import expm, solve_continuous_lyapunov
from scipy.optimize import minimize

BINS = {"x": (24, 1), "v": (1, 24), "both": (12, 12)}  # along x and v  [count]
UNKNOWN_SPEED = 1.0  # m/s, standard deviation of the velocity after an impact


@njit(cache=True)
def smoothed(transition, noise, gain, load, seen, variance, struck, prior):  # pragma: no cover - compiled
    """Kalman filter and RTS smoother of one record.

    Parameters
    ----------
    transition, noise : (4, 4) of a step, of (x, v, f, f')
    gain : (4, 2) of the load at both ends of a step
    load : (n,) over the mass; seen : (n, 2) displacement and velocity; variance : (2,) of their noise
    struck : (n,) whether an impact lies before this sample
    prior : (4, 4) covariance at the first sample, about the first measurement

    Returns
    -------
    minus the log likelihood, and the smoothed means (n, 4) and variances (n,) of the force
    """
    n = load.size
    ahead, spread = np.zeros((n, 4)), np.zeros((n, 4, 4))
    m, p = np.zeros(4), prior.copy()
    m[0], m[1] = seen[0, 0], seen[0, 1]
    means, covariances = np.zeros((n, 4)), np.zeros((n, 4, 4))
    cost = 0.0
    for k in range(n):
        if k > 0:
            m = transition @ m + gain[:, 0] * load[k - 1] + gain[:, 1] * load[k]
            p = transition @ p @ transition.T + noise
            if struck[k]:
                p[1, :] = 0.0
                p[:, 1] = 0.0
                p[1, 1] = 1.0
                m[1] = seen[k, 1]
                p[0, 0] += 1e-6
                p[2, 2], p[3, 3] = p[2, 2] + prior[2, 2], p[3, 3] + prior[3, 3]
        ahead[k], spread[k] = m, p
        s = p[:2, :2].copy()
        s[0, 0] += variance[0]
        s[1, 1] += variance[1]
        e = seen[k] - m[:2]
        inverse = np.linalg.inv(s)
        if k > 0 and not struck[k]:
            cost += 0.5 * (e @ inverse @ e + np.log(np.linalg.det(s)))
        weight = np.ascontiguousarray(p[:, :2]) @ inverse
        m = m + weight @ e
        p = p - weight @ s @ weight.T
        p = 0.5 * (p + p.T)
        means[k], covariances[k] = m, p
    out, out_variance = means.copy(), np.zeros(n)
    later = covariances[n - 1].copy()
    out_variance[n - 1] = later[2, 2]
    for k in range(n - 2, -1, -1):
        if struck[k + 1]:
            later = covariances[k].copy()
        else:
            back = np.linalg.solve(spread[k + 1], transition @ covariances[k]).T
            out[k] = means[k] + back @ (out[k + 1] - ahead[k + 1])
            later = covariances[k] + back @ (later - spread[k + 1]) @ back.T
        out_variance[k] = later[2, 2]
    return cost, out, out_variance


def _latent(data: Data, level: float, time_scale: float) -> tuple[float, list, list]:
    """Minus the log likelihood, and the smoothed states and variances of the force of each record."""
    decay = np.sqrt(3.0) / time_scale
    a = np.array([[0.0, 1.0, 0.0, 0.0], [-data.linear[0], -data.linear[1], 1.0, 0.0],
                  [0.0, 0.0, 0.0, 1.0], [0.0, 0.0, -(decay**2), -2.0 * decay]])  # fmt: skip
    q = np.zeros((4, 4))
    q[3, 3] = 4.0 * decay**3 * level**2
    cost, states, variances = 0.0, [], []
    for piece, impacts, sigma in zip(data.whole, data.impacts, data.sigma, strict=True):
        step = float(piece.t[1] - piece.t[0])
        fraction = expm(np.block([[-a, q], [np.zeros((4, 4)), a.T]]) * step)
        transition = np.ascontiguousarray(fraction[4:, 4:].T)
        noise = transition @ fraction[:4, 4:]
        hold = np.zeros((6, 6))
        hold[:4, :4], hold[1, 4], hold[4, 5] = a, 1.0, 1.0
        both = expm(hold * step)[:4, 4:]
        gain = np.column_stack([both[:, 0] - both[:, 1] / step, both[:, 1] / step])
        struck = np.zeros(piece.t.size, dtype=bool)
        places = np.searchsorted(piece.t, impacts)
        struck[places[places < struck.size]] = True
        force = solve_continuous_lyapunov(a[2:, 2:], -q[2:, 2:])
        prior = np.diag([1e-6, UNKNOWN_SPEED**2, force[0, 0], force[1, 1]])
        seen = np.ascontiguousarray(np.column_stack([piece.x, piece.v]))
        own = smoothed(transition, 0.5 * (noise + noise.T), gain, piece.load, seen, sigma**2, struck, prior)
        cost += own[0]
        states.append(own[1])
        variances.append(own[2])
    return cost, states, variances


def by_latent_force(data: Data) -> tuple[Force, str]:
    """Latent force of greatest likelihood, averaged in bins."""
    starts = np.log([[0.3, 0.01], [0.3, 0.05], [1.5, 0.02]])
    best = minimize(lambda z: _latent(data, *np.exp(z))[0], starts[0], method="Nelder-Mead",
                    options={"maxfev": 120, "xatol": 0.02, "fatol": 0.1, "initial_simplex": starts})  # fmt: skip
    _, states, variances = _latent(data, *np.exp(best.x))
    edges = [(min(s[:, i].min() for s in states), max(s[:, i].max() for s in states)) for i in (0, 1)]
    errors = {}
    for name, counts in BINS.items():
        left = 0.0
        for k in range(len(states)):
            force = _binned(states, variances, [j for j in range(len(states)) if j != k], counts, edges)
            own = (states[k][:, 2] - force(states[k][:, 0], states[k][:, 1])) ** 2 / variances[k]
            left += float(np.sum(own))
        errors[name] = left
    name = min(errors, key=lambda n: errors[n])
    said = f"bins over {name}, level {np.exp(best.x[0]):.2g} m/s^2, time {np.exp(best.x[1]):.2g} s"
    return _binned(states, variances, range(len(states)), BINS[name], edges), said


def _binned(states, variances, records, counts, edges) -> Force:
    """Weighted mean of the latent force in each bin; in empty ones the mean of all."""
    chosen = np.concatenate([states[k] for k in records])
    weight = 1.0 / np.concatenate([variances[k] for k in records])

    def place(x, v):
        i, j = (np.clip(((u - low) / (high - low) * n).astype(int), 0, n - 1)
                for u, n, (low, high) in zip((x, v), counts, edges, strict=True))  # fmt: skip
        return i * counts[1] + j

    own, total = place(chosen[:, 0], chosen[:, 1]), counts[0] * counts[1]
    sums = np.bincount(own, weight * chosen[:, 2], total)
    weights = np.bincount(own, weight, total)
    means = np.where(
        weights > 0.0, sums / np.where(weights > 0.0, weights, 1.0), np.average(chosen[:, 2], weights=weight)
    )
    return lambda x, v: means[place(x, v)]
