"""The section of a page on one record: excitation, figures, misfit."""

from dataclasses import dataclass

import numpy as np
import xarray as xr

from calib.objective import CLOCK_RATE, gross_errors, misfit, squares_of, without_gross_errors
from calib.records import is_response
from calib.records.cycles import WITHOUT_KIND
from calib.records.decay import FREE_DECAY
from calib.records.excitation import Excitation
from calib.records.held_response import is_held
from calib.records.response import harmonic_orders, sigma_of_order
from calib.report.formatting import number, percent, quantity
from calib.report.pages.picture import Picture, pictured
from calib.report.plots.decay import decay_curves
from calib.report.plots.measured_response import response_over_frequency, response_residual
from calib.report.plots.motion import histories, phase_curves
from calib.report.plots.records import (
    aligned_simulation,
    channel_pairs,
    compared_channels,
    impact_times,
    is_drawable,
)
from calib.report.plots.residuals import residual_over_phase, residual_structure
from calib.report.record_description import standard_uncertainty
from calib.report.response_description import response_text
from calib.study import CalibrationResult, CalibrationStudy
from calib.units import MILLI

MAX_DRAWN_BODIES = 12  # bodies of a record with panels of their own; those of 500 take minutes to draw
PHASE_CURVE = "Phase curves: velocity over displacement."
HISTORY = "Time histories."
IMPACTS = " Triangles and dashed lines mark impacts in the simulation."
RESPONSE = (
    "Amplitude and phase of each harmonic over the frequency of the excitation, a colour a level: measured points, and "
    "the stable motions that sweeps of these levels and directions run through. Triangles point in the direction of "
    "the sweep; bars are 2 standard uncertainties, and what is no larger has no phase."
)
HELD_RESPONSE = (
    "Amplitude and phase over the frequency of the excitation, a colour for each amplitude that was held: measured "
    "points, and the motions at these amplitudes. Amplitudes are those at one level a sweep, in proportion to the one "
    "that was held; as measured, the level changed from point to point in its place. Bars are 2 standard "
    "uncertainties, and what is no larger has no phase."
)
RESPONSE_RESIDUAL = (
    "Distance from each measured point to the nearest one of the simulated curve, in standard uncertainties: in "
    "complex amplitude, and in frequency, where a fold of the simulation comes early or late."
)
RINGED = " Points that are ringed above are left out."
DECAY = (
    "Frequency and damping ratio over the amplitude of the fundamental: measured, a dot a period by its zero "
    "crossings, and smoothed with a band of two standard uncertainties on either side; simulated, smoothed alike."
)
OVER_PHASE = (
    "Residual, measured minus simulated, over the phase of the excitation: mean of the cycles, with a band of two "
    "standard errors on either side. Where the band does not include zero, the residual is not noise."
)
STRUCTURE = (
    "Residual, measured minus simulated: over time; against the motion (blue: means in bins); correlation with "
    "functions of displacement x and velocity v, which are simulated, or prescribed where the record prescribes them "
    "(grey bars: with x and v themselves; blue bars: partial correlations, without the part that is linear in x and v; "
    "a function that is linear in them has no bar) and with the previous sample; and spectrum. A pattern or a long "
    "blue bar points to an effect that is missing in the model. Near a resonance the response to a missing force lags "
    "it by a quarter of a period: that to a missing spring correlates with the velocity."
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
    name, use, source, warning, driven, noise : of the record; the last two describe its excitation and uncertainty
    failed : why its simulation failed, "" where it did not
    kind, misfit, score : of a record that was held out; no kind where kinds of motion do not apply
    pictures, residuals : figures of the motion and of the residual
    rms : misfit of each channel
    """

    name: str
    use: str
    source: str
    warning: str
    driven: str
    noise: str
    failed: str
    kind: str | None
    misfit: str
    score: float | None
    pictures: tuple[Picture, ...]
    residuals: tuple[Picture, ...]
    rms: tuple[ChannelMisfitRow, ...]


def _response_picture(
    name: str, measured: xr.Dataset, aligned: xr.Dataset | None, simulated: xr.Dataset | None
) -> Picture | None:
    """Picture of a measured response with what was simulated, and that put on the measured points."""
    caption = HELD_RESPONSE if is_held(measured) else RESPONSE
    if aligned is None:
        return pictured(response_over_frequency(measured, None), f"response-{name}", caption)
    drawn = response_over_frequency(measured, simulated, gross_errors(aligned["trust"].values))
    return pictured(drawn, f"response-{name}", caption)


def _response_residual(name: str, measured: xr.Dataset, aligned: xr.Dataset, bound: str) -> Picture | None:
    """Picture of the distances of a measured response from what was simulated, without gross errors."""
    ringed = RINGED if gross_errors(aligned["trust"].values).size else ""
    return pictured(response_residual(measured, aligned), f"residual-{name}", RESPONSE_RESIDUAL + ringed + bound)


def record_section(
    study: CalibrationStudy,
    name: str,
    simulated: xr.Dataset | None,
    result: CalibrationResult,
    base: xr.Dataset | None = None,
) -> RecordSection:
    """Everything that a page shows of the record `name`.

    Parameters
    ----------
    simulated : at the best values, None where it was not
    base : simulated by the study that this one extends, None where there is none
    """
    reference, held = study.objective.references[name], result.holdout.get(name)
    measured = reference.record
    response = is_response(measured)
    failed, aligned = "", None
    if simulated is not None and is_drawable(simulated):
        aligned = aligned_simulation(study.objective, name, simulated)
    elif simulated is not None:
        failed = f"{simulated.attrs.get('status')}: {simulated.attrs.get('reason', 'no reason stated')}"
    without = None if base is None or not is_drawable(base) else aligned_simulation(study.objective, name, base)
    impacts = IMPACTS if aligned is not None and impact_times(aligned).size else ""
    drawn, bound = _drawn_bodies(measured, aligned)
    figures = (
        [_response_picture(name, drawn, aligned, simulated)]
        if response
        else [
            pictured(phase_curves(drawn, aligned, without), f"loop-{name}", PHASE_CURVE + impacts + bound),
            pictured(histories(drawn, aligned, without), f"history-{name}", HISTORY + impacts + bound),
        ]
    )
    if reference.excitation.quantity == FREE_DECAY and not response:
        figures.append(pictured(decay_curves(drawn, aligned), f"decay-{name}", DECAY + bound))
    residuals: list[Picture | None] = []
    if reference.use == "calibrate" and aligned is not None and simulated is not None:
        residuals = (
            [_response_residual(name, drawn, aligned, bound)]
            if response
            else _residuals(name, drawn, aligned, simulated, bound)
        )
    return RecordSection(
        name=name,
        use=reference.use,
        source=str(measured.attrs.get("source", "")),
        warning=str(measured.attrs.get("warning", "")),
        driven=response_text(measured, reference.excitation.quantity, reference.excitation.place)
        if response
        else excitation_text(reference.excitation, float(measured.attrs.get(CLOCK_RATE, 0.0))),
        noise=noise_text(measured),
        failed=failed,
        kind=None if held is None or held.kind in WITHOUT_KIND else held.kind,
        misfit=percent(None if held is None else held.misfit, 3),
        score=None if held is None else held.score,
        pictures=tuple(picture for picture in figures if picture is not None),
        residuals=tuple(picture for picture in residuals if picture is not None),
        rms=() if aligned is None else tuple(_misfit_by_channel(measured, aligned)),
    )


def _drawn_bodies(measured: xr.Dataset, aligned: xr.Dataset | None) -> tuple[xr.Dataset, str]:
    """Bodies of a record that have panels, compared ones first, and what the captions say where that are not all."""
    count = measured.sizes["body"]
    if count <= MAX_DRAWN_BODIES:
        return measured, ""
    compared = [] if aligned is None else [body for body, _ in compared_channels(measured, aligned)]
    bodies = list(dict.fromkeys([*compared, *(str(body) for body in measured.body.values)]))[:MAX_DRAWN_BODIES]
    return measured.sel(body=bodies), f" Panels are drawn for {len(bodies)} of the {count} bodies."


def _residuals(
    name: str, measured: xr.Dataset, aligned: xr.Dataset, simulated: xr.Dataset, bound: str
) -> list[Picture | None]:
    """Figures of the residual: over the phase of the excitation, or its structure where there is no excitation.

    bound : what the captions say of the bodies that are drawn
    """
    over_phase = residual_over_phase(measured, aligned)
    if over_phase is not None:
        return [pictured(over_phase, f"phase-{name}", OVER_PHASE + bound)]
    if measured.attrs.get("frequency"):
        return []
    return [
        pictured(
            residual_structure(measured, aligned, body, channel, simulated),
            f"residual-{name}-{body}-{channel}",
            STRUCTURE + bound,
        )
        for body, channel in compared_channels(measured, aligned)
    ]


def _misfit_by_channel(measured: xr.Dataset, aligned: xr.Dataset) -> list[ChannelMisfitRow]:
    """Misfit of every compared channel, without gross errors of a response; None where the channel is constant."""
    rows = []
    if is_response(measured):
        measured, aligned = without_gross_errors(measured, aligned)
    for body, channel in compared_channels(measured, aligned):
        relative = misfit([squares_of(measured, aligned, [(body, channel)])])
        moves = float(measured[channel].sel(body=body).std()) > 0.0
        rows.append(ChannelMisfitRow(body, channel, relative if moves else None))
    return rows


def excitation_text(excitation: Excitation, clock_rate: float = 0.0) -> str:
    """Describe an excitation: quantity, place, amplitude, frequency, deviation of the recorder's clock from its own."""
    if excitation.quantity == "free decay":
        return f"free motion of the {excitation.place}, no excitation"
    recorded, size = "the recorded " if excitation.recorded else "", ""
    if excitation.amplitude is not None and not excitation.recorded:
        scale, unit = MILLI.get(excitation.unit, (1.0, excitation.unit))
        size = f", {number(scale * excitation.amplitude)} {unit}"
    frequency = "" if excitation.frequency is None else f" at {number(excitation.frequency)} Hz"
    where = f" of the {excitation.place}" if excitation.place else ""
    return f"excited by {recorded}{excitation.quantity}{where}{size}{frequency}{_clock(clock_rate)}"


def noise_text(record: xr.Dataset) -> str:
    """Write the standard uncertainty that a record states of each channel (median over its samples); "" without any."""
    stated = list[str]()
    if is_response(record):
        for order in harmonic_orders(record):
            name, of = sigma_of_order(order), "response" if order == 1 else f"harmonic {order}"
            rows = zip(record.body.values.tolist(), record[name].values, strict=True) if name in record else ()
            stated += [f"{of} of {body} {quantity(float(np.median(own)), 'm', 2)}" for body, own in rows]
        return f"stated standard uncertainty: {', '.join(stated)}" if stated else "no uncertainty stated"
    for body, channel in channel_pairs(record):
        sigma = standard_uncertainty(record, body, channel)
        if sigma is not None:
            size = quantity(float(np.median(sigma)), record[channel].attrs.get("units", "1"), 2)
            stated.append(f"{channel} of {body} {size}")
    return f"stated standard uncertainty: {', '.join(stated)}" if stated else "no uncertainty stated"


def _clock(rate: float) -> str:
    """Deviation of the recorder's clock from that of the excitation, as the end of a sentence."""
    side = "slow" if rate > 0.0 else "fast"
    return f"; the recorder's clock is {number(1e6 * abs(rate))} ppm {side} against the excitation" if rate else ""
