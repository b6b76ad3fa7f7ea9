"""The graded margins of evaluated points: how far each is from leaving the window, and by what."""

from collections.abc import Mapping, Sequence

import numpy as np

from calib.confidence.window.motion import CLEARANCE, CLOSEST_APPROACH, CLOSING_SPEED, MULTIPLIER
from calib.confidence.window.observed import Observed, graded
from calib.objective.objective import MAX_AGREEMENT_DISTANCE, MIN_COST_OF_WRONG_KIND
from calib.records.cycles import NO_CONTACT
from calib.store import Trial

MODEL_ERROR_FACTOR = np.sqrt(2.0)  # tolerance over calibrated distance: as much again, added in quadrature  [1]
MECHANISMS = {  # quantity of a periodic motion -> what happens where its margin is zero
    MULTIPLIER: "loss of stability",
    CLEARANCE: "grazing: an impact appears",
    CLOSING_SPEED: "grazing: an impact vanishes",
}
CONTACT_MARGIN = "grazing: the only contact begins or ends"
FEWEST_SHOWN_SHARE = 0.5  # of the points of the measured kind that have to show a quantity of the motion  [1]


def default_tolerance(distance: float) -> float:
    """Tolerance of a term whose calibrated distance is `distance`  [1].

    It is `MAX_AGREEMENT_DISTANCE`, up to which a simulation counts as agreeing, or, where the calibrated point is
    farther off, the distance at which as much error again is added to the model's own, in quadrature.
    """
    return max(MAX_AGREEMENT_DISTANCE, float(MODEL_ERROR_FACTOR * distance))


def of_measured_kind(trial: Trial, calibrated: Trial) -> bool:
    """Whether the motion of a point is of the measured kind in all records, with contact as the calibrated one.

    A measured record does not list its impacts: whether there is contact is known of simulations alone.
    """
    return _periodic(trial) and (NO_CONTACT in (trial.kind or "")) == (NO_CONTACT in (calibrated.kind or ""))


def _periodic(trial: Trial) -> bool:
    """Whether the motion of a point has the measured period in all records, whatever its contact."""
    return trial.scored and trial.cost < MIN_COST_OF_WRONG_KIND


def observed_of(trials: Sequence[Trial], tolerances: Mapping[str, float]) -> Observed:
    """What trials tell of the window; the first one is the calibrated point.

    Where each motion says how near it is to a contact that begins or ends, a motion without the calibrated one's
    contact is no label but a negative margin, and its misfit is known as that of any other.

    Parameters
    ----------
    tolerances : term -> largest distance of an admissible point
    """
    wanted = np.array([of_measured_kind(trial, trials[0]) for trial in trials])
    contact = np.array([_contact_margin(trial, trials[0]) for trial in trials])
    right = wanted | np.array([_periodic(trial) for trial in trials]) & np.isfinite(contact)
    columns, labels, of_kind = list[np.ndarray](), list[str](), list[bool]()
    for label, tolerance in tolerances.items():
        distance = np.array([trial.terms.get(label, np.nan) for trial in trials])
        columns.append(np.where(right, graded(np.where(right, distance, 0.0), tolerance), np.nan))
        labels.append(f"misfit of {label}")
        of_kind.append(False)
    for quantity, mechanism in MECHANISMS.items():
        column = np.where(wanted, [_motion_margin(trial, quantity) for trial in trials], np.nan)
        if np.isfinite(column).sum() >= max(FEWEST_SHOWN_SHARE * wanted.sum(), 1):
            columns.append(column)
            labels.append(mechanism)
            of_kind.append(True)
    if (right & ~wanted).any():
        columns.append(np.where(right, contact, np.nan))
        labels.append(CONTACT_MARGIN)
        of_kind.append(False)  # it is known on both sides
    points = np.array([trial.u for trial in trials], dtype=float)
    return Observed(points, right, np.column_stack(columns), tuple(labels), tuple(of_kind))


def _contact_margin(trial: Trial, calibrated: Trial) -> float:
    """Closest approach over the amplitude, the least of all records  [1]; NaN where one does not show it.

    It is positive where there is contact as in the calibrated motion.
    """
    own, wanted = _closest_approach(trial), _closest_approach(calibrated)
    if not wanted or not wanted.keys() <= own.keys():
        return float("nan")
    return min(float(np.copysign(own[record], own[record] * wanted[record])) for record in wanted)


def _closest_approach(trial: Trial) -> dict[str, float]:
    """Record -> closest approach of the motion over its amplitude  [1]."""
    return {
        one["record"]: one["simulated"] / one["tolerance"] for one in trial.features if one["label"] == CLOSEST_APPROACH
    }


def _motion_margin(trial: Trial, quantity: str) -> float:
    """Margin of a quantity of the periodic motions, the least of all records; NaN where none shows it.

    Of a multiplier it is 1 minus the square of its modulus, which is smooth where two multipliers meet on the real axis
    as on the circle; of a speed its square, which vanishes with the parameter as a clearance does (Nordmark 1991).
    """
    shown = [one for one in trial.features if one["label"] == quantity and one["simulated"] is not None]
    if not shown:
        return float("nan")
    ratios = [one["simulated"] / one["tolerance"] for one in shown]
    if quantity == MULTIPLIER:
        return float(1.0 - max(ratios) ** 2)
    return float(min(ratios) ** 2 if quantity == CLOSING_SPEED else min(ratios))
