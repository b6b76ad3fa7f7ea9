"""The result of a search for a force law as JSON."""

import json
from dataclasses import replace

import pytest

from calib.diagnosis.discovery.document import (
    DiscoveryResult,
    FormulaResult,
    FunctionResult,
    HistoryResult,
    NumberResult,
    TrialResult,
)
from calib.diagnosis.document import GateResult

FUNCTION = FunctionResult(
    ("velocity",),
    ("m/s",),
    ((-0.3, 0.4),),
    ((-0.3, 0.0, 0.4),),
    (2.0, 0.0, -3.0),
    (0.1, 0.2, 0.1),
    (True,) * 3,
    (2.1, 0.0, -3.1),
)
NUMBER = NumberResult("c1", -9.0, None, "1/m", "coefficient of v |v|")
FORMULA = FormulaResult("c1 v |v|", r"c_{1}\,v\,|v|", (NUMBER,), 501.0, None, 503.0, True, True, True, False)
FOUND = DiscoveryResult(
    "found", "a force", "mass", ("velocity",), (FUNCTION,), (1.5, 0.1), 0.97, ("a", "b"), (900.0, 500.0),
    ("a multiple of the velocity",), (), (TrialResult("mass", "function of velocity", 500.0, None, 6.5),), (FORMULA,),
    (GateResult("noise", True, "known"),), {"stiffness": 4e3}, {"stiffness": 3.9e3}, 120, 3.5,
)  # fmt: skip
DAHL = HistoryResult("presliding", "-F z", (NumberResult("F", 0.09, 0.01, "m/s^2", "friction"),), 480.0, 490.0)
OF_HISTORY = replace(FOUND, verdict="history_dependent", histories=(DAHL,))


@pytest.mark.parametrize("result", [FOUND, OF_HISTORY, DiscoveryResult("nothing", "no free force is significant")])
def test_a_result_is_read_as_it_was_written(result):
    assert DiscoveryResult.from_dict(json.loads(json.dumps(result.as_dict(), allow_nan=False))) == result


def test_the_formula_is_the_first_where_it_predicts():
    assert FOUND.formula == FORMULA
    assert FORMULA.equation == "c1 v |v|; c1 = -9 1/m"
    assert replace(FOUND, formulas=(replace(FORMULA, predicts=False),)).formula is None


def test_a_force_that_depends_on_history_has_no_formula_of_the_state():
    assert OF_HISTORY.depends_on_history
    assert not FOUND.depends_on_history
    assert OF_HISTORY.formula is None
    assert DAHL.text == "presliding: -F z; F = 0.09 m/s^2"


def test_what_is_no_result_is_refused():
    with pytest.raises(ValueError, match="verdict"):
        DiscoveryResult.from_dict({"summary": "nothing"})
