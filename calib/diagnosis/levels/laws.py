"""Trends that the force laws of effects make of the equivalent damping and stiffness over the amplitude."""

from collections.abc import Mapping

import numpy as np

from calib.diagnosis.levels.document import LawTrendResult
from calib.diagnosis.levels.equivalent_law import equivalent_law
from calib.diagnosis.selection import Selection
from calib.diagnosis.suspect import Refitted, Suspect, leading_variants
from calib.modelling.model import Model
from calib.modelling.parameter import values_for


def law_trends(
    model: Model, selection: Selection, record: str, body: str, amplitude: np.ndarray, omega: float
) -> tuple[LawTrendResult, ...]:
    """Trends of the laws of the causes, then of the other suspects with a significant score test, the strongest first.

    Of force laws on the body that are not explicit in time. A cause has the size of the joint fit. The power of another
    law is that at its natural size, where no refit has one; whether it makes damping or stiffness rise is known then
    only of a size that has one sign.

    Parameters
    ----------
    amplitude : (2,) least and greatest of the body  [m]
    omega : angular frequency  [rad/s]
    """
    first = selection.rounds[0]
    causes = {cause.name for cause in selection.causes}
    others = [s for s in leading_variants(first.suspects) if s.name not in causes]
    told: list[Suspect] = [*selection.causes, *(s for s in others if abs(s.z) > first.threshold)]
    trends = []
    for suspect in told:
        effect, is_cause = suspect.candidate.effect, suspect.name in causes
        if effect.site != "force" or effect.place != "body" or effect.transient:
            continue
        if effect.bodies is not None and body not in effect.bodies:
            continue
        values, sized = _values(suspect, selection, is_cause)
        law = effect.bound({**model.nominal, **values_for(values, record)})
        own = equivalent_law(law, amplitude, omega)
        if own is None:
            continue
        damping, stiffness = own.changes if sized else (None, None)
        trends.append(LawTrendResult(suspect.name, is_cause, own.damping_power, damping, stiffness))
    return tuple(trends)


def _values(suspect: Suspect, selection: Selection, is_cause: bool) -> tuple[Mapping[str, float], bool]:
    """Values of the model with a suspect, and whether the sign of its size is known."""
    if is_cause:
        return selection.final.point.values, True
    candidate = suspect.candidate
    if isinstance(suspect, Refitted) and suspect.fit.names and not candidate.effect.at_null(suspect.fit.point.values):
        return suspect.fit.point.values, True
    scale = np.array([candidate.scale[name] for name in candidate.free])
    sign = candidate.sign or 1
    null = np.where(np.isfinite(candidate.null), candidate.null, 0.0)
    return {**selection.null.point.values, **candidate.values(null + sign * scale)}, candidate.sign != 0
