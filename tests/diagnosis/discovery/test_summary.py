"""The verdict of a search for a force law in words."""

from types import SimpleNamespace

import numpy as np

from calib.diagnosis.discovery.left_out import LeftOutMisfit
from calib.diagnosis.discovery.summary import explained_share, summary_of
from calib.diagnosis.discovery.trial import OF_DISPLACEMENT, OF_STATE, OF_VELOCITY, ForceTrial


def trial(arguments, deviance, name="mass"):
    place = SimpleNamespace(name=name, preposition="on", in_words=str)
    fitted = SimpleNamespace(fit=SimpleNamespace(chi2=100.0), effective_parameters=len(arguments), dispersion=1.0)
    return ForceTrial(place, arguments, fitted, LeftOutMisfit(("r",), np.array([deviance]), 100))


def test_models_that_tie_and_a_misfit_that_is_left_are_told():
    chosen, tied = trial((OF_DISPLACEMENT,), 90.0), trial((OF_DISPLACEMENT, OF_VELOCITY), 88.0)
    elsewhere = trial((OF_VELOCITY,), 89.0, "layer")
    told = summary_of(
        chosen, [chosen, tied, elsewhere], [elsewhere.place], (400.0, 100.0), SimpleNamespace(deviance=500.0), 1.5
    )
    assert told == (
        "a force on mass is missing: a function of displacement explains 75% of the excess chi-square; predictive "
        "deviance of left-out records 500 to 90. It predicts as well as a function of displacement + function of "
        "velocity. A force on layer predicts as well. It leaves 1.5 times the noise: it is the closest "
        "to what is missing, not all of it"
    )
    alone = summary_of(chosen, [chosen], [], (400.0, -3.0), SimpleNamespace(deviance=500.0), None)
    assert alone.endswith("100% of the excess chi-square; predictive deviance of left-out records 500 to 90")
    nearly = summary_of(chosen, [chosen], [], (1.27e7, 13469.0), SimpleNamespace(deviance=500.0), 2.78)
    assert "explains 99.9% of the excess" in nearly
    slight = summary_of(chosen, [chosen], [], None, SimpleNamespace(deviance=500.0), None)
    assert slight == (
        "a force on mass is missing: a function of displacement lowers the predictive deviance of left-out records "
        "from 500 to 90, though the misfit of the calibrated model as a whole is within its noise"
    )


def test_of_a_model_that_predicts_better_and_fits_no_better_it_is_not_said_that_the_simpler_one_predicts_as_well():
    chosen, both = trial((OF_VELOCITY,), 8.4e5), trial((OF_DISPLACEMENT, OF_VELOCITY), 7.7e5)
    surface = trial((OF_STATE,), 7.9e5)
    told = summary_of(chosen, [chosen, both, surface], [], (400.0, 100.0), SimpleNamespace(deviance=1e7), None)
    assert "as well as" not in told
    assert told.endswith(
        "A function of displacement + function of velocity predicts better, but fits all records no better, so that it "
        "is not taken. A surface over displacement and velocity predicts better, but is less simple, so that it is not "
        "taken"
    )


def test_a_surface_is_less_simple_than_a_sum():
    one, both, surface = (trial(own, 1.0) for own in ((OF_VELOCITY,), (OF_DISPLACEMENT, OF_VELOCITY), (OF_STATE,)))
    assert one.complexity < both.complexity < surface.complexity
    assert explained_share(0.0, 5.0) < 0.0


def test_a_further_function_has_to_fit_better_too():
    def fitted(arguments, chi2, effective, name="mass"):
        fit = SimpleNamespace(fit=SimpleNamespace(chi2=chi2), effective_parameters=effective, dispersion=1.0)
        return ForceTrial(SimpleNamespace(name=name), arguments, fit, None)

    one = fitted((OF_DISPLACEMENT,), 1000.0, 5.0)
    both = (OF_DISPLACEMENT, OF_VELOCITY)
    assert one.stands_for(fitted(both, 999.0, 6.0))  # by 1 - 2
    assert one.stands_for(fitted(both, 990.0, 7.5))  # by 10 - 5
    assert not one.stands_for(fitted(both, 988.0, 7.5))  # by 12 - 5
    assert not one.stands_for(fitted(both, 1000.0, 6.0, "layer"))
    assert not one.stands_for(fitted((OF_VELOCITY,), 1000.0, 5.0))
    assert not fitted(both, 1000.0, 6.0).stands_for(one)
