"""The paper's story, told by calib: calibrate, diagnose, extend, calibrate again, and draw docs/paper_story.png.

`python studies/paper_story/story.py` tells all of it; with `--picture` the picture is drawn anew from what lies in out/
and out.extended/.
"""

import sys
import time
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from calib.diagnosis import artifacts
from calib.diagnosis.document import DiagnosisResult
from calib.objective import Objective
from calib.records import read
from calib.report.plots.records import aligned_simulation
from calib.report.plots.style import LINE, MARK, MEASURED, SIMULATED, STYLE, dots, line
from calib.study import CalibrationResult, result
from calib.study_file import load
from calib.units import shown
from calib.workflows.calibrate import calibrate
from calib.workflows.diagnose import diagnose_study

HERE = Path(__file__).parent
PICTURE = HERE.parents[1] / "docs" / "paper_story.png"
BEFORE, AFTER = MARK, SIMULATED  # colours: without the shift, with it
SUSPECTS = 8  # bars


def main() -> None:
    """Tell the story, and draw it."""
    if "--picture" not in sys.argv[1:]:
        tell(HERE / "study.toml")
    draw(HERE).savefig(PICTURE, dpi=130)


def tell(path: Path) -> None:
    """Calibrate the study, diagnose it, calibrate what the diagnosis makes of it; say in between what was found."""
    began = time.monotonic()
    first = calibrate(path)
    print(f"calibrated: distance {first.score.total:.3g}, {first.motion.kind}")
    for missed in first.unreachable:
        print(f"    not reached: {missed.feature}, {missed.percent:.3g} % off")
    found, extended = diagnose_study(path, apply=True, on_stage=lambda stage: print(f"    {stage}", flush=True))
    print(f"diagnosed: {found.summary}")
    if extended is None:
        raise SystemExit(f"the diagnosis came to {found.verdict!r}: there is nothing to extend the model by")
    second = calibrate(extended)
    print(f"extended: distance {second.score.total:.3g}, {second.motion.kind}")
    for name, before in first.holdout.items():
        one, other = (held.terms for held in (before, second.holdout[name]))
        print(f"    held out, {name}: " + "; ".join(f"{t} {one[t]:.3g} -> {other[t]:.3g}" for t in other if t in one))
    print(f"{time.monotonic() - began:.0f} s")


def draw(folder: Path) -> Figure:
    """Draw the three panels from the files of the two studies."""
    file = load(folder)
    objective, told = file.study.objective, [folder / "out", folder / "out.extended"]
    diagnosis, results = artifacts.read(told[0]), [found for out in told if (found := result.read(out))]
    if diagnosis is None or len(results) < len(told):
        raise SystemExit("the story was not told yet: run without --picture")
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(10.0, 3.9), layout="constrained")
        loop, suspects, held = figure.subplots(1, 3, width_ratios=(1.25, 1.05, 0.75))
        motions(loop, objective, [read(out / "best.nc") for out in told])
        explained(suspects, diagnosis)
        predicted(held, results)
    return figure


def motions(axes: Axes, objective: Objective, simulated: Sequence[xr.Dataset]) -> None:
    """Phase curve of the layer: measured, calibrated without the shift, and extended."""
    measured = objective.references["clapping"].record.sel(body="layer")
    dots(axes, 1e3 * measured.displacement.values, measured.velocity.values)
    for record, colour in zip(simulated, (BEFORE, AFTER), strict=True):
        one = aligned_simulation(objective, "clapping", record).sel(body="layer")
        period = one.time.values - one.time.values[0] <= 1.0 / 26.51 * 1.01
        line(axes, 1e3 * one.displacement.values[period], one.velocity.values[period], colour, 1.8)
    axes.set_title("The layer's motion: no parameters reach it")
    axes.set_xlabel("Displacement [mm]")
    axes.set_ylabel("Velocity [m/s]")
    known = [
        Line2D([], [], color=MEASURED, marker=".", markersize=7, linestyle="none", label="record (stand-in)"),
        Line2D([], [], color=BEFORE, linewidth=1.8, label="best of the box"),
        Line2D([], [], color=AFTER, linewidth=1.8, label="with the shift"),
    ]
    axes.margins(x=0.05, y=0.05)
    axes.set_ylim(top=axes.get_ylim()[1] + 0.045)  # room for the legend
    axes.legend(handles=known, loc="upper left", handlelength=1.4)


def explained(axes: Axes, diagnosis: DiagnosisResult) -> None:
    """Suspects as bars: how much of the excess misfit each explains, everything else calibrated anew."""
    explaining = [(s, s.share) for s in diagnosis.suspects if s.refitted and s.share is not None and s.share > 0.0]
    tried = [suspect for suspect, _ in explaining[:SUSPECTS]]
    places = np.arange(len(tried))[::-1]
    shares = [100.0 * share for _, share in explaining[:SUSPECTS]]
    named = {name for causes in diagnosis.classes for name in causes}
    colours = [AFTER if s.effect in named else MEASURED for s in tried]
    axes.barh(places, shares, color=colours, height=0.62)
    axes.set_yticks(places, [s.effect.replace("_", " ") for s in tried])
    for place, share in zip(places, shares, strict=True):
        axes.annotate(f"{share:.1f} %", (share, place), (4, 0), textcoords="offset points", va="center", fontsize=8)
    for place, suspect in zip(places, tried, strict=True):
        if suspect.effect in named:
            [(name, size)] = suspect.size.items()
            text = "" if size is None else shown(size, suspect.units[name], 3)
            axes.annotate(text, (0.0, place), (6, 0), textcoords="offset points", va="center", color="white")
    axes.set_xlim(0.0, 125.0)
    axes.set_xticks([0, 50, 100])
    axes.set_xlabel("Misfit explained [%]")
    axes.set_title("What is missing? Suspects, each calibrated")
    axes.grid(False, axis="y")
    axes.tick_params(axis="y", length=0)


def predicted(axes: Axes, results: Sequence[CalibrationResult]) -> None:
    """Distance of the layer's phase curve on the records held out, before and after."""
    names, term = list(results[0].holdout), "phase_curve of layer"
    for offset, found, colour in zip((-0.2, 0.2), results, (BEFORE, AFTER), strict=True):
        distances = [found.holdout[name].terms.get(term) for name in names]
        heights = [np.nan if distance is None else distance for distance in distances]
        axes.bar(np.arange(len(names)) + offset, heights, color=colour, width=0.36)
        for place, height in enumerate(heights):
            axes.annotate(f"{height:.2g}", (place + offset, height), (0, 3), textcoords="offset points", ha="center")
    axes.set_xticks(np.arange(len(names)), names)
    axes.set_ylabel("Distance of the phase curve [1]")
    axes.set_title("Held out, not seen before")
    axes.grid(False, axis="x")
    axes.axhline(0.0, color=LINE, linewidth=0.7)
    axes.margins(y=0.12)


if __name__ == "__main__":
    main()
