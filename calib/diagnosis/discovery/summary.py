"""The verdict of a search for a force law in words."""

from collections.abc import Sequence

from calib.diagnosis.discovery.history import HistoryTrial
from calib.diagnosis.discovery.left_out import LeftOutMisfit
from calib.diagnosis.discovery.place import ForcePlace
from calib.diagnosis.discovery.trial import ForceTrial, described

NO_STEP = (
    "a force is missing, but no free force that was tried reduces the misfit: the calibrated motion is too far from "
    "the measured one; calibrate to records of smaller amplitude, or to shorter ones, first"
)
UNTESTED = (
    "a force is missing, but the records cannot tell of what it is a function: the cycles of one steady motion are no "
    'prediction of each other; record further amplitudes, or a free decay, with use = "name"'
)
CUT_SHORT = "the budget ended the search before all was tried; of what was"
UNTOLD = "But all records visit one curve of states: they cannot tell of what it is a function"


def explained_share(without: float, left: float) -> float:
    """Share of the excess chi-square of a model that a further force explains  [1]."""
    return 1.0 - max(0.0, left) / max(without, 1e-300)


def summary_of(
    chosen: ForceTrial,
    tied: Sequence[ForceTrial],
    rivals: Sequence[ForcePlace],
    excess: tuple[float, float] | None,
    null_left_out: LeftOutMisfit,
    rms: float | None,
) -> str:
    """Verdict on a force in a few sentences.

    excess : chi-square without and with the force; None where that without it is within the noise
    rms : of the whitened residual that it leaves, where that is more than noise  [1]
    """
    further = [t for t in tied if t is not chosen and t.body == chosen.body]
    better = [t for t in further if t.predicts_better(chosen)]
    others = [described(t.arguments, t.place) for t in further if t not in better]
    deviances = f"{null_left_out.deviance:.4g} to {chosen.predictive_deviance:.4g}"
    gain = (
        f"lowers the predictive deviance of left-out records from {deviances}, though the misfit of the calibrated "
        "model as a whole is within its noise"
        if excess is None
        else f"explains {100.0 * explained_share(*excess):.3g}% of the excess chi-square; predictive deviance of "
        f"left-out records {deviances}"
    )
    text = (
        f"a force {chosen.place.preposition} {chosen.body} is missing: a {described(chosen.arguments, chosen.place)} "
        f"{gain}"
    )
    if others:
        text += f". It predicts as well as a {', a '.join(others)}"
    for trial in better:
        why = "fits all records no better" if chosen.stands_for(trial) else "is less simple"
        text += f". A {described(trial.arguments, trial.place)} predicts better, but {why}, so that it is not taken"
    if rivals:
        where = ", or ".join(f"{place.preposition} {place.name}" for place in rivals)
        text += f". A force {where} predicts as well"
    if rms is not None:
        text += f". It leaves {rms:.3g} times the noise: it is the closest to what is missing, not all of it"
    return text


def summary_of_history(chosen: ForceTrial, better: Sequence[HistoryTrial]) -> str:
    """Verdict on a force of which laws with internal states predict better than a free function, the best first."""
    best, others = better[0], [trial.name for trial in better[1:]]
    text = (
        f"a force {chosen.place.preposition} {chosen.body} is missing that depends on the history of the motion: "
        f"{best.name}, a law with internal states, predicts left-out records better than any function of the state "
        f"(predictive deviance {best.predictive_deviance:.4g}; {chosen.predictive_deviance:.4g} with a "
        f"{described(chosen.arguments, chosen.place)}, which is only what comes closest)"
    )
    if others:
        text += f". So do {', '.join(others)}" if len(others) > 1 else f". So does {others[0]}"
    return text
