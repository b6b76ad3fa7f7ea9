"""Sentences on the trends over the levels of frequency responses, and on the effects that make or exclude them."""

from collections.abc import Mapping, Sequence

from calib.diagnosis.document import DiagnosisResult
from calib.diagnosis.levels.comparison import CALIBRATED, EXTENDED
from calib.diagnosis.levels.document import DampingTrendResult, LawTrendResult, LevelsResult, ResonanceTrendResult
from calib.diagnosis.verdict import joined
from calib.report.formatting import capitalised, number, quantity, rounded, with_error

MAX_EXCLUDED_LAWS = 3  # that a sentence names  [count]


def level_trends(diagnosis: DiagnosisResult) -> list[str]:
    """Trends of damping and resonance over the levels that exceed three standard errors, a sentence or two a record."""
    return [sentence for levels in diagnosis.levels for sentence in _of_record(levels)]


def _of_record(levels: LevelsResult) -> list[str]:
    damping, resonance = levels.damping, levels.resonance
    sentences = []
    moves = resonance is not None and resonance.significant
    if damping is not None and damping.significant:
        still = "" if resonance is None or moves else f"; its resonance does not move by more than {_bound(resonance)}"
        sentences.append(f"{_span(levels)}{_damping(levels, damping)}{still}.")
        sentences += _damping_laws(levels.laws, damping.power)
    if resonance is not None and moves:
        trend = _resonance(levels, resonance)
        still = "; its equivalent damping has no significant trend" if damping is not None and not sentences else ""
        sentences.append(f"{capitalised(trend)}." if sentences else f"{_span(levels)}{trend}{still}.")
        sentences += _stiffness_laws(levels.laws, resonance.change)
    return [" ".join(sentences)] if sentences else []


def _span(levels: LevelsResult) -> str:
    """Record and range of its levels, as the begin of a sentence."""
    own = [sweep.level for sweep in levels.sweeps]
    what = "held amplitudes" if levels.held else "levels"
    return f"{levels.record}, {what} {quantity(min(own), levels.unit)} to {quantity(max(own), levels.unit)}: "


def _damping(levels: LevelsResult, trend: DampingTrendResult) -> str:
    direction = "grows" if trend.power > 0.0 else "falls"
    models = [f"{rounded(power, trend.error)} {_model(name)}" for name, power in _known(trend.models, levels.laws)]
    text = f"the equivalent damping of {levels.body} {direction} with the amplitude, as its power "
    return f"{text}{with_error(trend.power, 2.0 * trend.error)} (±: two standard errors{_listed(models)})"


def _resonance(levels: LevelsResult, trend: ResonanceTrendResult) -> str:
    direction, spring = ("rises", "hardens") if trend.change > 0.0 else ("falls", "softens")
    models = [f"{rounded(shift, trend.error)} Hz {_model(name)}" for name, shift in _known(trend.models, levels.laws)]
    change = with_error(trend.change, 2.0 * trend.error)
    return (
        f"the resonance of {levels.body} {direction} with the amplitude, by {change} Hz (±: two standard errors"
        f"{_listed(models)}): the stiffness {spring}"
    )


def _bound(trend: ResonanceTrendResult) -> str:
    """Largest change of the resonance that its two standard errors admit."""
    return f"{number(abs(trend.change) + 2.0 * trend.error, 2)} Hz"


def _known(models: Mapping[str, float | None], laws: Sequence[LawTrendResult]) -> list[tuple[str, float]]:
    """Models that have such a trend, the extended one by the names of its laws."""
    causes = joined([law.effect for law in laws if law.cause])
    names = {EXTENDED: causes} if causes else {}
    return [(names.get(name, name), own) for name, own in models.items() if own is not None]


def _model(name: str) -> str:
    own = {CALIBRATED: "by the calibrated model", EXTENDED: "by the extended model"}
    return own.get(name, f"with {name}")


def _listed(models: Sequence[str]) -> str:
    return f"; {', '.join(models)}" if models else ""


def _damping_laws(laws: Sequence[LawTrendResult], power: float) -> list[str]:
    """Which laws make such a trend of the damping, and which make the opposite one.

    Beside constant damping a law whose own damping goes with a power makes one between that and 0.
    """
    way = 1 if power > 0.0 else -1
    grows, falls = ("grows", "falls") if way > 0 else ("falls", "grows")
    making = [_with_power(law) for law in laws if law.cause and law.damping_change == way]
    against = [_with_power(law) for law in laws if not law.cause and law.damping_change == -way]
    return _verdict_on(making, against, f"damping that {grows}", f"whose damping {falls}")


def _stiffness_laws(laws: Sequence[LawTrendResult], change: float) -> list[str]:
    """Which laws make the resonance move this way, and which the other way."""
    way = 1 if change > 0.0 else -1
    grows, falls = ("grows", "falls") if way > 0 else ("falls", "grows")
    making = [law.effect for law in laws if law.cause and law.stiffness_change == way]
    against = [law.effect for law in laws if not law.cause and law.stiffness_change == -way]
    return _verdict_on(making, against, f"stiffness that {grows}", f"whose stiffness {falls}")


def _verdict_on(making: Sequence[str], against: Sequence[str], what: str, opposite: str) -> list[str]:
    """Sentence on causes whose force law makes a trend, and other effects whose law makes the opposite one."""
    others = joined(against[:MAX_EXCLUDED_LAWS])
    if not making:
        return [f"It is not that of {others}, {opposite}."] if against else []
    text = f"{joined(making)} make{'s' if len(making) == 1 else ''} {what}"
    return [f"{text}; not so {others}, {opposite}." if against else f"{text}."]


def _with_power(law: LawTrendResult) -> str:
    """Name of a law with the power of the amplitude that its own damping goes with."""
    return law.effect if law.damping_power is None else f"{law.effect} (alone power {number(law.damping_power, 2)})"
