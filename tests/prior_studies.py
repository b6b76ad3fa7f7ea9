"""Studies whose truth is drawn from the prior that is sampled: its ranks, and the intervals that should cover it.

One mass in free decay meets a stop often, once, barely or never. Its displacement is measured with white noise of a
known level, and its motion has no period: no kind of motion takes part in the likelihood. The motion is worked out in
closed form between impacts, which is what the simulator `oscillator` gives at a hundredth of the time.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numba import njit

from calib.confidence.constrained import FittedPoint
from calib.confidence.likelihood import AdjustedLikelihood
from calib.confidence.local import local
from calib.confidence.posterior import LogLikelihood, sample_posterior
from calib.confidence.prior import Prior, positions
from calib.confidence.profile import CROSSED
from calib.confidence.profiles import LocalAnalysis, Profiles, fit_about, profiles
from calib.modelling.parameter import Space, Window
from calib.optimisers.multistart import Multistart
from calib.records import OK
from calib.study import Outcome

TIME = np.arange(200) * 5e-3  # s
NOISE = 1e-4  # standard deviation of the measured displacement  [m]: 5 to 10 % of the motion's
MASS, STIFFNESS, START = 1.0, 1000.0, -4e-3  # kg, N/m, m
SPACE = Space(
    {"restitution": Window(0.0, 0.9), "gap": Window(1e-3, 4.5e-3), "damping": Window(1.0, 10.0, "log")},
    {"mass": MASS, "stiffness": STIFFNESS, "initial_displacement": START},
)
PRIORS = {"gap": Prior("normal", 2.5e-3, 1e-3)}
BUDGET = 200  # simulations of a search
LIVE_POINTS = 100  # of the sampler
DRAWS = 99  # of the posterior that a truth is ranked among
LIKELIHOOD = "log-likelihood"  # ranked beside the parameters: a posterior that ignores the data passes by those alone
RANKED = (*SPACE.names, LIKELIHOOD)
GRAZING_DISTANCE = 3.0  # standard deviations of the noise: a motion that turns so near to the stop grazes it
CONTACT, GRAZING, FREE = "contact", "grazing", "no contact"


@njit
def free_decay_with_stop(times: np.ndarray, restitution: float, gap: float, damping: float) -> np.ndarray:
    """Displacement (n,) [m] of the mass, let go at rest at START, at ascending times (n,) [s]."""
    decay = damping / (2.0 * MASS)
    omega = math.sqrt(STIFFNESS / MASS - decay**2)
    x, v, begin, k = START, 0.0, 0.0, 0
    motion = np.empty(times.size)
    while True:
        sine = (v + decay * x) / omega
        top = math.atan2(v * omega, STIFFNESS / MASS * x + decay * v) / omega
        while top < 0.0 or math.exp(-decay * top) * (x * math.cos(omega * top) + sine * math.sin(omega * top)) < 0.0:
            top += math.pi / omega
        end = math.inf
        if math.exp(-decay * top) * (x * math.cos(omega * top) + sine * math.sin(omega * top)) > gap:
            low, high = max(top - math.pi / omega, 0.0), top
            for _ in range(60):
                end = 0.5 * (low + high)
                inside = math.exp(-decay * end) * (x * math.cos(omega * end) + sine * math.sin(omega * end)) < gap
                low, high = (end, high) if inside else (low, end)
        while k < times.size and times[k] - begin < end:
            t = times[k] - begin
            motion[k] = math.exp(-decay * t) * (x * math.cos(omega * t) + sine * math.sin(omega * t))
            k += 1
        if k == times.size:
            return motion
        closing = math.exp(-decay * end) * (
            v * math.cos(omega * end) - (STIFFNESS / MASS * x + decay * v) / omega * math.sin(omega * end)
        )
        x, v, begin = gap, -restitution * closing, begin + end


def displacement(u: Sequence[float]) -> np.ndarray:
    """Displacement (time,) [m] at a point (dim,) of the unit cube."""
    values = SPACE.values(np.asarray(u, dtype=float))
    return free_decay_with_stop(TIME, values["restitution"], values["gap"], values["damping"])


@dataclass(frozen=True)
class StudyOfDraw:
    """What became of one truth.

    Attributes
    ----------
    number : of the draw
    truth : in SI
    contact : CONTACT, GRAZING or FREE: whether the first approach ends beyond the stop, near it, or before it
    profile, local : parameter -> (low, high) in SI; no local one where the residuals have no derivatives
    closed : parameters whose profile crosses the threshold on both sides
    ranks : of the truth among `DRAWS` draws, with the noise that is known, by parameter and of the log-likelihood
    ranks_of_estimate : the same with the noise as the residuals show it
    cpu : of the search and the profiles, and of the posterior with its simulations  [s]
    """

    number: int
    truth: dict[str, float]
    contact: str
    profile: dict[str, tuple[float, float]]
    local: dict[str, tuple[float, float]]
    closed: tuple[str, ...]
    ranks: dict[str, int]
    ranks_of_estimate: dict[str, int]
    cpu: tuple[float, float]

    def covers(self, intervals: str, parameter: str) -> bool:
        """Whether the interval of a parameter, "profile" or "local", covers its truth; False where there is none."""
        low, high = getattr(self, intervals).get(parameter, (np.nan, np.nan))
        return bool(low <= self.truth[parameter] <= high)


class Comparison:
    """Outcomes of points (n, dim) compared with a measured displacement (time,) [m], as an objective gives them."""

    def __init__(self, measured: np.ndarray):
        self.measured, self.scale = measured, float(measured.std()) * math.sqrt(measured.size)

    def __call__(self, points: np.ndarray) -> list[Outcome]:
        """Evaluate points."""
        return [self.outcome(u) for u in points]

    def outcome(self, u: np.ndarray) -> Outcome:
        """Evaluate one point (dim,)."""
        residuals = (displacement(u) - self.measured) / self.scale
        return Outcome(float(np.linalg.norm(residuals)), residuals, OK, None)

    def analyse(self, u: np.ndarray) -> LocalAnalysis:
        """Analyse one point (dim,)."""
        outcome = self.outcome(u)
        return LocalAnalysis(outcome, local(self, SPACE, u, outcome=outcome))


class Notes(dict):
    """Points in memory."""

    def add(self, key: str, point: FittedPoint) -> None:
        """Keep a point."""
        self[key] = point


def study_of_draw(number: int, ranked: bool = True) -> StudyOfDraw:
    """Draw a truth from the prior, measure it, calibrate it blindly, and ask how sure the values are.

    ranked : whether the posterior is sampled too
    """
    begin = time.process_time()
    rng = np.random.default_rng([20, number])
    u = positions(SPACE, PRIORS, rng.random((1, SPACE.dim)))[0]
    compared = Comparison(displacement(u) + NOISE * rng.standard_normal(TIME.size))
    found = profiles(compared, compared.analyse, SPACE.names, _best(compared, number), Notes())
    profiling = time.process_time() - begin
    ranks, estimate = _ranks(compared, found, u, rng) if ranked else ({}, {})
    return StudyOfDraw(
        number,
        {name: SPACE.values(u)[name] for name in SPACE.names},
        _contact(u),
        {name: _interval(found, name) for name in SPACE.names},
        {name: tuple(map(float, ends)) for name, ends in found.analysis.confidence.interval.items()},
        tuple(name for name, both in found.ends.items() if {end.cause for end in both} == {CROSSED}),
        ranks,
        estimate,
        (profiling, time.process_time() - begin - profiling),
    )


def _best(compared: Comparison, seed: int) -> np.ndarray:
    """Best point (dim,) of a blind search."""
    search = Multistart(dim=SPACE.dim, seed=seed, budget=BUDGET, batch=1)
    best, cost, evaluated = np.full(SPACE.dim, 0.5), math.inf, 0
    while evaluated < BUDGET and search.stop() is None:
        points = search.ask()
        outcomes = compared(points)
        search.tell(points, outcomes)
        evaluated += len(points)
        for point, outcome in zip(points, outcomes, strict=True):
            if outcome.cost < cost:
                best, cost = point, outcome.cost
    search.close()
    return best


def _contact(u: np.ndarray) -> str:
    """Whether the mass reaches the stop as it swings out for the first time."""
    values = SPACE.values(u)
    reach = float(free_decay_with_stop(TIME, 0.0, math.inf, values["damping"]).max()) - values["gap"]
    if abs(reach) < GRAZING_DISTANCE * NOISE:
        return GRAZING
    return CONTACT if reach > 0.0 else FREE


def _interval(found: Profiles, name: str) -> tuple[float, float]:
    sides, window = found.sides[name], SPACE.windows[name]
    low, high = (side.position(end.distance) for side, end in zip(sides, found.ends[name], strict=True))
    return window.value(low), window.value(high)


def _ranks(
    compared: Comparison, found: Profiles, truth: np.ndarray, rng: np.random.Generator
) -> tuple[dict[str, int], dict[str, int]]:
    """Ranks of the truth (dim,) with the known noise and with the estimated one, of the same sample weighted anew."""
    likelihood = with_known_noise(found.centre.likelihood, compared.scale)
    fit = fit_about(found.analysis, likelihood, compared)
    known, estimated = (LogLikelihood(one, found.centre.u) for one in (likelihood, found.centre.likelihood))
    posterior = sample_posterior(
        lambda us: np.array([known(point) for point in fit.at(us)]), partial(positions, SPACE, PRIORS), SPACE.dim,
        seed=int(rng.integers(2**31)), live_points=LIVE_POINTS,
    )  # fmt: skip
    [own] = fit.at(truth[None])
    other = np.array([estimated(point) for point in fit.at(posterior.points)])
    weights = np.exp(other - posterior.log_likelihood - (other - posterior.log_likelihood).max())
    chosen = rng.choice(len(other), DRAWS, p=weights / weights.sum())
    return (
        _ranked(posterior.points[:DRAWS], posterior.log_likelihood[:DRAWS], truth, known(own), rng),
        _ranked(posterior.points[chosen], other[chosen], truth, estimated(own), rng),
    )


def _ranked(
    points: np.ndarray, log_likelihood: np.ndarray, truth: np.ndarray, own: float, rng: np.random.Generator
) -> dict[str, int]:
    """Rank of the truth (dim,) among draws (n, dim), by parameter and of the log-likelihood; ties at random."""
    columns = np.column_stack([points, log_likelihood]).T
    return {
        name: int(np.sum(column < value) + rng.integers(np.sum(column == value) + 1))
        for name, column, value in zip(RANKED, columns, (*truth, own), strict=True)
    }


def with_known_noise(likelihood: AdjustedLikelihood, scale: float) -> AdjustedLikelihood:
    """Return the likelihood of white noise of the level of the measurement; `scale` of a residual  [m]."""
    return replace(
        likelihood,
        covariance=(NOISE / scale) ** 2 * likelihood.unit_covariance,
        degrees_of_freedom=np.full(SPACE.dim, np.inf),
    )
