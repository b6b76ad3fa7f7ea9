"""The chapter of a page that presents a search for a force law: the force, its formulas, the models compared."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calib.diagnosis.discovery.document import DescribingFunctionResult, DiscoveryResult, FormulaResult
from calib.diagnosis.discovery.outcome import FOUND, NOTHING
from calib.report.formatting import capitalised, number, number_and_half, quantity, raised
from calib.report.pages.diagnosis.conclusion import stale
from calib.report.pages.picture import Picture, pictured
from calib.report.pages.verdict import Tone
from calib.report.plots.formula import formula_figure
from calib.report.plots.found_force import found_force_figure
from calib.study import CalibrationResult
from calib.units import count

TONES: Mapping[str, Tone] = {FOUND: "good", NOTHING: "good"}
FORCE = (
    "Force per unit mass over the states that the records visit, without the linear functions that calibrated "
    "parameters absorb."
)
WITH_FORMULA = (
    " It is the formula that stands above, and a function that is as smooth as the records let it be; the formula "
    "alone, less the same linear functions, is drawn over it."
)
CLOSEST = " It is only what comes closest to a force that depends on the history of the motion."


@dataclass(frozen=True)
class NumberRow:
    """A number of the formula."""

    name: str
    value: str
    error: str
    unit: str
    meaning: str


@dataclass(frozen=True)
class FormulaRow:
    """A formula that was refitted."""

    text: str
    numbers: int
    chi2: str
    left_out: str
    ric: str
    remarks: str
    first: bool


@dataclass(frozen=True)
class HistoryRow:
    """A law with internal states that was refitted."""

    law: str
    chi2: str
    left_out: str


@dataclass(frozen=True)
class ForceRow:
    """A model with free forces that was fitted."""

    place: str
    functions: str
    parameters: str
    chi2: str
    left_out: str


@dataclass(frozen=True)
class EquivalentRow:
    """Equivalent stiffness and damping at an amplitude."""

    amplitude: str
    stiffness: str
    stiffness_error: str
    damping: str
    damping_error: str


@dataclass(frozen=True)
class DiscoveryChapter:
    """Everything that a page shows of a search for a force law, in the order of the page."""

    verdict: str
    tone: Tone
    stale: bool
    headline: str
    points: tuple[str, ...]
    force: Picture | None
    formula: Picture | None
    numbers: tuple[NumberRow, ...]
    formulas: tuple[FormulaRow, ...]
    law: str
    histories: tuple[HistoryRow, ...]
    equivalents: tuple[EquivalentRow, ...]
    equivalents_at: str
    trials: tuple[ForceRow, ...]
    effort: str


def discovery_chapter(discovery: DiscoveryResult, result: CalibrationResult) -> DiscoveryChapter:
    """Everything that a page shows of a search for a force law.

    Parameters
    ----------
    result : of the calibration as it is now
    """
    formula, of_history = discovery.formula, discovery.depends_on_history
    caption = FORCE + (WITH_FORMULA if formula is not None else CLOSEST if of_history else "")
    return DiscoveryChapter(
        verdict=discovery.verdict.replace("_", " "),
        tone=TONES.get(discovery.verdict, "mind"),
        stale=stale(discovery, result),
        headline=f"{capitalised(discovery.summary)}.",
        points=_points(discovery),
        force=pictured(found_force_figure(discovery), "found-force", caption),
        formula=None if formula is None else _typeset(formula),
        numbers=_numbers(discovery),
        formulas=_formulas(discovery),
        law=f"{discovery.histories[0].effect}: {discovery.histories[0].equation}" if of_history else "",
        histories=tuple(HistoryRow(h.effect, number(h.chi2, 5), number(h.left_out_deviance, 5))
                        for h in discovery.histories),
        equivalents=_equivalents(discovery.describing_function),
        equivalents_at="" if discovery.describing_function is None
        else quantity(discovery.describing_function.frequency, "Hz"),
        trials=tuple(
            ForceRow(t.body, t.functions, number(t.effective_parameters, 3), number(t.chi2, 5),
                     number(t.left_out_deviance, 5))
            for t in discovery.trials
        ),
        effort=f"{count(discovery.simulations, 'simulation')} in {discovery.seconds:.0f} s",
    )  # fmt: skip


def _typeset(formula: FormulaResult) -> Picture:
    """Formula as it is typeset, with its text and its LaTeX to copy."""
    caption = f"Force per unit mass: {formula.text}. In LaTeX: {formula.latex}"
    return Picture(formula_figure(formula.latex), "found-formula", caption, outlines=True)


def _points(discovery: DiscoveryResult) -> tuple[str, ...]:
    """Sentences about a force that was found."""
    curves = tuple(f"{capitalised(text)}." for text in discovery.curves)
    if discovery.describing_function is not None:
        curves += (f"{discovery.describing_function.limits}.",)
    if not discovery.functions:
        return curves
    regions = {
        argument: f"{argument} {quantity(low, unit)} to {quantity(high, unit)}"
        for function in discovery.functions
        for argument, unit, (low, high) in zip(function.arguments, function.units, function.region, strict=True)
    }
    if discovery.interface:
        regions = {
            name: text.replace("displacement", "clearance").replace("velocity", "rate of the clearance")
            for name, text in regions.items()
        }
    points = [f"The records visit {', '.join(regions.values())}. Beyond, the force is an extrapolation."]
    if len(discovery.rms) == 2:
        force, error = discovery.rms
        points.append(
            f"Root mean square over the visited states: {number(force, 3)} m/s² per unit mass, standard error "
            f"{number(error, 2)} m/s²."
        )
    if discovery.formula is None and not discovery.depends_on_history:
        points.append("No formula of the dictionary predicts as well as the free function.")
    if discovery.undetermined:
        points.append(f"Not determined beside the calibrated parameters: {', '.join(discovery.undetermined)}.")
    return (*points, *curves)


def _equivalents(own: DescribingFunctionResult | None) -> tuple[EquivalentRow, ...]:
    """Describing function over the amplitude."""
    if own is None:
        return ()
    pairs = zip(
        own.amplitudes,
        zip(own.stiffness, own.stiffness_error, strict=True),
        zip(own.damping, own.damping_error, strict=True),
        strict=True,
    )
    return tuple(EquivalentRow(quantity(a, "m"), *number_and_half(*k), *number_and_half(*c)) for a, k, c in pairs)


def _numbers(discovery: DiscoveryResult) -> tuple[NumberRow, ...]:
    """Numbers of the formula, or of the law with internal states where the force depends on history."""
    law = discovery.histories[0] if discovery.depends_on_history else discovery.formula
    return tuple(
        NumberRow(
            n.name, *number_and_half(n.value, n.error),
            "" if n.unit == "1" else raised(n.unit), n.meaning,
        )
        for n in (() if law is None else law.numbers)
    )  # fmt: skip


def _formulas(discovery: DiscoveryResult) -> tuple[FormulaRow, ...]:
    """Formulas, the best first."""
    if not discovery.formulas:
        return ()
    least = float(np.min([f.ric for f in discovery.formulas]))
    return tuple(
        FormulaRow(
            text=own.text,
            numbers=len(own.numbers),
            chi2=number(own.chi2, 5),
            left_out=number(own.left_out_deviance, 5),
            ric=f"+{own.ric - least:.1f}",
            remarks=", ".join(text for text, holds in (("tie", own.ties), ("front", own.on_front)) if holds),
            first=own == discovery.formula,
        )
        for own in discovery.formulas
    )
