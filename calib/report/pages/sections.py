"""The section of a page on one record: excitation, figures, misfit."""

from dataclasses import dataclass

import xarray as xr

from calib.objective import CLOCK_RATE, misfit, squares_of
from calib.records.excitation import UNITS
from calib.report.formatting import number, percent
from calib.report.pages.picture import Picture, pictured
from calib.report.plots.motion import histories, phase_curves
from calib.report.plots.records import aligned_simulation, compared_channels, impact_times, is_drawable
from calib.report.plots.residuals import residual_over_phase, residual_structure
from calib.study import CalibrationResult, CalibrationStudy
from calib.units import MILLI

PHASE_CURVE = "Phase curves: velocity over displacement."
HISTORY = "Time histories."
IMPACTS = " Triangles and dashed lines mark impacts in the simulation."
OVER_PHASE = (
    "Residual, measured minus simulated, over the phase of the excitation: mean of the cycles, with a band of two "
    "standard errors on either side. Where the band does not include zero, the residual is not noise."
)
STRUCTURE = (
    "Residual, measured minus simulated: over time; against the motion (blue: means in bins); correlation with "
    "functions of displacement x and velocity v, which are simulated, or prescribed where the record prescribes them "
    "(blue bars: partial correlations, without the part that is linear in x and v; a function that is linear in them "
    "has no bar); and spectrum. A pattern or a long blue bar points to an effect that is missing in the model. "
    "Near a resonance the response to a missing force lags it by a quarter of a period: that to a missing spring "
    "correlates with the velocity."
)


@dataclass(frozen=True)
class ChannelMisfitRow:
    """Misfit of a channel: rms of the residual over that of the measured channel about its mean  [1]."""

    body: str
    channel: str
    relative: float | None


@dataclass(frozen=True)
class RecordSection:
    """What a page shows of a record.

    Attributes
    ----------
    name, use, source, warning, driven : of the record; the last describes its excitation
    failed : why its simulation failed, "" where it did not
    kind, misfit, score : of a record that was held out
    pictures, residuals : figures of the motion and of the residual
    rms : misfit of each channel
    """

    name: str
    use: str
    source: str
    warning: str
    driven: str
    failed: str
    kind: str | None
    misfit: str
    score: float | None
    pictures: tuple[Picture, ...]
    residuals: tuple[Picture, ...]
    rms: tuple[ChannelMisfitRow, ...]


def record_section(
    study: CalibrationStudy, name: str, simulated: xr.Dataset | None, result: CalibrationResult
) -> RecordSection:
    """Everything that a page shows of the record `name`; `simulated` at the best values, None where it was not."""
    reference, held = study.objective.references[name], result.holdout.get(name)
    measured = reference.record
    failed, aligned = "", None
    if simulated is not None and is_drawable(simulated):
        aligned = aligned_simulation(study.objective, name, simulated)
    elif simulated is not None:
        failed = f"{simulated.attrs.get('status')}: {simulated.attrs.get('reason', 'no reason stated')}"
    impacts = IMPACTS if aligned is not None and impact_times(aligned).size else ""
    figures = [
        pictured(phase_curves(measured, aligned), f"loop-{name}", PHASE_CURVE + impacts),
        pictured(histories(measured, aligned), f"history-{name}", HISTORY + impacts),
    ]
    residuals: list[Picture | None] = []
    if reference.use == "calibrate" and aligned is not None and simulated is not None:
        residuals = _residuals(name, measured, aligned, simulated)
    return RecordSection(
        name=name,
        use=reference.use,
        source=str(measured.attrs.get("source", "")),
        warning=str(measured.attrs.get("warning", "")),
        driven=excitation_text(measured),
        failed=failed,
        kind=None if held is None else held.kind,
        misfit=percent(None if held is None else held.misfit, 3),
        score=None if held is None else held.score,
        pictures=tuple(picture for picture in figures if picture is not None),
        residuals=tuple(picture for picture in residuals if picture is not None),
        rms=() if aligned is None else tuple(_misfit_by_channel(measured, aligned)),
    )


def _residuals(name: str, measured: xr.Dataset, aligned: xr.Dataset, simulated: xr.Dataset) -> list[Picture | None]:
    """Figures of the residual: over the phase of the excitation, or its structure where there is no excitation."""
    over_phase = residual_over_phase(measured, aligned)
    if over_phase is not None:
        return [pictured(over_phase, f"phase-{name}", OVER_PHASE)]
    if measured.attrs.get("frequency"):
        return []
    return [
        pictured(
            residual_structure(measured, aligned, body, channel, simulated),
            f"residual-{name}-{body}-{channel}",
            STRUCTURE,
        )
        for body, channel in compared_channels(measured, aligned)
    ]


def _misfit_by_channel(measured: xr.Dataset, aligned: xr.Dataset) -> list[ChannelMisfitRow]:
    """Misfit of every compared channel; None where the channel is constant."""
    rows = []
    for body, channel in compared_channels(measured, aligned):
        relative = misfit([squares_of(measured, aligned, [(body, channel)])])
        moves = float(measured[channel].sel(body=body).std()) > 0.0
        rows.append(ChannelMisfitRow(body, channel, relative if moves else None))
    return rows


def excitation_text(record: xr.Dataset) -> str:
    """Describe the excitation of a record: quantity, place, amplitude, frequency, clock; "" where none is stated."""
    attrs = record.attrs
    quantity, place = attrs.get("quantity", ""), attrs.get("place", "")
    if not quantity:
        return ""
    amplitude = ""
    if attrs.get("amplitude") is not None and attrs.get("frequency"):
        unit = UNITS.get(quantity, "m")
        scale, shown = MILLI.get(unit, (1.0, unit))
        amplitude = f", {number(scale * float(attrs['amplitude']))} {shown}"
    frequency = f" at {number(float(attrs['frequency']))} Hz" if attrs.get("frequency") else ""
    where = f" of the {place}" if place else ""
    return f"excited by {quantity}{where}{amplitude}{frequency}{_clock(float(attrs.get(CLOCK_RATE, 0.0)))}"


def _clock(rate: float) -> str:
    """Deviation of the recorder's clock from that of the excitation, as the end of a sentence."""
    side = "slow" if rate > 0.0 else "fast"
    return f"; the recorder's clock is {number(1e6 * abs(rate))} ppm {side} against the excitation" if rate else ""
