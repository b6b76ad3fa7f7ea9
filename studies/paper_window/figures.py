"""What studies/paper_window finds: tables of posterior distribution and windows, and the picture of the window.

calib run studies/paper_window && calib confidence studies/paper_window --only-posterior
calib window studies/paper_window --budget 320
calib run studies/paper_window/narrow && calib window studies/paper_window/narrow --budget 320 --tolerance 0.05
python studies/paper_window/figures.py
"""

from collections.abc import Mapping
from pathlib import Path

from calib.confidence.artifacts import read_confidence
from calib.confidence.document import ConfidenceResult, MarginalResult
from calib.confidence.window.artifacts import read_drawn_window
from calib.confidence.window.document import WindowResult
from calib.confidence.window.words import alone, bounds, percent, together
from calib.modelling.parameter import Window
from calib.report.plots.style import png
from calib.report.plots.window import window_figure
from calib.units import shown

STUDY = Path(__file__).parent
PICTURE = STUDY.parents[1] / "docs" / "paper_window.png"


def main() -> None:
    """Print the tables, and draw the picture of the narrow window."""
    drawn = {folder: read_drawn_window(folder / "out") for folder in (STUDY, STUDY / "narrow")}
    for folder, found in drawn.items():
        if found is None:
            raise SystemExit(f"{folder}/out holds no window; run the commands at the top of {Path(__file__).name}")
    confidence = read_confidence(STUDY / "out")
    for found in drawn.values():
        if found is not None:
            show_window(found[0])
            if confidence is not None and confidence.posterior is not None and found[0].name == confidence.name:
                show_posterior(confidence, found[0].windows)
            PICTURE.write_bytes(png(window_figure(*found)))
    print(f"\npicture: {PICTURE}")


def show_window(result: WindowResult) -> None:
    """Share of the box, and how far each parameter may vary."""
    print(f"\n{result.name}: {result.admissible_points} of {result.points} points admissible, share of the box "
          f"{percent(result.share)} ({percent(result.share_low)} to {percent(result.share_high)}), on the wrong side "
          f"{result.misclassified / result.share:.0%} of it\n")  # fmt: skip
    print("kinds: " + ", ".join(f"{own.motion} {own.points}" for own in result.kinds) + "\n")
    print("| parameter | alone | together | what bounds it |\n|---|---|---|---|")
    for own in result.parameters:
        print(f"| {own.name} | {alone(own)} | {together(own)} | {bounds(own)} |")


def show_posterior(confidence: ConfidenceResult, windows: Mapping[str, Window]) -> None:
    """Marginal distributions beside their windows, what they predict, and what the confirming simulator says."""
    posterior = confidence.posterior
    if posterior is None:
        return
    print(f"\nposterior: {posterior.evaluations} evaluations, effective size {posterior.effective_size:.0f}\n")
    print("| parameter | mean | standard deviation | interval | of the window |\n|---|---|---|---|---|")
    for own in posterior.parameters:
        ends = f"{shown(own.low, own.unit)} .. {shown(own.high, own.unit)}"
        deviation = shown(own.standard_deviation, own.unit)
        wide = f"{_width(own, windows[own.name]):.0%}"
        print(f"| {own.name} | {shown(own.mean, own.unit)} | {deviation} | {ends} | {wide} |")
    for record in posterior.predicted:
        inside = ", ".join(f"{own.body} {own.channel} {own.inside:.1%}" for own in record.channels if own.inside)
        print(f"{record.name}: inside the 95 % band: {inside}; of another kind: {record.other_kind} of {record.draws}")
    if posterior.confirmed is not None:
        print(f"confirming simulator: {posterior.confirmed.text}")


def _width(own: MarginalResult, window: Window) -> float:
    """Width of an interval over that of the window, on the scale of the window  [1]."""
    return window.position(own.high) - window.position(own.low)


if __name__ == "__main__":
    main()
