"""Figures of a page with their captions; all are drawn at the end, in parallel processes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass

from markupsafe import Markup
from matplotlib.figure import Figure

from calib.execution.pool import InProcess, in_order
from calib.execution.pools.local import LocalPool
from calib.report.plots.style import svg


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure of a page that is not drawn yet.

    Attributes
    ----------
    name : unique on the page
    outlines : see `calib.report.plots.style.svg`
    """

    figure: Figure
    name: str
    caption: str
    outlines: bool = False


def pictured(figure: Figure | None, name: str, caption: str) -> Picture | None:
    """Return the picture of a figure; None where there is none."""
    return None if figure is None else Picture(figure, name, caption)


def drawn(content: object, jobs: int) -> dict[str, Markup]:
    """Return the SVG elements, by name, of all pictures in the content of a page, drawn by `jobs` processes.

    Raises
    ------
    RuntimeError : a figure cannot be drawn
    """
    pictures = list(_pictures(content))
    processes = min(jobs, len(pictures))
    with InProcess(_svg) if processes < 2 else LocalPool(_svg, processes) as pool:
        elements = in_order(pool, pictures)
    for picture, element in zip(pictures, elements, strict=True):
        if not isinstance(element, str):
            raise RuntimeError(f"the figure {picture.name!r} cannot be drawn: {element.reason}")
    return {picture.name: Markup(element) for picture, element in zip(pictures, elements, strict=True)}


def _svg(picture: Picture) -> str:
    return svg(picture.figure, picture.name, picture.outlines)


def _pictures(content: object) -> Iterator[Picture]:
    """All pictures in nested mappings, sequences and dataclasses."""
    if isinstance(content, Picture):
        yield content
    elif isinstance(content, Mapping):
        for part in content.values():
            yield from _pictures(part)
    elif isinstance(content, Sequence) and not isinstance(content, str):
        for part in content:
            yield from _pictures(part)
    elif is_dataclass(content) and not isinstance(content, type):
        for field in fields(content):
            yield from _pictures(getattr(content, field.name))
