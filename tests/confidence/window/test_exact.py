"""Faces of a window by continuation: curves over the slices, and the emulated boundary held against them."""

import numpy as np
import pytest
import xarray as xr
from echo_study import FREQUENCY, TRUTH, write_study
from map_study import write_map_study

from calib.confidence.window.exact import ExactCurve, checked_faces, exact_curves, kind_boundary, with_curves
from calib.confidence.window.words import exact_in_words
from calib.study_file import load

GRAZING, MISFIT = "grazing: an impact appears", "misfit of a"
WALL, CEILING = 0.6, 0.7  # of the window: the kind of motion changes at the wall, a misfit leaves its tolerance above


def slices(nodes=41):
    """Arrays of a window in two parameters that ends at a slanted wall of grazing and at a ceiling of misfit."""
    axis = np.linspace(0.0, 1.0, nodes)
    x, y = np.meshgrid(axis, axis)
    margins = np.stack([wall(y) - x, CEILING - y], axis=-1)
    met = np.clip(0.5 + 5.0 * margins, 0.0, 1.0)
    return xr.Dataset(
        {
            "slice_probability": (("pair", "row", "column"), met.min(axis=-1)[None]),
            "slice_mechanism": (("pair", "row", "column"), margins.argmin(axis=-1)[None]),
            "node_u": (("parameter", "node"), np.stack([axis, axis])),
        },
        coords={"parameter": ["p", "q"], "slice_mechanism_label": ("region_margin", [GRAZING, MISFIT])},
    )


def wall(y):
    return WALL + 0.2 * (y - 0.5)


def curve(offset):
    y = np.linspace(0.0, 1.0, 7)
    return ExactCurve((0, 1), "grazing", np.column_stack([wall(y) + offset, y]), np.ones(7, dtype=bool))


def test_the_boundary_of_the_kind_is_where_the_kind_changes_and_not_where_a_misfit_leaves_its_tolerance():
    boundary = kind_boundary(slices(), 0, (0, 1))
    np.testing.assert_allclose(boundary[:, 0], wall(boundary[:, 1]), atol=1e-9)
    assert boundary[:, 1].max() <= CEILING + 1.0 / 40
    assert np.ptp(boundary[:, 1]) > 0.6


@pytest.mark.parametrize("offset", [0.0, 0.03])
def test_the_distance_from_the_curve_is_stated(offset):
    [faces] = checked_faces(slices(), [curve(offset)], {})
    across = offset / np.hypot(1.0, 0.2)  # the wall is slanted; at the edges of the slice the foot is cut off
    assert across - 1e-6 <= faces.distance <= offset + 1e-6
    assert "grazing followed" in exact_in_words(faces)


def test_a_slice_without_a_curve_says_why():
    [faces] = checked_faces(slices(), [], {(0, 1): "the motion does not settle"})
    assert faces.distance is None
    assert exact_in_words(faces) == "over p and q: no curve (the motion does not settle)"


def test_curves_stand_in_the_arrays_of_the_window():
    dataset = with_curves(slices(), [curve(0.0), curve(0.1)])
    assert dataset.exact_kind.values.tolist() == ["grazing", "grazing"]
    np.testing.assert_array_equal(dataset.exact_u.values[dataset.exact_curve_of_step.values == 1], curve(0.1).u)
    assert with_curves(slices(), []).sizes["exact_curve"] == 0


def test_the_flips_of_henon_s_map_are_followed_over_a_slice(tmp_path):
    """Its fixed point flips at a = 3 (1 - b)^2 / 4; a is times the frequency in units of 10 Hz here."""
    fixed = f"fixed = {{ gain = {TRUTH['gain']} }}\n[windows]\na = {{ low = 0.0, high = 0.8 }}\n"
    path = write_map_study(
        tmp_path, ("[windows]", fixed + "b = { low = 0.1, high = 0.5, scale = \"log\" }"),
        ("gain = { low = 0.5, high = 2.0, scale = \"log\" }", ""),
    )  # fmt: skip
    study = load(path).study
    centre = study.space.point({"a": 0.2, "b": 0.3, "harmonic": 0.0})
    told = list[tuple[int, int]]()
    curves, reasons = exact_curves(study, centre, np.zeros(3), np.ones(3), lambda *done: told.append(done))
    assert told == [(1, 3), (2, 3), (3, 3)]
    own = [curve for curve in curves if curve.pair == (0, 1)]
    assert [curve.kind for curve in own] == ["flip"]
    values = [study.space.values(np.array([*u, 0.5])) for u in own[0].u]
    a, b = np.array([[value["a"], value["b"]] for value in values]).T
    np.testing.assert_allclose(a * FREQUENCY / 10.0, 0.75 * (1.0 - b) ** 2, atol=1e-6)
    assert np.ptp(own[0].u[:, 1]) > 0.9  # it crosses the slice
    assert reasons == {}  # over b alone the motion ends too


def test_a_slice_that_cannot_be_followed_leaves_the_window_as_it_is(tmp_path):
    study = load(write_study(tmp_path)).study
    curves, reasons = exact_curves(study, np.full(2, 0.5), np.zeros(2), np.ones(2))
    assert curves == []
    assert "period map" in reasons[0, 1]
