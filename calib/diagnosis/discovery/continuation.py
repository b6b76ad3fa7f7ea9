"""How far beyond the visited states a formula is continued: as far as it is known there.

Of one formula the standard error by those of its numbers says it (delta method). That a formula is the right one says
no error inside the region: further ones that tie with it do, by how far they part from it outside. Beyond the end of
what both allow, the force is continued linearly.
"""

from collections.abc import Sequence

import numpy as np

from calib.diagnosis.discovery.formulas import FormulaTrial
from calib.diagnosis.discovery.free_force import DISPLACEMENT
from calib.diagnosis.discovery.outcome import Discovery
from calib.diagnosis.discovery.penalised import FreeModel, States

MAX_CONTINUATION = 0.5  # beyond each end of the visited region, over its width  [1]
CONTINUATION_POINTS = 25  # that are tried beyond each end  [count]
MAX_ERROR_SHARE = 0.1  # of a continued force that its error may be: root mean squares  [1]
MAX_COMPANIONS = 40  # visited values of the other argument, over which these means are taken  [count]
NUMBER_STEP = 1e-4  # of a difference by a number of the formula, in its standard errors or its value  [1]


def known_region(discovery: Discovery, trial: FormulaTrial, states: States) -> dict[str, tuple[float, float]]:
    """Least and largest value of each argument up to which a formula of the force is known.

    Parameters
    ----------
    discovery : that found it, with the formulas that tie with it
    states : visited ones
    """
    rivals = [t for t in discovery.formulas if t.ties and t is not trial]
    if discovery.chosen is None:
        return states.region
    fitted = discovery.chosen.fitted
    return continued_region(trial, rivals, states, fitted.model, fitted.smoothing.absorbed)


def continued_region(
    trial: FormulaTrial, rivals: Sequence[FormulaTrial], states: States, model: FreeModel, absorbed: np.ndarray
) -> dict[str, tuple[float, float]]:
    """Return the region in which the error of a formula is a small share of the force.

    Parameters
    ----------
    rivals : formulas that tie with it
    model, absorbed : the free forces, and the linear functions (p, q) of them that calibrated parameters absorb: by
        those the formulas may differ
    """
    step = max(1, states.x.size // MAX_COMPANIONS)
    companions = States(states.x[::step], states.v[::step])
    typical = _rms(trial.formula.values(companions.x, companions.v))
    region = {}
    for argument, (low, high) in states.region.items():
        reach = MAX_CONTINUATION * (high - low) * np.linspace(0.0, 1.0, CONTINUATION_POINTS + 1)[1:]
        ends = []
        for end, outward in ((low, -1.0), (high, 1.0)):
            last = end
            for at in end + outward * reach:
                beyond = _moved(companions, argument, float(at))
                error = _error(trial, rivals, companions, beyond, model, absorbed)
                allowed = MAX_ERROR_SHARE * max(typical, _rms(trial.formula.values(beyond.x, beyond.v)))
                if not error <= allowed:
                    break
                last = float(at)
            ends.append(last)
        region[argument] = (ends[0], ends[1])
    return region


def _moved(states: States, argument: str, at: float) -> States:
    """States with another value of an argument."""
    value = np.full(states.x.size, at)
    return States(value, states.v) if argument == DISPLACEMENT else States(states.x, value)


def _error(
    trial: FormulaTrial,
    rivals: Sequence[FormulaTrial],
    companions: States,
    beyond: States,
    model: FreeModel,
    absorbed: np.ndarray,
) -> float:
    """Root mean square of the error of a formula at states: its own, or the distance to a rival if that is larger."""
    inside, outside = (model.matrix(s.x, s.v) @ absorbed for s in (companions, beyond))
    errors = [_standard_error(trial, beyond)]
    for rival in rivals:
        apart = [rival.formula.values(s.x, s.v) - trial.formula.values(s.x, s.v) for s in (companions, beyond)]
        share = np.linalg.lstsq(inside, apart[0], rcond=None)[0]
        errors.append(_rms(apart[1] - outside @ share))
    return max(errors)


def _standard_error(trial: FormulaTrial, states: States) -> float:
    """Root mean square standard error of a formula at states, by the covariance of its numbers."""
    numbers, formula = trial.formula.numbers, trial.formula
    values = {n.name: n.value for n in numbers}
    covariance = trial.fit.covariance([f"{trial.prefix}_{name}" for name in values])
    if not np.isfinite(covariance).all():
        return np.inf
    slopes = []
    for number, error in zip(numbers, np.sqrt(np.diag(covariance)), strict=True):
        step = NUMBER_STEP * float(error) or NUMBER_STEP * abs(number.value) or NUMBER_STEP
        ends = [formula.at({**values, number.name: number.value + s}).values(states.x, states.v) for s in (-step, step)]
        slopes.append((ends[1] - ends[0]) / (2.0 * step))
    rows = np.column_stack(slopes)
    return float(np.sqrt(np.mean(np.sum((rows @ covariance) * rows, axis=1))))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
