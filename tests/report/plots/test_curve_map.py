"""Curves of bifurcations over the plane of two parameters, as a picture."""

import numpy as np
import pytest

from calib.dynamics.curve_dataset import curves_dataset
from calib.dynamics.curves import BifurcationCurve, CodimensionTwo
from calib.dynamics.defining import ParameterPlane
from calib.report.plots.continuation import SPECIAL
from calib.report.plots.curves import curve_map

PLANE = ParameterPlane(lambda a, b: None, (0.0, 1.0), (1e-3, 2e-3))


def curve(kind, a, points=(), bounding=True):
    m = len(a)
    return BifurcationCurve(
        kind=kind,
        periods=1,
        start=0.5,
        names=("body.displacement",),
        units=("m",),
        a=np.array(a),
        b=np.linspace(1e-3, 2e-3, m),
        errors=np.zeros((2, m)),
        states=np.zeros((m, 1)),
        multipliers=np.ones((m, 1), dtype=complex),
        bounding=np.full(m, bounding),
        impacts=np.ones(m, dtype=int),
        tests={"cusp": np.ones(m)} if kind == "fold" else {"1:2 resonance": np.ones(m)},
        points=points,
        ends=("edge", "edge"),
    )


def codimension_two(kind, a, b):
    return CodimensionTwo(kind, a, b, np.zeros(1), 0, "a test", "numbers")


def pictured(*curves, study=None):
    return curve_map(curves_dataset(curves, PLANE, ("e", "gap"), ("1", "m")), study)


def test_curves_have_the_colour_of_their_kind_and_the_axes_the_units_and_windows_of_the_user():
    [axes] = pictured(curve("fold", [0.2, 0.3]), curve("flip", [0.6, 0.9])).axes
    lines = {line.get_color(): line for line in axes.lines if np.isfinite(line.get_ydata()).sum() == 2}
    assert lines[SPECIAL["fold"][1]].get_xdata().tolist() == [0.2, 0.3]
    assert lines[SPECIAL["flip"][1]].get_ydata().tolist() == pytest.approx([1.0, 2.0])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("e [1]", "gap [mm]")
    assert axes.get_xlim() == (0.0, 1.0)
    assert axes.get_ylim() == pytest.approx((1.0, 2.0))


def test_a_curve_of_unstable_motion_is_dashed():
    [axes] = pictured(curve("fold", [0.2, 0.3], bounding=False)).axes
    [line] = [line for line in axes.lines if np.isfinite(line.get_ydata()).sum() == 2]
    assert line.is_dashed()
    assert "of unstable motion" in [text.get_text() for text in axes.get_legend().get_texts()]


def test_close_points_of_codimension_two_share_a_label_within_the_axes():
    points = (
        codimension_two("cusp", 0.9, 1.9e-3),
        codimension_two("fold-flip", 0.901, 1.9e-3),
        codimension_two("fold-grazing", 0.2, 1.2e-3),
    )
    [axes] = pictured(curve("fold", [0.2, 0.9], points)).axes
    assert sorted(text.get_text() for text in axes.texts) == ["cusp, fold-flip", "fold-grazing"]


def test_the_study_is_marked():
    [axes] = pictured(curve("fold", [0.2, 0.3]), study=(0.4, 1.5e-3)).axes
    [star] = [line for line in axes.lines if line.get_label() == "the study"]
    assert (star.get_xdata()[0], star.get_ydata()[0]) == pytest.approx((0.4, 1.5))


def test_curves_without_a_point_are_drawn_as_an_empty_plane():
    [axes] = pictured(curve("fold", [])).axes
    assert axes.get_xlim() == (0.0, 1.0)
