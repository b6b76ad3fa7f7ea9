"""The figure of a force that was found."""

from dataclasses import replace

import numpy as np
import pytest

from calib.diagnosis.discovery.document import DiscoveryResult, FormulaResult, FunctionResult, NumberResult
from calib.diagnosis.discovery.formula import Factor, Formula, FormulaTerm
from calib.diagnosis.discovery.shapes import SHAPES, STEP
from calib.report.plots.formula import formula_figure
from calib.report.plots.found_force import found_force_figure
from calib.report.plots.style import png, svg

X, V = tuple(np.linspace(-4e-3, 5e-3, 21)), tuple(np.linspace(-0.3, 0.3, 11))


def function(arguments, points, units, force):
    number = force.size
    region = tuple((p[0], p[-1]) for p in points)
    error, visited = tuple([0.2] * number), tuple([True] * number)
    return FunctionResult(arguments, units, region, points, tuple(force.ravel()), error, visited)


def found(*functions):
    return DiscoveryResult("found", body="mass", functions=functions)


def test_a_function_of_one_argument_is_a_curve_in_its_band():
    along_x = function(("displacement",), (X,), ("m",), np.array(X) * 500.0)
    along_v = function(("velocity",), (V,), ("m/s",), np.array(V) * 3.0)
    figure = found_force_figure(found(along_x, along_v))
    one, other = figure.axes
    assert (one.get_xlabel(), other.get_xlabel()) == ("Displacement [mm]", "Velocity [m/s]")
    band = one.collections[0].get_paths()[0].vertices[:, 1]
    assert band.max() == np.float64(5e-3 * 500.0 + 1.96 * 0.2)
    assert png(figure).startswith(b"\x89PNG")


def test_a_surface_is_a_map_beside_that_of_its_band():
    force = 500.0 * np.array(X)[:, None] * np.array(V)
    figure = found_force_figure(found(function(("displacement", "velocity"), (X, V), ("m", "m/s"), force)))
    assert [axes.get_xlabel() for axes in figure.axes[:2]] == ["Displacement [mm]"] * 2
    assert figure.axes[0].collections[0].get_array().shape == (11, 21)


def test_a_force_that_is_hardly_known_at_the_edge_does_not_set_the_scale_of_a_surface():
    force = 500.0 * np.array(X)[:, None] * np.array(V)
    surface = function(("displacement", "velocity"), (X, V), ("m", "m/s"), force)
    error = np.full(force.shape, 0.01)
    force[0, 0], error[0, 0] = 50.0, 40.0
    surface = replace(surface, force=tuple(force.ravel()), error=tuple(error.ravel()))
    figure = found_force_figure(found(surface))
    known, band = (axes.collections[0] for axes in figure.axes[:2])
    largest = 500.0 * X[-1] * V[-1]
    assert known.get_clim() == pytest.approx((-largest, largest))
    assert band.get_clim() == pytest.approx((0.0, largest))
    assert [mesh.colorbar.extend for mesh in (known, band)] == ["max", "max"]


def test_a_formula_is_drawn_over_the_force_and_written_above():
    curve = replace(function(("displacement",), (X,), ("m",), np.array(X) * 500.0), formula=tuple(np.array(X) * 490.0))
    numbers = tuple(NumberResult(f"c{k}", 490.0, 1.0, "1/s^2", "") for k in (1, 2, 3))
    latex = r"c_{1}\,x + c_{2}\,\max(0, x)^{1.5} + c_{3}\,\sin\frac{2\pi x}{a_{3}}"
    formula = FormulaResult("", latex, numbers, 1.0, None, 1.0, True, True, True, True)
    figure = found_force_figure(replace(found(curve), formulas=(formula,)))
    [axes] = figure.axes
    assert [line.get_label() for line in axes.lines][-2:] == ["formula and function", "formula alone"]
    first, second, third = figure.get_suptitle().split("\n")
    assert (first, second) == (
        r"$c_{1}\,x + c_{2}\,\max(0, x)^{1.5}$", r"$+c_{3}\,\sin\frac{2\pi x}{a_{3}}$"
    )  # fmt: skip
    assert third == ", ".join(f"$c_{{{k}}}$ = 490 1/s²" for k in (1, 2, 3))
    assert png(figure).startswith(b"\x89PNG")


@pytest.mark.parametrize("code", [code for code in SHAPES if code])
def test_every_shape_is_typeset(code):
    formula = Formula((FormulaTerm((Factor(code, "displacement", (2.0, 3.0)), Factor(STEP, "velocity", (0.1, 1.0)))),))
    result = FormulaResult(formula.text, formula.latex, (), 1.0, None, 1.0, True, True, True, True)
    curve = function(("displacement",), (X,), ("m",), np.array(X) * 500.0)
    assert png(found_force_figure(replace(found(curve), formulas=(result,)))).startswith(b"\x89PNG")


def test_a_typeset_formula_keeps_its_letters_without_a_font():
    latex = r"c_{1}\,x + c_{2}\,\max(0, x)^{1.5} + c_{3}\,\sin\frac{2\pi x}{a_{3}}"
    one, three = formula_figure(r"c_{1}\,x"), formula_figure(latex)
    assert three.get_figwidth() > one.get_figwidth()
    assert three.get_figheight() > 2.0 * one.get_figheight()
    element = svg(three, "formula", outlines=True)
    assert element.startswith("<svg")
    assert "<text" not in element


def test_without_a_force_there_is_no_figure():
    assert found_force_figure(DiscoveryResult("nothing")) is None
