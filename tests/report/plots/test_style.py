"""Claims about the style of figures: foreign names are drawn as they are, and no label of an axis is in LaTeX."""

import pickle

import matplotlib as mpl
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from calib.report.plots.formula import formula_figure
from calib.report.plots.style import STYLE, label_powers, logarithmic, svg


def drawn(prepare):
    with mpl.rc_context(STYLE):
        figure = Figure()
        prepare(figure.subplots())
    return svg(figure, "one")


@pytest.mark.parametrize("name", ["m$x_{$", r"a $\frac$ b", "p_{in} costs 5$ or 6$", "α_$1$"])
def test_a_name_with_dollars_is_drawn_as_it_is(name):
    element = drawn(lambda axes: (axes.set(title=name, xlabel=name), axes.plot([0.0, 1.0], label=name), axes.legend()))
    assert element.count(f">{name}<") == 3


@pytest.mark.parametrize(
    ("low", "high", "label"), [(1e-7, 1e9, "10⁷"), (1e-3, 1e3, "10⁻²"), (2.0, 5000.0, "10²"), (1.2, 9.0, "2")]
)
@pytest.mark.parametrize("labelled", [lambda axis, *ends: label_powers(axis), logarithmic])
def test_a_logarithmic_axis_is_labelled_without_latex(low, high, label, labelled):
    def prepare(axes):
        axes.set(xscale="log", xlim=(low, high))
        labelled(axes.xaxis, low, high)

    element = drawn(prepare)
    assert "$" not in element
    assert f">{label}<" in element


@pytest.mark.parametrize(
    ("low", "high"),
    [(4.5e5, 5.7e5), (1.8, 2.2), (0.97, 1.02), (9.3e5, 1.4e6), (1e-5, 1.4e-5), (2e5, 4.5e5), (0.2, 7.0), (3.0, 90.0)],
)
def test_labels_of_a_short_logarithmic_axis_do_not_overlap(low, high):
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(1.7, 1.5))
        axes = figure.add_axes((0.08, 0.2, 0.84, 0.7), xscale="log", xlim=(low, high))
        logarithmic(axes.xaxis, low, high)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        labels = [
            label for label in axes.get_xticklabels() if label.get_text() and low <= label.get_position()[0] <= high
        ]
        boxes = [label.get_window_extent(canvas.get_renderer()) for label in labels]
    assert 2 <= len(boxes) <= 6
    assert all(one.x1 < other.x0 for one, other in zip(boxes, boxes[1:], strict=False))
    assert not any("e" in label.get_text() for label in labels)


def test_a_formula_is_typeset():
    assert ">$" not in svg(formula_figure(r"c_{1} \dot{q}^{3} + c_{2} q"), "formula")


@pytest.mark.parametrize("labelled", [lambda axis, *ends: label_powers(axis), logarithmic])
@pytest.mark.parametrize("high", [1.1, 5.0, 1e4])
def test_a_logarithmic_axis_can_be_handed_to_the_process_that_draws_it(high, labelled):
    with mpl.rc_context(STYLE):
        figure = Figure()
        axes = figure.subplots()
        axes.set(xscale="log", xlim=(1.0, high))
        labelled(axes.xaxis, 1.0, high)
    copy = pickle.loads(pickle.dumps(figure))
    with mpl.rc_context(STYLE):
        assert svg(copy, "one") == svg(figure, "one")
