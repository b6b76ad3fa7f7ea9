"""The end of a curve of cycles at a grazing, where an impact is about to appear or to vanish."""

from collections.abc import Sequence

import numpy as np

from calib.dynamics.orbits import Cycle

MAX_GRAZING_MARGIN = 1e-2  # margin and distance along the curve up to which a curve is extrapolated to grazing
SECTION_MARGIN = 1e-3  # periods: distance of an impact from the section that explains an end


def impacts_differ(one: Cycle, other: Cycle) -> bool:
    """Whether an impact has come or gone; chatter, which ends in permanent contact, has no number of impacts."""
    return one.impacts != other.impacts and not (one.orbit.contact or other.orbit.contact)


def extrapolated(curve: Sequence[np.ndarray], margins: Sequence[float]) -> np.ndarray | None:
    """Extrapolate points (d,) of a curve to margin 0; None where it does not run there.

    Taken are three points of which each has at least twice the margin of the next: a parabola through them is good to
    the third power of the last margin, which neither rounding nor the steps that end before the grazing disturb.
    """
    chosen = [len(curve) - 1]
    for i in range(len(curve) - 1, -1, -1):
        if len(chosen) < 3 and margins[i] >= 2.0 * margins[chosen[-1]]:
            chosen.append(i)
    own = np.array([margins[i] for i in chosen])
    if len(chosen) < 3 or not 0.0 < own[0] < MAX_GRAZING_MARGIN or not np.isfinite(own).all():
        return None
    z = at_zero([curve[i] for i in chosen], own)
    return z if np.linalg.norm(z - curve[-1]) < MAX_GRAZING_MARGIN else None


def at_zero(values: Sequence[np.ndarray], places: np.ndarray) -> np.ndarray:
    """Value at 0 of the polynomial through the values at the places (n,)."""
    weights = [np.prod([p / (p - own) for p in np.delete(places, i)]) for i, own in enumerate(places)]
    return np.sum([weight * value for weight, value in zip(weights, values, strict=True)], axis=0)


def section_hint(cycle: Cycle) -> str:
    """What to do where a curve is lost and an impact is close to the section; empty elsewhere."""
    phases = cycle.orbit.impacts[:, 1]
    if np.any(np.minimum(phases, 1.0 - phases) < SECTION_MARGIN):
        return "; an impact comes to the section, take it at another phase of the excitation"
    return ""
