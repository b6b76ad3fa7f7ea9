"""Figures of a page with their captions; all are drawn at the end, in parallel processes."""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

from markupsafe import Markup
from matplotlib.figure import Figure

from calib.execution.pool import Failure, InProcess, Pool
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

    This process is one of them: the others have to start and import Matplotlib first. In the place of a figure that
    cannot be drawn stands a sentence that says why.
    """
    pictures = list(_pictures(content))
    others, waiting, elements = min(jobs, len(pictures)) - 1, deque(pictures), dict[str, Any]()
    with ThreadPoolExecutor(1) as thread:
        here = thread.submit(_draw, InProcess(_svg), waiting, elements)
        try:
            if others > 0:
                with LocalPool(_svg, others) as pool:
                    _draw(pool, waiting, elements)
            here.result()
        finally:
            waiting.clear()  # also where the user interrupts it
    return {picture.name: _element(elements[picture.name]) for picture in pictures}


def _element(answer: str | Failure) -> Markup:
    """Return the SVG element of a figure, or a sentence in its place."""
    if isinstance(answer, Failure):
        return Markup("<p>This figure cannot be drawn: {}.</p>").format(answer.reason)
    return Markup(answer)


def _draw(pool: Pool, waiting: deque[Picture], elements: dict[str, Any]) -> None:
    """Take pictures as long as some are waiting, and add their SVG elements, or why there is none, by name."""
    taken: list[Picture] = []

    def next_ones() -> Iterator[Picture]:
        while True:
            try:
                taken.append(waiting.popleft())
            except IndexError:  # others have taken the rest
                return
            yield taken[-1]

    for index, element in pool.map(next_ones()):
        elements[taken[index].name] = element


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
