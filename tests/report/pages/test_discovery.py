"""The chapter of a search for a force law: force, formula, those that were compared."""

import re
from dataclasses import replace

import numpy as np
import pytest

from calib.diagnosis.discovery.artifacts import DISCOVERY, read_discovery
from calib.diagnosis.discovery.document import (
    DiscoveryResult,
    FormulaResult,
    FunctionResult,
    HistoryResult,
    NumberResult,
    TrialResult,
)
from calib.errors import CalibError
from calib.report.pages.discovery import discovery_chapter
from calib.report.pages.page import render
from calib.study import CalibrationResult

X = np.linspace(-4e-3, 5e-3, 41)
VALUES = {"stiffness": 4000.0}
CALIBRATED = CalibrationResult(values=VALUES)
CUBIC = FormulaResult(
    "c1 x^3", r"c_{1}\,x^{3}", (NumberResult("c1", -3.1e6, 4.2e4, "1/(m^2 s^2)", "coefficient of x^3"),), 812.4, 830.1,
    814.4, True, True, True, True,
)  # fmt: skip
QUINTIC = FormulaResult("c1 x^5", r"c_{1}\,x^{5}", CUBIC.numbers, 901.0, 935.0, 903.0, False, False, False, False)
FORCE = -3.1e6 * X**3
FUNCTION = FunctionResult(
    ("displacement",), ("m",), ((-4e-3, 5e-3),), (tuple(X),), tuple(FORCE), tuple(np.full(41, 0.01)), (True,) * 41,
    tuple(FORCE),
)  # fmt: skip
FOUND = DiscoveryResult(
    "found", "a force on mass is missing: a function of displacement explains 98% of the excess chi-square", "mass",
    ("displacement",), (FUNCTION,), (0.11, 0.01), 0.98, ("soft", "hard"), (1900.0, 830.1),
    ("a multiple of the displacement",), trials=(TrialResult("mass", "function of displacement", 811.0, 831.0, 4.3),),
    formulas=(CUBIC, QUINTIC), values=VALUES, simulations=410, seconds=12.0,
)  # fmt: skip


def words(text):
    text = re.sub(r"<svg.*?</svg>|<style.*?</style>", " ", text, flags=re.S)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", text)).replace("\u00a0", " ")


def test_the_force_stands_in_the_page_with_its_formula_and_those_it_was_compared_with(periodic, undrawn):
    page = words(render(periodic.study, [], {}, CALIBRATED, discovery=FOUND))
    assert "A force on mass is missing: a function of displacement explains 98% of the excess chi-square." in page
    assert "The records visit displacement −4 mm to 5 mm. Beyond, the force is an extrapolation." in page
    assert "Not determined beside the calibrated parameters: a multiple of the displacement." in page
    assert "Force per unit mass: c1 x^3" in page
    assert "c1 x^3 1 812.4 830.1 +0.0 tie, front" in page
    assert "410 simulations in 12 s" in page


def test_the_force_is_drawn():
    found = discovery_chapter(FOUND, CALIBRATED)
    assert (found.tone, found.stale, found.force.name) == ("good", False, "found-force")
    assert (found.formula.name, found.formula.caption) == (
        "found-formula", f"Force per unit mass: c1 x^3. In LaTeX: {CUBIC.latex}"
    )  # fmt: skip
    assert [row.first for row in found.formulas] == [True, False]


def test_without_a_formula_the_page_says_so():
    alone = replace(FOUND, formulas=(replace(CUBIC, predicts=False),))
    found = discovery_chapter(alone, CALIBRATED)
    assert not found.formula
    assert "No formula of the dictionary predicts as well as the free function." in found.points


def test_a_law_of_history_stands_in_the_place_of_the_formula(periodic, undrawn):
    numbers = (NumberResult("dahl_force", 0.0888, 0.0004, "m/s^2", "friction per unit mass when it slips"),)
    laws = (HistoryResult("presliding", "-dahl_force z", numbers, 791.0, 808.0),
            HistoryResult("bouc_wen", "-F z", numbers, 790.0, 814.0))  # fmt: skip
    of_history = replace(FOUND, verdict="history_dependent", summary="it depends on history", histories=laws)
    found = discovery_chapter(of_history, CALIBRATED)
    assert (found.tone, found.formula) == ("mind", None)
    assert found.force.caption.endswith(
        "It is only what comes closest to a force that depends on the history of the motion."
    )
    assert not any("dictionary" in point for point in found.points)
    page = words(render(periodic.study, [], {}, CALIBRATED, discovery=of_history))
    assert "history dependent It depends on history." in page
    assert "Force per unit mass, presliding: -dahl_force z." in page
    assert "dahl_force 0.08880 0.00040 m/s² friction per unit mass when it slips" in page
    assert "presliding 791 808 bouc_wen 790 814" in page


@pytest.mark.parametrize(
    ("verdict", "tone"), [("nothing", "good"), ("undetermined", "mind"), ("not_diagnosable", "mind")]
)
def test_without_a_force_there_is_the_reason_alone(verdict, tone):
    found = discovery_chapter(DiscoveryResult(verdict, "no free force is significant"), CALIBRATED)
    assert (found.tone, found.headline) == (tone, "No free force is significant.")
    assert (found.force, found.points, found.formulas) == (None, (), ())


def test_a_search_of_earlier_values_is_out_of_date():
    assert discovery_chapter(FOUND, CalibrationResult(values={"stiffness": 4100.0})).stale


def test_a_file_that_describes_no_search_is_refused(tmp_path):
    assert read_discovery(tmp_path) is None
    (tmp_path / DISCOVERY).write_text("[]")
    with pytest.raises(CalibError, match="delete it and run `calib discover` again"):
        read_discovery(tmp_path)
