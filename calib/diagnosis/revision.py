"""A selection revised: one of its causes exchanged or left out, or all replaced by the best pair."""

from collections.abc import Sequence
from dataclasses import replace

from calib.diagnosis.candidate import Candidate
from calib.diagnosis.compromise import any_rejected, with_best_pair, with_pair_beside
from calib.diagnosis.elimination import LeftOut
from calib.diagnosis.refit import Fitter
from calib.diagnosis.replacement import without_cause
from calib.diagnosis.selection import Selection
from calib.diagnosis.stepwise import as_selection, state_of, through_elimination
from calib.diagnosis.suspect import Refitted


def exchanged(fitter: Fitter, selection: Selection, cause: Refitted, rival: Refitted, reason: str) -> Selection | None:
    """Return a selection with a rival in the place of a cause, fitted beside the others, and without rivals.

    None where it cannot be fitted there, or would be rejected as a cause.

    Parameters
    ----------
    reason : why, as the end of a sentence
    """
    own, new = cause.candidate, rival.candidate
    others = [other.candidate for other in selection.causes if other is not cause]
    rest = {name: value for name, value in selection.final.point.values.items() if name not in own.absent()}
    sizes = {name: rest[name] for candidate in others for name in candidate.absent()}
    sizes |= {name: rival.fit.value(name) for name in new.absent()}
    fit = fitter.fit(replace(selection.final.point, values=rest), (*others, new), sizes)
    if not fit.names:
        return None
    final = fitter.with_derivatives(fit)
    exchanged_cause = rival.refitted(final, rival.chi2_reduction)
    state = state_of(selection)
    causes = [
        (exchanged_cause, (exchanged_cause,)) if known is cause else (known, rivals) for known, rivals in state.causes
    ]
    threshold = selection.rounds[0].threshold
    if any_rejected(fitter, selection.null, [known for known, _ in causes], final, threshold):
        return None
    state = through_elimination(fitter, state.with_causes(causes, final, reason))
    return as_selection(fitter, state) if exchanged_cause.name in state.names else None


def paired(fitter: Fitter, selection: Selection, candidates: Sequence[Candidate], seed: int) -> Selection | None:
    """Return a selection with the best pair in the place of its causes, or with these refitted from its values.

    None where neither explains more.
    """
    state = state_of(selection)
    revised = with_best_pair(fitter, state, candidates, seed)
    return None if revised is state else as_selection(fitter, through_elimination(fitter, revised))


def parted(
    fitter: Fitter, selection: Selection, cause: Refitted, candidates: Sequence[Candidate], seed: int
) -> Selection | None:
    """Return a selection with the best pair in the place of one of two causes; None where it explains no more."""
    state = with_pair_beside(fitter, state_of(selection), (cause.name,), candidates, seed)
    return None if state is None else as_selection(fitter, state)


def left_out(fitter: Fitter, selection: Selection, cause: Refitted, reason: str) -> Selection | None:
    """Return a selection without one of its causes; None where the others do not explain enough without it.

    Parameters
    ----------
    reason : why, as a clause
    """
    state = state_of(selection)
    others = [pair for pair in state.causes if pair[0] is not cause]
    names = tuple(other.name for other, _ in others)
    candidates = tuple(other.candidate for other, _ in others)
    fit = without_cause(fitter, selection.null, selection.final, cause, candidates)
    if not fit.names:
        return None
    rise, attained = fit.chi2 - selection.final.chi2, min(selection.attained, selection.final.chi2)
    out = LeftOut(cause.name, rise / (rise + max(0.0, selection.remaining_chi2)), names, reason)
    state = replace(state, final=fitter.with_derivatives(fit), causes=tuple(others), attained=attained)
    state = through_elimination(fitter, state)
    elimination = state.elimination
    if elimination is None or not elimination.is_explained:
        return None
    eliminated = replace(elimination, left_out=(*selection.left_out, out, *elimination.left_out))
    return as_selection(fitter, replace(state, elimination=eliminated))
