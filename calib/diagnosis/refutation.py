"""Causes tested on records held out and from record to record, and replaced or left out where these refute them."""

from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial

from calib.diagnosis.bench import Bench
from calib.diagnosis.candidate import Candidate
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.elimination import several_sizes
from calib.diagnosis.gain import Gain, gained
from calib.diagnosis.refit import Fitter
from calib.diagnosis.revision import exchanged, left_out, paired, parted
from calib.diagnosis.rivals import simplest
from calib.diagnosis.second_cause import with_second_cause
from calib.diagnosis.selection import Selection
from calib.diagnosis.suspect import Refitted

ONE_SIZE, NOT_REFUTED = "it has one size in all records", "the records held out refute the others"


def revised_by_records(
    fitter: Fitter,
    bench: Bench,
    selection: Selection,
    candidates: Sequence[Candidate],
    seed: int,
) -> tuple[Selection, Gain]:
    """Test the causes on records held out, and compare their sizes from record to record.

    Where the size of a cause differs, its rivals are tried: those are preferred to it that have one size in the same
    records, each of which determines it well enough to detect the same variation. Where a misfit rises, those of all
    causes are tried: none is preferred with which that of the same records rises too. Where no rival is better, one of
    two causes that differs may stand for two: the best pair is tried in its place. Otherwise it, or the weakest one, is
    left out if the others explain enough without it. At last a pair is tried that only records held out reveal.
    Where the budget does not suffice for one of these steps, it is left out, and the selection is cut short.
    """
    selection, gain = _with_gain(fitter, bench, selection, seed)
    exchanged_by_records = _exchanged_by_records(fitter, bench, selection, gain, seed)
    tried = _parted(fitter, bench, *exchanged_by_records, candidates, seed)
    while len(tried[0].causes) > 1 and tried[0].is_explained and not _stands(*tried):
        fewer = fitter.attempt(partial(_without_the_least_tenable, fitter, bench, tried[0], seed))
        if fewer is None:
            break
        tried = fewer
    alone = len(tried[0].causes) == 1 and tried[0].is_explained
    if alone and not _stands_in_each_record(*tried):
        outcome = fitter.attempt(partial(_paired, fitter, bench, tried[0], candidates, seed)) or tried
        tried = outcome if _stands_in_each_record(*outcome) or (_stands(*outcome) and not _stands(*tried)) else tried
    revealed = None
    if not _stands(*tried) and len(tried[0].causes) == 1:
        tested = partial(_with_gain, fitter, bench, seed=seed)
        revealed = fitter.attempt(partial(with_second_cause, fitter, *tried, tested))
    if not _stands(*tried):
        return _cut_short(fitter, *(revealed or exchanged_by_records))
    return _cut_short(fitter, *_with_rivals_that_stand(fitter, bench, *tried, seed))


def _cut_short(fitter: Fitter, selection: Selection, gain: Gain) -> tuple[Selection, Gain]:
    """Return a selection that is cut short where steps were left out for the budget, not only the gain on blocks."""
    if fitter.effort.spent and not gain.omitted:
        selection = replace(selection, cut_short=True)
    return selection, gain


def _without_the_least_tenable(
    fitter: Fitter, bench: Bench, selection: Selection, seed: int
) -> tuple[Selection, Gain] | None:
    """Leave out the least tenable cause, and test the others; None where they do not explain enough without it."""
    fewer = left_out(fitter, selection, *_least_tenable(selection))
    return None if fewer is None else _with_gain(fitter, bench, fewer, seed)


def _paired(
    fitter: Fitter, bench: Bench, selection: Selection, candidates: Sequence[Candidate], seed: int
) -> tuple[Selection, Gain] | None:
    """Put the best pair in the place of the causes, and test it; None where it explains no more."""
    pair = paired(fitter, selection, candidates, seed)
    return None if pair is None else _with_gain(fitter, bench, pair, seed)


def _parted(
    fitter: Fitter, bench: Bench, selection: Selection, gain: Gain, candidates: Sequence[Candidate], seed: int
) -> tuple[Selection, Gain]:
    """Put the best pair in the place of one of two causes whose size differs, where all causes stand then."""
    differing = {one.effect for one in selection.heterogeneous} if len(selection.causes) > 1 else set()

    def tested(cause: Refitted) -> tuple[Selection, Gain] | None:
        several = parted(fitter, selection, cause, candidates, seed)
        return None if several is None else _with_gain(fitter, bench, several, seed)

    for cause in [cause for cause in selection.causes if cause.name in differing]:
        outcome = fitter.attempt(partial(tested, cause))
        if outcome and _stands(*outcome):
            return outcome
    return selection, gain


def _stands(selection: Selection, gain: Gain) -> bool:
    """Whether causes explain enough, have one size each, and are not refuted by records held out."""
    return selection.is_sufficient and not gain.refutes


def _stands_in_each_record(selection: Selection, gain: Gain) -> bool:
    """Whether causes stand, and each record alone has the same sizes of them within its errors."""
    return _stands(selection, gain) and not selection.differing_by_record


def _with_rivals_that_stand(
    fitter: Fitter, bench: Bench, selection: Selection, gain: Gain, seed: int
) -> tuple[Selection, Gain]:
    """Try the rivals of each cause in its place, where more than noise is left.

    Those are dropped that do not stand there, or significantly lower the misfit of the records held out by less, or
    whose sizes differ from record to record where those of the cause do not.
    """
    stands = _stands if selection.differing_by_record else _stands_in_each_record
    several = zip(selection.causes, selection.alternatives, strict=True)
    for cause, rivals in [(c, own) for c, own in several if len(own) > 1 and selection.remainder_is_significant]:
        tried = _in_its_place(fitter, bench, selection, cause, rivals, "as a rival", seed)
        if tried is None:
            return replace(selection, cut_short=True), gain
        tenable = [rival for rival in rivals if rival.name == cause.name]
        tenable += [rival for rival, own in tried if stands(*own) and _predicts_as_well(own[1], gain)]
        selection = selection.with_rivals(tenable)
    return selection, gain


def _predicts_as_well(own: Gain, gain: Gain) -> bool:
    """Whether causes are tested on all records of others, whose gain is given, and may have as large a gain."""
    return own.covers(gain) and own.interval[1] >= gain.interval[0]


def _least_tenable(selection: Selection) -> tuple[Refitted, str]:
    """Return the weakest of the causes whose sizes differ, or else of all, and why it is rejected."""
    differing = {one.effect: one for one in sorted(selection.heterogeneous, key=lambda one: one.z)}
    names = list(differing) or [cause.name for cause in selection.causes]
    explained = {one.effect: one.chi2 for one in selection.constancy}
    name = min(names, key=lambda name: explained.get(name, 0.0))
    [cause] = [cause for cause in selection.causes if cause.name == name]
    return cause, several_sizes(differing[name]) if differing else "with it the misfit of the records held out rises"


def _exchanged_by_records(
    fitter: Fitter, bench: Bench, selection: Selection, gain: Gain, seed: int
) -> tuple[Selection, Gain]:
    """Put a rival in the place of a cause that the records refute, or whose size differs from record to record.

    Where records held out refute the only cause and its rivals, those are tried that explained less in its search.
    """
    differing = {one.effect: one.variation for one in selection.differing_by_record}
    refuted = gain.refutes
    several = [(c, own) for c, own in zip(selection.causes, selection.alternatives, strict=True) if len(own) > 1]
    groups = [(c, own) for c, own in several if refuted or c.name in differing]
    if refuted and len(selection.causes) == 1:
        groups.append((selection.causes[0], selection.runners_up[: CRITERIA.max_runners_up]))
    for cause, rivals in groups:
        reason = ONE_SIZE if cause.name in differing else NOT_REFUTED
        tried = _in_its_place(fitter, bench, selection, cause, rivals, reason, seed)
        if tried is None:
            return replace(selection, cut_short=True), gain
        better = [(rival, own) for rival, own in tried if _holds(rival, own, gain, differing.get(cause.name))]
        if better:
            chosen = simplest([rival for rival, _ in better])
            [(selection, gain)] = [outcome for rival, outcome in better if rival is chosen]
            return selection.with_rivals([rival for rival, _ in better]), gain
    return selection, gain


def _in_its_place(
    fitter: Fitter,
    bench: Bench,
    selection: Selection,
    cause: Refitted,
    rivals: Sequence[Refitted],
    reason: str,
    seed: int,
) -> list[tuple[Refitted, tuple[Selection, Gain]]] | None:
    """Put each other rival in the place of a cause, and test that on records held out, if it is a cause there.

    None where the budget breaks one off: that refutes nothing.

    reason : why, as the end of a sentence
    """
    others = [rival for rival in rivals if rival.name != cause.name]

    def tested(rival: Refitted, own: Fitter) -> tuple[Selection, Gain] | None:
        other = exchanged(own, selection, cause, rival, reason)
        return None if other is None else _with_gain(own, bench, other, seed)

    def attempted(rival: Refitted, own: Fitter) -> tuple[Selection, Gain] | None:
        return own.attempt(partial(tested, rival, own))

    tried = []
    with closing(fitter.in_turn([partial(attempted, rival) for rival in others])) as outcomes:
        for rival in others:
            outcome = next(outcomes) if fitter.effort.suffices() else None
            if fitter.effort.spent:
                return None
            if outcome:
                tried.append((rival, outcome))
    return tried


def _holds(rival: Refitted, outcome: tuple[Selection, Gain], gain: Gain, differing: float | None) -> bool:
    """Whether with a rival all causes explain enough, have one size each, and are not refuted by records held out.

    outcome : the selection with it, and its gain
    gain : of the cause that it replaces
    differing : variation of the size of that cause, which has to be detectable in the rival's; None: it has none
    """
    selection, own = outcome
    if not _stands(selection, own) or not own.covers(gain):
        return False
    return differing is None or _has_one_size(rival, own, gain, differing)


def _has_one_size(rival: Refitted, own: Gain, gain: Gain, variation: float) -> bool:
    """Whether a rival has one size in all records in which that of the cause it replaces differs.

    own, gain : of the rival, and of that cause, whose size has this variation
    """
    compared = [a for a in own.agreements if a.parameter in rival.candidate.free]
    records = max((set(a.records) for a in gain.agreements), key=len)
    return bool(compared) and all(a.agree and set(a.records) >= records and a.detectable <= variation for a in compared)


def _with_gain(fitter: Fitter, bench: Bench, selection: Selection, seed: int) -> tuple[Selection, Gain]:
    """Return a selection with its sizes compared from record to record, and the gain by its causes."""
    threshold = selection.rounds[0].threshold
    gain = gained(fitter, bench, selection.null, selection.final, selection.causes, seed, threshold)
    return selection.with_records_compared(gain.agreements, gain.fitted_agree), gain
