"""Whether the starts of a search agree, as intervals about one minimum need."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from calib.confidence.likelihood import AdjustedLikelihood
from calib.confidence.local import Confidence
from calib.modelling.parameter import Space
from calib.records import OK


def where_starts_agree(confidence: Confidence, space: Space, u: np.ndarray, agreement: Mapping[str, Any]) -> Confidence:
    """Confidence without its intervals where the starts of the search contradict them.

    They do where one ended outside the intervals, and still in the joint confidence region of the likelihood; and where
    several have ended, of which only the best one did so at the best point or, in that region, inside the intervals.

    Parameters
    ----------
    u : (dim,) the best point  [1]
    agreement : the optimiser's summary; one without several `basins`, of point (dim,), cost and searches, says nothing
    """
    basins = agreement.get("basins", ())
    if confidence.status != OK or confidence.linearised is None or len(basins) < 2:
        return confidence
    likelihood, axes = AdjustedLikelihood.of(confidence.linearised), range(space.dim)
    agree = int(basins[0]["searches"])
    for basin in basins[1:]:
        shift = np.array(basin["point"]) - u
        if not likelihood.ratio(basin["cost"] ** 2, axes, shift) <= likelihood.quantile(axes):
            continue
        values = space.values(np.array(basin["point"]))
        outside = [name for name, (low, high) in confidence.interval.items() if not low <= values[name] <= high]
        if outside:
            return _without(
                confidence,
                f"a start of the search ended at another value of {', '.join(outside)}, outside the intervals about "
                "this point, and the noise does not tell which is the better one; sample the posterior distribution",
            )
        agree += int(basin["searches"])
    if agree > 1:
        return confidence
    ended = sum(int(basin["searches"]) for basin in basins)
    return _without(
        confidence,
        f"of {ended} starts of the search that ended only one did so at this point, so that a lower minimum may be "
        "elsewhere; give the search a larger budget",
    )


def _without(confidence: Confidence, reason: str) -> Confidence:
    """Return the confidence without its intervals."""
    return Confidence(
        "not available", reason, confidence.names, confidence.value, at_edge=confidence.at_edge,
        evaluations=confidence.evaluations, linearised=confidence.linearised,
    )  # fmt: skip
