"""Second part of the chapter: which effects were suspected, and what the diagnosis concludes of each."""

from collections.abc import Mapping
from dataclasses import dataclass

from calib.diagnosis.document import DiagnosisResult, SuspectResult
from calib.diagnosis.excess import significant
from calib.diagnosis.verdict import NONE, ONE_OF, UNEXPLAINED, explained
from calib.report.formatting import number, percent, quantity, signed
from calib.report.pages.diagnosis.conclusion import added
from calib.report.pages.diagnosis.sizes import is_absorbed, is_untested, size_alone, sizes, sizes_together
from calib.report.pages.picture import Picture, pictured
from calib.report.plots.suspects import COLOURS, EMPHASISED, Strength, SuspectOutcome, suspect_strengths

MIN_SHARE_WITH_DECIMAL = 0.995  # that whole per cent would round to all  [1]
MIN_SUSPECTS, MAX_SUSPECTS = 3, 10  # shown at once
MIN_COSINE = 0.5  # of signatures, from which their likeness is mentioned  [1]
STRENGTHS = (
    "How strongly each effect shows in the residuals, after the part that calibrated parameters and nuisances absorb "
    "is removed. Above the dashed line an effect is significant: noise alone would make the strongest of them exceed "
    "it in 1 of 100 cases. The cause is chosen by what its fit explains and predicts, not by z."
)


@dataclass(frozen=True)
class SuspectRow:
    """A suspected effect: what it adds, its strength, size and share, and what the diagnosis concludes of it.

    `sizes` are those of the effect alone, as z and share are; `together` those beside other causes.
    """

    effect: str
    meaning: str
    equation: str
    where: str
    outcome: SuspectOutcome
    colour: str
    bold: bool
    z: str
    sizes: tuple[str, ...]
    together: tuple[str, ...]
    held: tuple[str, ...]
    share: str
    estimated: bool
    absorbed: str
    detectable: tuple[str, ...]
    reason: str


@dataclass(frozen=True)
class SuspectRows:
    """Suspects that are shown at once, and the others."""

    shown: tuple[SuspectRow, ...]
    rest: tuple[SuspectRow, ...]


def outcome(suspect: SuspectResult, diagnosis: DiagnosisResult) -> SuspectOutcome:
    """What a diagnosis concludes of a suspect."""
    name = suspect.effect
    if name in diagnosis.causes:
        return SuspectOutcome.NAMED
    if diagnosis.verdict == ONE_OF and any(name in names for names in diagnosis.classes):
        return SuspectOutcome.INDISTINGUISHABLE
    if name in diagnosis.closest or name in _rivals_of_closest(diagnosis):
        return SuspectOutcome.CLOSEST
    if is_absorbed(suspect):
        return SuspectOutcome.ABSORBED
    if suspect.z is None or diagnosis.threshold is None or abs(suspect.z) <= diagnosis.threshold:
        return SuspectOutcome.BELOW
    return SuspectOutcome.WRONG_SIGN if suspect.z < 0.0 and _is_one_sided(suspect) else SuspectOutcome.EXPLAINS_LESS


def _rivals_of_closest(diagnosis: DiagnosisResult) -> set[str]:
    """Names of suspects that are indistinguishable from those that explain most."""
    return {name for one in diagnosis.rounds if one.chosen in diagnosis.closest for name in one.rivals}


def wrong_signs(diagnosis: DiagnosisResult, outcomes: Mapping[str, SuspectOutcome]) -> list[str]:
    """Say which significant effects would need a size of the wrong sign, where no effect is named or comes closest."""
    wrong = [one for one in diagnosis.suspects if outcomes[one.effect] == SuspectOutcome.WRONG_SIGN]
    if diagnosis.verdict != UNEXPLAINED or diagnosis.closest or not wrong:
        return []
    ordered = sorted(wrong, key=lambda one: -abs(one.z or 0.0))
    listed = "; ".join(f"{one.effect} {_reason(one, SuspectOutcome.WRONG_SIGN, diagnosis)}" for one in ordered)
    return [
        f"Above the threshold, but of a sign that makes no sense: {listed}. Either an effect is missing that is no "
        "candidate, or the noise is larger than it is taken here."
    ]


def _is_one_sided(suspect: SuspectResult) -> bool:
    """Whether the effect has one parameter whose value without the effect is an end of its range."""
    if len(suspect.null) != 1:
        return False
    [(name, null)] = suspect.null.items()
    return null is not None and null in suspect.limits[name]


def suspect_rows(diagnosis: DiagnosisResult, outcomes: Mapping[str, SuspectOutcome]) -> SuspectRows:
    """Rows of the table of suspects, named and strong ones first."""
    rank = dict.fromkeys(EMPHASISED, 0) | {SuspectOutcome.ABSORBED: 2}
    ordered = sorted(diagnosis.suspects, key=lambda s: (rank.get(outcomes[s.effect], 1), -abs(s.z or 0.0)))
    rows = [_row(suspect, outcomes[suspect.effect], diagnosis) for suspect in ordered]
    shown = sum(row.outcome not in (SuspectOutcome.BELOW, SuspectOutcome.ABSORBED) for row in rows)
    shown = len(rows) if diagnosis.verdict == NONE else min(max(shown, MIN_SUSPECTS), MAX_SUSPECTS)
    return SuspectRows(tuple(rows[:shown]), tuple(rows[shown:]))


def strengths_picture(diagnosis: DiagnosisResult, outcomes: Mapping[str, SuspectOutcome]) -> Picture | None:
    """Figure of the strengths of all suspects that have a score; None where no threshold is known."""
    if diagnosis.threshold is None:
        return None
    strengths = [
        Strength(suspect.effect, abs(suspect.z), outcomes[suspect.effect])
        for suspect in diagnosis.suspects
        if suspect.z is not None and not is_untested(suspect) and outcomes[suspect.effect] != SuspectOutcome.ABSORBED
    ]
    return pictured(suspect_strengths(strengths, diagnosis.threshold), "suspects", STRENGTHS)


def explained_share(suspect: SuspectResult, outcome: SuspectOutcome, diagnosis: DiagnosisResult) -> float | None:
    """Share of the excess chi-square that a suspect explains; None where that is not known or has no meaning."""
    misfit = diagnosis.misfit
    if misfit is None or not significant(misfit.excess_chi2, misfit.chi2_std):
        return None
    sensible = outcome not in (SuspectOutcome.WRONG_SIGN, SuspectOutcome.ABSORBED) and suspect.chi2_reduction > 0.0
    return suspect.share if sensible else None


def _row(suspect: SuspectResult, outcome: SuspectOutcome, diagnosis: DiagnosisResult) -> SuspectRow:
    untested, absorbed = is_untested(suspect), is_absorbed(suspect)
    share = explained_share(suspect, outcome, diagnosis)
    alone = size_alone(suspect, diagnosis)
    given = {n: x for n, x in suspect.held.items() if x is not None and n not in alone.size}  # None is infinite
    detectable = {} if absorbed else {name: x for name, x in suspect.detectable.items() if x is not None}
    scored = suspect.z is not None and not untested and outcome != SuspectOutcome.ABSORBED
    return SuspectRow(
        effect=suspect.effect,
        meaning=suspect.meaning,
        equation=suspect.equation,
        where=f"on {', '.join(suspect.bodies)}" if suspect.bodies else "",
        outcome=outcome,
        colour=COLOURS[outcome],
        bold=outcome in EMPHASISED,
        z=signed(suspect.z) if scored and suspect.z is not None else "-",
        sizes=("-",) if untested or absorbed else tuple(sizes(alone)),
        together=tuple(sizes_together(suspect.effect, diagnosis)),
        held=tuple(f"{name} = {quantity(value, suspect.units.get(name))}" for name, value in given.items()),
        share="-" if share is None else explained(share),
        estimated=share is not None and not suspect.refitted,
        absorbed="-" if untested else _absorbed(suspect.absorbed),
        detectable=tuple(quantity(x, suspect.units.get(name), 2) for name, x in detectable.items()),
        reason=_reason(suspect, outcome, diagnosis),
    )


def _absorbed(share: float) -> str:
    return explained(share) if share >= MIN_SHARE_WITH_DECIMAL else percent(share)


def _reason(suspect: SuspectResult, outcome: SuspectOutcome, diagnosis: DiagnosisResult) -> str:
    """Why the diagnosis concludes what it does of a suspect."""
    if suspect.reason and outcome not in (SuspectOutcome.NAMED, SuspectOutcome.INDISTINGUISHABLE):
        return suspect.reason
    if outcome == SuspectOutcome.NAMED:
        rounds = [k for k, one in enumerate(diagnosis.rounds, 1) if one.chosen == suspect.effect]
        return f"named in round {rounds[0]}" if rounds and len(diagnosis.causes) > 1 else "named"
    if outcome == SuspectOutcome.INDISTINGUISHABLE:
        several = len(diagnosis.classes) > 1
        return "not distinguishable from the alternatives" if several else "one steady tone alone does not confirm it"
    if outcome == SuspectOutcome.WRONG_SIGN:
        [name] = suspect.null
        low, _ = suspect.limits[name]
        bound = "<" if suspect.null[name] == low else ">"
        return f"would need {name} {bound} {number(suspect.null[name])}"
    if outcome == SuspectOutcome.EXPLAINS_LESS:
        return _explains_less(suspect, diagnosis)
    if outcome == SuspectOutcome.ABSORBED:
        return _absorbed_reason(suspect, diagnosis)
    if is_untested(suspect):
        return "absorbed by calibration, to within the error of its derivative"
    if outcome == SuspectOutcome.CLOSEST:
        return "explains most" if suspect.effect in diagnosis.closest else "explains as much"
    return "below the threshold"


def _explains_less(suspect: SuspectResult, diagnosis: DiagnosisResult) -> str:
    """Why a significant suspect is not named: it explains too little, or less than the effect of the first round."""
    left = next((one for one in diagnosis.left_out if one.effect == suspect.effect), None)
    if left is not None and left.reason:
        return "imitates another effect beside the named ones (stand-in)"
    if left is not None:
        share = "too little" if left.share is None else f"{percent(left.share)}, too little,"
        return f"explains {share} of what remains beside the named effects"
    first = diagnosis.rounds[0].chosen if diagnosis.rounds else None
    if first is None or suspect.cosine is None or not suspect.cosine > MIN_COSINE:
        return "explains less"
    exchanged = ", the choice of round 1" if first not in added(diagnosis) else ""
    return f"explains less; cosine {_cosine(suspect.cosine)} with {first}{exchanged}"


def _cosine(cosine: float) -> str:
    """Write a cosine of signatures with one decimal place where whole per cent would round it to all."""
    return percent(cosine, 3 if cosine >= MIN_SHARE_WITH_DECIMAL else 2)


def _absorbed_reason(suspect: SuspectResult, diagnosis: DiagnosisResult) -> str:
    """Why an absorbed suspect has no score, and in which later round it has one."""
    later = [k for k, one in enumerate(diagnosis.rounds, 1) if suspect.effect in (one.chosen, one.rejected)]
    if later:
        return f"absorbed by calibration as long as no cause is in the model; see round {later[0]}"
    return "absorbed by calibration: in these records the calibrated parameters imitate it"
