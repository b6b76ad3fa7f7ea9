"""Figures as papers print them: drawn, rasterised, turned, compressed, and what was drawn in them."""

import io
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

INCH = (5.2, 4.0)


@dataclass(frozen=True)
class Look:
    """How a figure is drawn."""

    dpi: int = 150
    form: str = "png"
    colours: tuple = ("#0072B2", "#D55E00")
    dashes: tuple = ("-", "-")
    grid: bool = False
    turn: float = 0.0  # degrees
    shear: float = 0.0
    width: float = 1.4  # points
    quality: int = 90


@dataclass
class Drawn:
    """A rendered figure."""

    path: Path
    points: list = field(default_factory=list)  # {"pixel": [column, row], "x": , "y": }, as a reader clicks them
    exact: list = field(default_factory=list)
    limits: tuple = ()


def draw(path, loops, look=Look(), labels=("Displacement [mm]", "Velocity [m/s]"), limits=None, ticks=None):
    """Draw closed curves [(n, 2), ...] in the units of the axes."""
    with mpl.rc_context({"path.simplify": False}):
        figure = Figure(figsize=INCH, dpi=look.dpi)
        canvas = FigureCanvasAgg(figure)
        axes = figure.add_axes((0.14, 0.13, 0.82, 0.82))
        for loop, colour, dash in zip(loops, look.colours, look.dashes, strict=False):
            axes.plot(loop[:, 0], loop[:, 1], color=colour, linestyle=dash, linewidth=look.width)
        axes.margins(0.09)
        axes.set_xlabel(labels[0])
        axes.set_ylabel(labels[1])
        if limits is not None:
            axes.set_xlim(*limits[0])
            axes.set_ylim(*limits[1])
        if look.grid:
            axes.grid(True)
        canvas.draw()
        pixels = np.asarray(canvas.buffer_rgba())[:, :, :3]
        (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
        x = [t for t in axes.get_xticks() if left < t < right]
        y = [t for t in axes.get_yticks() if low < t < high]
        corners = [(x[0], y[0]), (x[-1], y[0]), (x[0], y[-1]), (x[-1], y[-1])]
        shown = axes.transData.transform(corners)
        height = pixels.shape[0]
    picture = Image.fromarray(pixels)
    places = np.column_stack([shown[:, 0] - 0.5, height - shown[:, 1] - 0.5])
    picture, places = scanned(picture, places, look.turn, look.shear)
    stored = io.BytesIO()
    if look.form == "jpg":
        picture.save(stored, format="JPEG", quality=look.quality)
    else:
        picture.save(stored, format="PNG")
    path = Path(path).with_suffix(f".{look.form}")
    path.write_bytes(stored.getvalue())
    exact = [
        {"pixel": [float(a) for a in place], "x": float(corner[0]), "y": float(corner[1])}
        for place, corner in zip(places, corners, strict=True)
    ]
    clicked = [{**e, "pixel": [round(a) for a in e["pixel"]]} for e in exact]
    return Drawn(path, clicked, exact, ((left, right), (low, high)))


def scanned(picture, places, turn, shear):
    """Turn [degrees] and shear a page about its middle; white comes in from outside."""
    if turn == 0.0 and shear == 0.0:
        return picture, places
    angle = np.deg2rad(turn)
    turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    forward = turned @ np.array([[1.0, shear], [0.0, 1.0]])
    middle = 0.5 * (np.array(picture.size) - 1.0)
    back = np.linalg.inv(forward)
    # Pillow maps the middle of the output pixel (column + 0.5, row + 0.5) to the input
    shift = (middle + 0.5) - back @ (middle + 0.5)
    data = (back[0, 0], back[0, 1], shift[0], back[1, 0], back[1, 1], shift[1])
    page = picture.transform(
        picture.size, Image.Transform.AFFINE, data, resample=Image.Resampling.BICUBIC, fillcolor=(255, 255, 255)
    )
    return page, (places - middle) @ forward.T + middle
