"""Backbones and constant-response curves: amplitude and level over the frequency of the excitation."""

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from calib.dynamics.backbone_dataset import PHASE_RESONANCE
from calib.report.plots.continuation import DASHED, stability_line
from calib.report.plots.response import LEVELS, LIGHTEST
from calib.report.plots.style import LINE, STYLE
from calib.report.plots.sweeps import BESIDE, WIDE_FIGURE_WIDTH, channel_scale
from calib.units import plain_number, shown_unit


def backbone_figure(curves: xr.Dataset) -> Figure:
    """Amplitude of the held body over frequency, and below the level that it takes; unstable motions dashed.

    Parameters
    ----------
    curves : of `calib.dynamics.backbone_dataset.backbone_dataset`
    """
    body = str(curves.attrs["held_body"])
    own = curves.sel(body=body, harmonic=1)
    scale, unit = channel_scale(own.amplitude)
    factor, name = shown_unit(curves.level.attrs["units"], float(curves.level.max()))
    kinds = curves.kind.values.astype(str)
    constant = np.flatnonzero(kinds != PHASE_RESONANCE).tolist()
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDE_FIGURE_WIDTH, 5.4), layout="constrained")
        upper, lower = figure.subplots(2, 1, sharex=True)
        handles = []
        for index, kind in enumerate(kinds.tolist()):
            part = own.isel(point=np.flatnonzero(own.curve_of_point.values == index))
            backbone = kind == PHASE_RESONANCE
            colour = LINE if backbone else LEVELS(LIGHTEST * constant.index(index) / max(1, len(constant) - 1))
            for axes, values in ((upper, scale * part.amplitude.values), (lower, factor * part.level.values)):
                stability_line(axes, part.frequency.values, values, part.stable.values.astype(bool), colour)
            if not backbone:
                label = f"{plain_number(scale * float(part.amplitude[0]))} {unit}"
                handles.append(Line2D([], [], color=colour, linewidth=1.5, label=label))
        if constant and len(constant) < kinds.size:
            handles.append(Line2D([], [], color=LINE, linewidth=1.5, label="backbone"))
        if not curves.stable.all():
            handles.append(Line2D([], [], color=LINE, linewidth=1.1, linestyle=DASHED, label="unstable"))
        if handles:
            upper.legend(handles=handles, **BESIDE)
        upper.set(ylim=(0.0, None), ylabel=f"{body}: amplitude of\nharmonic 1 [{unit}]")
        lower.set(ylim=(0.0, None), ylabel=f"Excitation [{name}]", xlabel="Frequency of the excitation [Hz]")
        figure.align_ylabels([upper, lower])
        figure.suptitle(str(curves.attrs.get("model", "")), x=0.01, horizontalalignment="left", fontsize=9.5)
    return figure
