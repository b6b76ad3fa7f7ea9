"""Morris' elementary effects of the parameters on an output."""

from collections.abc import Sequence

import numpy as np

from calib.sweep.sensitivity.design import SensitivityDesign
from calib.sweep.sensitivity.document import Estimate, Influence

MIN_EFFECTS = 4  # elementary effects of a parameter, below which nothing is said of it
MORRIS_RESAMPLES = 1000  # of the bootstrap
CONFIDENCE = 0.95  # of intervals


def elementary_effects(design: SensitivityDesign, values: np.ndarray) -> list[np.ndarray]:
    """Elementary effects (k,) of each parameter: changes of the output over changes of the coordinate.

    Of each trajectory one effect of each parameter; only of steps whose two ends both show the output (Morris 1991,
    Technometrics 33, 161).

    Parameters
    ----------
    values : (size,) of the output  [unit]; NaN where a point does not show it
    """
    steps = np.diff(design.grouped(design.points), axis=1)
    changes = np.diff(design.grouped(values), axis=1)
    moved = np.abs(steps).argmax(axis=2)
    taken = np.take_along_axis(steps, moved[:, :, None], axis=2)[:, :, 0]
    effects = changes / taken
    return [effects[(moved == axis) & np.isfinite(effects)] for axis in range(design.dim)]


def morris_influences(design: SensitivityDesign, names: Sequence[str], values: np.ndarray) -> tuple[Influence, ...]:
    """Influence of each parameter on an output whose values (size,) are NaN where a point does not show it.

    mu_star is that of Campolongo, Cariboni and Saltelli (2007), Environmental Modelling & Software 22, 1509. Intervals
    are percentiles of the bootstrap over the trajectories.
    """
    pairs = zip(names, elementary_effects(design, values), strict=True)
    return tuple(_influence(name, effects, design.seed) for name, effects in pairs)


def _influence(name: str, effects: np.ndarray, seed: int) -> Influence:
    count = effects.size
    if count < MIN_EFFECTS:
        reason = (
            f"not available: {count} of its steps have both ends where the output is defined, {MIN_EFFECTS} are needed"
        )
        return Influence(name, count=count, reason=reason)
    drawn = effects[np.random.default_rng([seed, count]).integers(count, size=(MORRIS_RESAMPLES, count))]
    return Influence(
        name,
        mu_star=_estimate(np.abs(effects).mean(), np.abs(drawn).mean(axis=1)),
        mu=_estimate(effects.mean(), drawn.mean(axis=1)),
        sigma=_estimate(effects.std(ddof=1), drawn.std(axis=1, ddof=1)),
        count=count,
    )


def _estimate(value: float, resampled: np.ndarray) -> Estimate:
    low, high = np.quantile(resampled, [0.5 * (1.0 - CONFIDENCE), 0.5 * (1.0 + CONFIDENCE)])
    return Estimate(float(value), float(low), float(high))
