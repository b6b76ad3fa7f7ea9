"""Figures are drawn, rasterised, digitised, and compared with what was drawn by the objective's own distance.

All thirty of them, of which the tests take every third:

    CALIB_FIGURES=30 pytest -m slow tests/digitise/test_round_trip.py -n 0
"""

import os

import numpy as np
import pytest
from digitise.figures import cases, misses, motion, round_trip

from calib.errors import CalibError

CASES = cases()
FIGURES = int(os.environ.get("CALIB_FIGURES", "10"))


@pytest.mark.parametrize("number", [0, 14])
def test_a_figure_comes_back(number, tmp_path):
    digitised, _, (score, aligned) = round_trip(CASES[number], tmp_path, number)
    assert score.cost < 0.01
    assert np.abs(misses(digitised.record, aligned, "layer")).mean() < 3.0
    assert digitised.record.attrs["returns_after"] == 1


@pytest.mark.slow
def test_figures_come_back(tmp_path, capsys):
    near, apart, refused = 0, [], []
    for number, case in list(enumerate(CASES))[:: len(CASES) // FIGURES]:
        try:
            digitised, _, (score, aligned) = round_trip(case, tmp_path, number)
        except CalibError as error:
            refused.append(str(error))
            continue
        near += score.cost < 0.01
        apart.append(np.abs(misses(digitised.record, aligned, "layer")).ravel())
        with capsys.disabled():
            covered = (apart[-1] < 2.0).mean()
            print(f"\nfigure {number}: distance {score.cost:.4f}, {100.0 * covered:.0f} % within 2 s.u.", end="")
    assert near >= FIGURES - max(1, FIGURES // 15)
    assert all("curve 'layer'" in said for said in refused)
    assert 0.90 < (np.concatenate(apart) < 2.0).mean() < 0.99


@pytest.mark.slow
def test_without_a_frequency_the_period_is_that_of_the_curve(tmp_path):
    digitised, drawn, _ = round_trip(CASES[19], tmp_path, frequency=False)
    assert digitised.record.attrs["frequency"] == pytest.approx(drawn.attrs["frequency"], rel=0.005)
    assert "no frequency" in digitised.record.attrs["warning"]


@pytest.mark.parametrize(
    ("name", "wanted"),
    [("dpi", {150, 300}), ("form", {"png", "jpg"}), ("grid", {True, False}), ("turn", {0.0, 1.0, -1.0})],
)
def test_the_cases_have_every_look_that_was_asked_for(name, wanted):
    assert {getattr(case.look, name) for case in CASES} == wanted


def test_the_cases_are_what_was_asked_for():
    looks = [case.look for case in CASES]
    assert len(CASES) == 30
    assert sum(look.colours[0] == look.colours[1] for look in looks) == 10
    assert sum(case.beam is not None for case in CASES) >= 20
    assert motion(CASES[0]).sizes["time"] == 4000
