"""Claims about the pictures of a page: each that it shows is drawn, by any number of processes alike."""

import re

import pytest
from matplotlib.figure import Figure

from calib.report.pages.picture import drawn, pictured


def line(slope, name):
    figure = Figure()
    figure.subplots().plot([0.0, 1.0], [0.0, slope])
    return pictured(figure, name, f"slope {slope}")


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_picture_of_what_a_page_shows_is_drawn(jobs):
    rows = [{"text": "T", "picture": line(2.0, "c")}]
    content = {"title": "T", "one": line(1.0, "a"), "none": pictured(None, "b", ""), "rows": rows}
    elements = drawn(content, jobs)
    assert list(elements) == ["a", "c"]
    assert elements == drawn({"a": line(1.0, "a"), "c": line(2.0, "c")}, 1)
    assert all(element.startswith("<svg") for element in elements.values())


def test_links_within_a_picture_work_whatever_its_record_is_called():
    name = 'loop-my "bench", 2 #1?'
    element = drawn([line(1.0, name)], 1)[name]
    wanted = re.findall(r'href="#([^"]*)"', element) + re.findall(r"url\(#([^)]*)\)", element)
    assert wanted
    assert set(wanted) <= set(re.findall(r'\bid="([^"]*)"', element))


@pytest.mark.parametrize("jobs", [1, 2])
def test_in_the_place_of_a_figure_that_cannot_be_drawn_stands_why(jobs):
    figure = Figure()
    figure.text(0.5, 0.5, r"$\frac<b>$", parse_math=True)
    elements = drawn([line(1.0, "a"), pictured(figure, "b", "")], jobs)
    assert elements["a"].startswith("<svg")
    assert elements["b"].startswith("<p>This figure cannot be drawn: ValueError")
    assert "<b>" not in elements["b"]
