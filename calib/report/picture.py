"""Figures of a page with their captions, and how they are drawn: all of them at the end, side by side."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup
from matplotlib.figure import Figure

from calib.execution.pool import InProcess, LocalPool, in_order
from calib.report.drawing import svg


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure of a page that is not drawn yet.

    Attributes
    ----------
    name : of no other figure of the page
    """

    figure: Figure
    name: str
    caption: str


def pictured(figure: Figure | None, name: str, caption: str) -> Picture | None:
    """Return the picture of a figure; None where there is nothing to show."""
    return None if figure is None else Picture(figure, name, caption)


def drawn(content: Any, jobs: int) -> dict[str, Markup]:
    """Return the SVG elements, by name, of all pictures in what a page shows, drawn by so many processes.

    Raises
    ------
    RuntimeError : a figure cannot be drawn
    """
    found = list(_pictures(content))
    processes = min(jobs, len(found))
    with InProcess(_svg) if processes < 2 else LocalPool(_svg, processes) as pool:
        elements = in_order(pool, found)
    for picture, element in zip(found, elements, strict=True):
        if not isinstance(element, str):
            raise RuntimeError(f"the figure {picture.name!r} cannot be drawn: {element.reason}")
    return {picture.name: Markup(element) for picture, element in zip(found, elements, strict=True)}


def _svg(picture: Picture) -> str:
    return svg(picture.figure, picture.name)


def _pictures(content: Any) -> Iterator[Picture]:
    if isinstance(content, Picture):
        yield content
    elif isinstance(content, Mapping):
        for part in content.values():
            yield from _pictures(part)
    elif isinstance(content, Sequence) and not isinstance(content, str):
        for part in content:
            yield from _pictures(part)
