"""First part of the chapter: conditions of the diagnosis, misfit of features, residuals and missing accelerations."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from calib.diagnosis.clock import MAX_CLOCK_RATE
from calib.diagnosis.document import DeviationResult, DiagnosisResult, GateResult
from calib.objective import Reference
from calib.report.formatting import percent, raised, rounded, signed, with_error
from calib.report.pages.diagnosis.conclusion import remedy
from calib.report.pages.picture import Picture, pictured
from calib.report.plots.diagnosed_cycles import compared_rows, rms_over_noise, state_rows
from calib.report.plots.diagnosed_loops import misfit_loops
from calib.report.plots.diagnosed_residuals import residual_figure
from calib.report.plots.diagnosed_responses import response_residual_figure
from calib.report.plots.missing_force import is_significant, missing_accelerations, missing_force_figure
from calib.units import count, reading

MIN_SHOWN_Z = 3.0  # of a feature that is shown at once  [standard errors]
MAX_SHOWN_FEATURES = 12  # shown at once
MIN_SHOWN_FEATURES = 3  # shown at once where none deviates
RESIDUALS = (
    "Residual, measured minus simulated: dots are samples, the blue line is the mean of the cycles{extended}, the "
    "grey band two standard deviations of the noise, the darker band two of the mean{impacts}. Bars: amplitudes of "
    "the harmonics of the mean, in multiples of the excitation frequency; blue ones exceed the grey ones, below which "
    "noise stays in 19 of 20 cases."
)
RESIDUALS_IN_TIME = (
    "Residual, measured minus simulated, over time: grey dots by the calibrated model{extended}; the grey band is two "
    "standard deviations of the noise."
)
RESIDUALS_OVER_FREQUENCY = (
    "Distance of each measured point from the simulated curve of its sweep, in standard uncertainties: where the curve "
    "is steep, that in frequency counts in the place of the part along it. A colour a level, triangles in the "
    "direction of the sweep; the grey band is two standard deviations of the noise.{gross}"
)
GROSS_ERRORS = " Gross errors beside the extended model, named above, are left out."
GREEN = ", green by the extended one"
IMPACTS = "; where the background is orange, beside impacts, velocity is not compared"
LOOPS = (
    "Measured phase curves, coloured by the local misfit: the residuals of displacement and velocity, each averaged "
    "over a thirtieth of the {span}, root mean square over both, in standard deviations of such an average. Noise "
    "alone gives about 1."
)
FORCES = (
    "Missing acceleration of {body}, measured minus simulated at the same instant (derivative of the residual "
    "velocity, by parabolas through neighbouring samples of the {span}; impacts left out): over the plane of its "
    "states, and its means in bins of displacement and of velocity, with two standard errors. It is the missing force "
    "per unit mass plus the reaction of springs and dampers to the residual motion, so near a resonance a force "
    "appears a quarter of a period late."
)
INSIGNIFICANT = "the mean in no bin differs significantly from zero, given the noise of differentiated velocities."


@dataclass(frozen=True)
class GateRow:
    """A condition of the diagnosis, what was found, and the remedy where it fails."""

    name: str
    passed: bool
    tried: bool
    summary: str
    remedy: str


@dataclass(frozen=True)
class FeatureRow:
    """A feature, measured and predicted, in the unit shown; z in standard errors."""

    label: str
    record: str
    body: str
    unit: str
    measured: str
    predicted: str
    z: str
    marked: bool


@dataclass(frozen=True)
class FeatureRows:
    """Features that are shown at once, and the others."""

    marked: tuple[FeatureRow, ...]
    rest: tuple[FeatureRow, ...]


@dataclass(frozen=True)
class RecordResidual:
    """Figure of the residual of a record."""

    record: str
    picture: Picture


@dataclass(frozen=True)
class BodyForce:
    """Figure of the missing acceleration of a body, and whether it is significant."""

    body: str
    significant: bool
    picture: Picture


def gate_row(gate: GateResult, motions: Mapping[str, xr.Dataset]) -> GateRow:
    """Row of a condition; the noise is given relative to the channels where motions are known."""
    levels = _noise_levels(motions) if gate.name == "noise" and gate.passed else ""
    return GateRow(gate.name, gate.passed, gate.tried, levels or gate.summary, "" if gate.passed else remedy(gate))


def _noise_levels(motions: Mapping[str, xr.Dataset]) -> str:
    """Say how large the noise of the channels is, relative to their standard deviation; "" without channels."""
    known = [
        (motion, row)
        for motion in motions.values()
        for row, *_ in compared_rows(motion)
        if np.std(motion.measured.values[row]) > 0.0
    ]
    if not known:
        return ""
    sources = [str(motion.source.values[row]) for motion, row in known if "source" in motion.coords]
    levels = [float(motion.sigma[row]) / float(np.std(motion.measured.values[row])) for motion, row in known]
    ends = dict.fromkeys(percent(x, 2) for x in (min(levels), max(levels)))
    text = f"{' to '.join(ends)} of the standard deviation of the channel, in {count(len(levels), 'channel')}"
    source = f" ({', '.join(dict.fromkeys(sources))})" if sources else ""
    return f"{text}{source}; {_noise_model([_order(motion, row) for motion, row in known])}"


def _order(motion: xr.Dataset, row: int) -> int:
    """Order of the autoregression that the noise of a channel is taken for, 0 where it is uncorrelated."""
    return int(np.flatnonzero(motion.memory.values[row]).max(initial=-1)) + 1


def _noise_model(orders: Sequence[int]) -> str:
    """Say how the noise of the channels is taken to be correlated."""
    low, high = min(orders), max(orders)
    if high == 0:
        return "taken as uncorrelated"
    order = f"{high}" if low == high else f"{low} to {high}, 0 being uncorrelated" if low == 0 else f"{low} to {high}"
    return f"taken as autoregressive of order {order}"


def clocks(references: Mapping[str, Reference]) -> str:
    """Say how the rate of each recorder's clock enters the diagnosis, record by record."""
    names: dict[str, list[str]] = {}
    for name, reference in references.items():
        excitation = reference.excitation
        if reference.is_swept:
            how = "does not enter a frequency response"
        elif excitation.harmonic:
            how = "is a nuisance, solved for against the steady tone"
        elif excitation.quantity == "free decay" or not excitation.periodic:
            how = (
                f"is taken as uncertain by up to {1e6 * MAX_CLOCK_RATE:.0f} ppm (rectangular distribution), which the "
                "standard errors include unless what the model leaves masks it"
            )
        else:
            how = "is taken as right"
        names.setdefault(how, []).append(name)
    texts = [f"{how} ({', '.join(own)})" for how, own in names.items()]
    return f"Rate of the recorder's clock: it {'; it '.join(texts)}." if texts else ""


def record_residuals(motions: Mapping[str, xr.Dataset], label: str) -> list[RecordResidual]:
    """Figures of the residual of each record, the worst record first; `label` names the extended model."""
    residuals = []
    for name in sorted(motions, key=lambda name: -rms_over_noise(motions[name])):
        motion = motions[name]
        if "sweep" in motion.coords:
            gross = GROSS_ERRORS if motion.get("gross_error", np.zeros(1)).any() else ""
            caption = RESIDUALS_OVER_FREQUENCY.format(gross=gross)
            picture = pictured(response_residual_figure(motion, label), f"diagnosed-{name}", caption)
            if picture is not None:
                residuals.append(RecordResidual(name, picture))
            continue
        skipped = any(not motion.weight.values[row].all() for row, *_ in compared_rows(motion))
        caption = RESIDUALS if "period" in motion.attrs else RESIDUALS_IN_TIME
        caption = caption.format(impacts=IMPACTS if skipped else "", extended=GREEN if "extended" in motion else "")
        picture = pictured(residual_figure(motion, label), f"diagnosed-{name}", caption)
        if picture is not None:
            residuals.append(RecordResidual(name, picture))
    return residuals


def body_forces(motions: Mapping[str, xr.Dataset]) -> list[BodyForce]:
    """Figure of the missing acceleration of each body: of the records where it is significant, or else of all."""
    forces = []
    for body in dict.fromkeys(body for motion in motions.values() for body in state_rows(motion)):
        known = missing_accelerations(motions, body)
        significant = {name: force for name, force in known.items() if is_significant(force)}
        span = _span({name: motions[name] for name in significant or known})
        caption = FORCES.format(body=body, span=span)
        others = [name for name in known if name not in significant]
        if others:
            caption += f" {', '.join(others)}: {INSIGNIFICANT}"
        picture = pictured(missing_force_figure(significant or known), f"force-{body}", caption)
        if picture is not None:
            forces.append(BodyForce(body, bool(significant), picture))
    return forces


def misfit_picture(motions: Mapping[str, xr.Dataset]) -> Picture | None:
    """Figure of the local misfit on the phase curves."""
    return pictured(misfit_loops(motions), "misfit-loops", LOOPS.format(span=_span(motions)))


def _span(motions: Mapping[str, xr.Dataset]) -> str:
    """What is drawn of the records: the mean cycle of those that have a period, the whole of the others."""
    kinds = {"mean cycle" if "period" in motion.attrs else "record" for motion in motions.values()}
    return " or, without a period, ".join(sorted(kinds))


def feature_rows(diagnosis: DiagnosisResult) -> FeatureRows:
    """Rows of the table of features."""
    rows = [] if diagnosis.misfit is None else [_feature(feature) for feature in diagnosis.misfit.features]
    marked = [row for row in rows if row.marked][:MAX_SHOWN_FEATURES] or rows[:MIN_SHOWN_FEATURES]
    return FeatureRows(tuple(marked), tuple(rows[len(marked) :]))


def _feature(feature: DeviationResult) -> FeatureRow:
    factor, unit = reading(feature.unit, max(abs(feature.measured or 0.0), abs(feature.simulated or 0.0)))
    measured, simulated, error = (
        None if x is None else factor * x for x in (feature.measured, feature.simulated, feature.error)
    )
    predicted = simulated
    if feature.z is not None and error is not None and measured is not None:
        predicted = measured + feature.z * error
    return FeatureRow(
        label=feature.label,
        record=feature.record,
        body=feature.body,
        unit=raised(unit) or "1",
        measured=with_error(measured, None if error is None else 2.0 * error),
        predicted=rounded(predicted, error),
        z="-" if feature.z is None else signed(feature.z, "+"),
        marked=feature.z is not None and abs(feature.z) > MIN_SHOWN_Z,
    )
