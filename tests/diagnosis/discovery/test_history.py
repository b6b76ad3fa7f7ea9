"""Laws with internal states beside a free force: their order, and when they surpass it."""

from types import SimpleNamespace

import numpy as np
import pytest

from calib.diagnosis.discovery.history import HistoryTrial, ordered
from calib.diagnosis.discovery.left_out import LeftOutMisfit

COUNT = 1000  # residuals


def left_out(deviance):
    return LeftOutMisfit(("a", "b"), np.array([0.5, 0.5]) * deviance, COUNT)


def law(name, deviance, chi2=1000.0, numbers=2):
    parameters = [SimpleNamespace(name=f"{name}_{k}") for k in range(numbers)]
    candidate = SimpleNamespace(name=name, effect=SimpleNamespace(parameters=parameters))
    fit = SimpleNamespace(chi2=chi2, names=("stiffness", *(p.name for p in parameters)))
    return HistoryTrial(candidate, fit, None if deviance is None else left_out(deviance))


def free_force(deviance=1100.0, chi2=1000.0, effective_parameters=12.0):
    fitted = SimpleNamespace(dispersion=1.0, effective_parameters=effective_parameters)
    return SimpleNamespace(chi2=chi2, fitted=fitted, left_out=left_out(deviance))


def formula(deviance, numbers):
    return SimpleNamespace(left_out=left_out(deviance), formula=SimpleNamespace(length=numbers))


def test_of_laws_that_tie_the_one_with_the_fewest_numbers_is_first():
    laws = [
        law("bouc_wen", 1010.0, numbers=4),
        law("iwan", 1030.0, numbers=1),
        law("presliding", 1012.0),
        law("x", None),
    ]
    assert [own.name for own in ordered(laws)] == ["presliding", "bouc_wen", "iwan", "x"]
    assert ordered([]) == ()


@pytest.mark.parametrize(
    ("own", "other", "surpasses"),
    [
        (law("presliding", 1010.0), None, True),
        (law("presliding", 1097.0), None, False),  # a tie
        (law("presliding", 1010.0), formula(1008.0, 2), False),  # a formula of as many numbers predicts as well
        (law("presliding", 1010.0), formula(1008.0, 6), True),  # one of more numbers
        (law("presliding", 1010.0), formula(990.0, 6), False),  # one that predicts better
        (law("presliding", 1010.0, chi2=1050.0), None, False),  # it fits all records worse
        (law("presliding", None), None, False),
    ],
)
def test_a_law_surpasses_a_free_force_that_it_predicts_and_fits_better_than(own, other, surpasses):
    assert own.surpasses(free_force(), other) is surpasses
