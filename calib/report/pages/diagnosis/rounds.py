"""Third part of the chapter: the rounds of the search, and why its result is distinguished from others."""

from collections.abc import Mapping
from dataclasses import dataclass

import xarray as xr

from calib.diagnosis.constancy import CHANNELS
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.document import DiagnosisResult, RoundResult
from calib.diagnosis.verdict import NAMED, ONE_OF, UNEXPLAINED, explained, joined
from calib.report.formatting import number, percent, with_error
from calib.report.pages.diagnosis.conclusion import added, is_heterogeneous, named_extension
from calib.report.pages.picture import Picture, pictured
from calib.report.plots.diagnosed_loops import magnified_loops
from calib.report.plots.suspects import SuspectOutcome

MIN_SIMILAR_COSINE = 0.95  # of the angle between signatures, from which effects count as similar  [1]
MIN_SIMILAR_SHARE = 0.95  # of what the named effect explains, from which they do  [1]
MAX_SIMILAR = 6  # effects that a sentence lists
MAGNIFIED = (
    "Phase curves of the extended model (green), and the distances from them of the calibrated model (blue) and of "
    "the measured curve (grey, averaged over a thirtieth of the cycle), magnified as the titles state: where the dots "
    "lie on the green line and not on the blue one, the extension is right."
)


@dataclass(frozen=True)
class RoundRow:
    """A round of the search, or a change of its causes afterwards."""

    model: str
    chosen: str
    threshold: str = "-"
    share: str = "-"
    predicts: str = "-"
    rivals: str = "-"


def round_rows(diagnosis: DiagnosisResult) -> list[RoundRow]:
    """Rows of the table of rounds: the rounds, then exchanges of causes, then effects that were left out."""
    rows, known = [], ["calibrated"]
    for one in diagnosis.rounds:
        rows.append(
            RoundRow(
                model=" + ".join(known),
                threshold="-" if one.threshold is None else f"{one.threshold:.2f}",
                chosen=one.chosen or _none(one),
                share="-" if one.share is None else explained(one.share),
                predicts=_predicts(one),
                rivals=", ".join(name for name in one.rivals if name != one.chosen) or "-",
            )
        )
        known += [one.chosen] if one.chosen else []
    rows += _exchanges(diagnosis)
    for left_out in diagnosis.left_out:
        share = "an unknown share" if left_out.share is None else explained(left_out.share)
        little = f"it explains {share} of the excess that may remain beside the others: too little"
        model = " + ".join(["calibrated", *left_out.beside, left_out.effect])
        rows.append(RoundRow(model, f"without {left_out.effect}: {left_out.reason or little}"))
    return rows


def _exchanges(diagnosis: DiagnosisResult) -> list[RoundRow]:
    """Rows of exchanges; the one that makes the final model has what that explains."""
    rows = []
    for exchange in diagnosis.exchanges:
        model = " + ".join(["calibrated", *exchange.before])
        chosen = f"{' + '.join(exchange.after)} instead: {exchange.reason}"
        if set(exchange.after) == set(added(diagnosis)) and diagnosis.misfit is not None:
            share = explained(diagnosis.misfit.share)
            rows.append(RoundRow(model, chosen, share=share, predicts="not tested", rivals=_rivals(diagnosis)))
        else:
            rows.append(RoundRow(model, chosen))
    return rows


def _rivals(diagnosis: DiagnosisResult) -> str:
    """Names of the effects that are indistinguishable from a cause of the final model beside its others."""
    own = added(diagnosis)
    names = [name for model in diagnosis.classes for name in model if name not in own]
    return ", ".join(dict.fromkeys(names)) or "-"


def explained_together(diagnosis: DiagnosisResult) -> str:
    """Say what all causes together explain, refitted at the end, not what each explains in its round."""
    names, misfit = added(diagnosis), diagnosis.misfit
    if not names or misfit is None or not misfit.share:
        return ""
    return f"{joined(names)}, refitted at the end, explain{'' if len(names) > 1 else 's'} {explained(misfit.share)}"


def _predicts(one: RoundResult) -> str:
    """Share of chi-square on left-out data that the cause takes away, with its standard error."""
    test = one.prediction
    if test is None or test.reduction is None or not test.without:
        return "not tested" if one.chosen else "-"
    error = None if test.share_error is None else 100.0 * test.share_error
    return f"{with_error(100.0 * test.reduction / test.without, error)} %"


def _none(one: RoundResult) -> str:
    """Why a round added no effect."""
    if not one.rejected:
        return "none is above the threshold with a size of the right sign"
    return f"none: {one.rejected} explains most, but {one.rejection}"


def magnified_picture(diagnosis: DiagnosisResult, motions: Mapping[str, xr.Dataset]) -> Picture | None:
    """Figure of the phase curves of the extended model."""
    return pictured(magnified_loops(motions, named_extension(diagnosis)), "magnified-loops", MAGNIFIED)


def distinction(diagnosis: DiagnosisResult, outcomes: Mapping[str, SuspectOutcome]) -> list[str]:
    """Sentences on what distinguishes the cause from other effects, or why nothing does."""
    left_out = {one.effect for one in diagnosis.left_out}
    last = next((r for r in reversed(diagnosis.rounds) if r.chosen and r.chosen not in left_out), None)
    if last is None:
        return []
    sentences = []
    cosines = [f"{name} {percent(cosine, 3)}" for name, cosine in last.cosines.items() if cosine is not None]
    if cosines:
        sentences.append(
            f"Cosine of the angle between the signature of {last.chosen}, the change it makes in these records beyond "
            f"what calibration absorbs, and the signatures of others: {', '.join(cosines)}."
        )
    if diagnosis.verdict == ONE_OF and len(diagnosis.classes) == 1:
        sentences.append(
            "One steady tone repeats any model error in every cycle, so that cross-validation over its cycles tests "
            "no prediction, and no held-out record tests it. Measure a record at another amplitude or frequency."
        )
    elif diagnosis.verdict == ONE_OF:
        sentences.append("Whichever of them is fitted, chi-square differs too little to distinguish them.")
    if diagnosis.misfit is not None and added(diagnosis):
        sentences += [*_closest(diagnosis), *_constancy(diagnosis)]
    if diagnosis.verdict == NAMED:
        sentences.append(_best_of_others(diagnosis, outcomes))
    return sentences


def similar_effects(diagnosis: DiagnosisResult, outcomes: Mapping[str, SuspectOutcome]) -> list[str]:
    """Say which effects resemble the only named or closest one so much that its form is less certain than its presence.

    Only effects that were refitted are compared. Nothing is said where a named effect leaves no more than noise: the
    records then decide between it and the others.
    """
    first = diagnosis.rounds[0] if diagnosis.rounds else None
    if first is None or first.share is None or added(diagnosis) != [first.chosen]:
        return []
    if diagnosis.verdict == UNEXPLAINED:
        reason = f"As {first.chosen} alone is not the cause"
    elif diagnosis.verdict == NAMED and diagnosis.remainder is not None and diagnosis.remainder.above_noise:
        reason = "As what remains is more than noise"
    else:
        return []
    similar = {
        suspect.effect: suspect.share
        for suspect in diagnosis.suspects
        if outcomes[suspect.effect] == SuspectOutcome.EXPLAINS_LESS
        and suspect.refitted
        and suspect.share is not None
        and suspect.share >= MIN_SIMILAR_SHARE * first.share
        and suspect.cosine is not None
        and suspect.cosine >= MIN_SIMILAR_COSINE
    }
    if not similar:
        return []
    ordered = sorted(similar, key=lambda name: -similar[name])
    listed = ", ".join(f"{name} {explained(similar[name])}" for name in ordered[:MAX_SIMILAR])
    more = f" and {len(ordered) - MAX_SIMILAR} more" if len(ordered) > MAX_SIMILAR else ""
    return [
        f"{first.chosen} explains {explained(first.share)} of the excess, and effects of nearly the same signature in "
        f"these records explain nearly as much, each on its own: {listed}{more}. {reason}, "
        "the form of the law is less certain than that something of this signature is missing. What would decide: a "
        "record over another range of displacement and velocity, in which these effects differ more."
    ]


def _closest(diagnosis: DiagnosisResult) -> list[str]:
    """Say how much the closest effects explain, and what a named cause has to fulfil."""
    if diagnosis.verdict != UNEXPLAINED or not diagnosis.closest or diagnosis.misfit is None:
        return []
    return [
        f"{joined(diagnosis.closest)} explain{'' if len(diagnosis.closest) > 1 else 's'} "
        f"{explained(max(0.0, diagnosis.misfit.share))} of the excess. A cause is named if it predicts left-out data, "
        "has one size in all records (of several causes, each in all their channels too), and if the remaining "
        f"misfit is noise or it explains at least {CRITERIA.min_over_remainder:g} times as much (of several, each)."
    ]


def _best_of_others(diagnosis: DiagnosisResult, outcomes: Mapping[str, SuspectOutcome]) -> str:
    """Say which effect explains most among those that are not named."""
    others = [
        (suspect.share, suspect)
        for suspect in diagnosis.suspects
        if outcomes[suspect.effect] == SuspectOutcome.EXPLAINS_LESS and suspect.share is not None
    ]
    if not others:
        return "No other effect is above the threshold with a size of the right sign."
    share, best = max(others, key=lambda pair: pair[0])
    chosen = diagnosis.rounds[0].chosen
    known = best.cosine is not None and chosen in diagnosis.causes
    resemblance = f"; the cosine of its signature with that of {chosen} is {percent(best.cosine)}" if known else ""
    left_out = best.effect in {one.effect for one in diagnosis.left_out}
    beside = f" Beside {joined(added(diagnosis))} it is left out." if left_out else ""
    return (
        f"Of the effects that are not named, {best.effect} explains most on its own: "
        f"{explained(share)} of the excess{'' if best.refitted else ' (estimate)'}{resemblance}.{beside}"
    )


def _constancy(diagnosis: DiagnosisResult) -> list[str]:
    """Say whether the sizes of the causes differ among the channels of the records.

    No sentence states that they agree where those of whole records disagree.
    """
    misfit, threshold = diagnosis.misfit, diagnosis.threshold
    if misfit is None or threshold is None or not misfit.heterogeneity_z:
        return []
    z, agreements = misfit.heterogeneity_z, () if diagnosis.gain is None else diagnosis.gain.agreements
    differ, of_records = is_heterogeneous(diagnosis) and z > threshold, _has_one_channel_each(diagnosis)
    if not differ and (of_records and agreements or not all(agreement.agree for agreement in agreements)):
        return []
    names, how, end = added(diagnosis), "do not differ", ""
    if differ:
        how, end = "differ", " An effect may imitate another one, but hardly with one size everywhere."
    elif z > threshold:
        own = [one for one in misfit.constancy if one.among in (None, CHANNELS)]
        most = max(own, key=lambda one: one.z or 0.0, default=None)
        which = f", most those of {most.effect}," if most and len(names) > 1 else ""
        how = f"differ{which} by {percent(most.variation)}" if most else "differ"
        if diagnosis.remainder is not None and diagnosis.remainder.above_noise:
            end = f" Unmodelled effects may make them differ by up to {percent(CRITERIA.max_variation)}."
    return [
        f"The sizes of {joined(names)} {how} among the {'records' if of_records else 'channels of the records'} "
        f"(Cochran's Q as a normal deviate: {number(z, 2)}, threshold {number(threshold, 2)}).{end}"
    ]


def _has_one_channel_each(diagnosis: DiagnosisResult) -> bool:
    """Whether each record has one channel that is compared: then its channels are the records."""
    records = [] if diagnosis.misfit is None else [channel.record for channel in diagnosis.misfit.channels]
    return bool(records) and len(set(records)) == len(records)
