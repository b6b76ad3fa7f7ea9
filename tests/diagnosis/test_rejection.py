"""How much a further cause, or a pair in the place of one, has to explain; when noise counts as another one."""

from types import SimpleNamespace

import numpy as np
import pytest

from calib.diagnosis.compromise import _explains_more
from calib.diagnosis.forward import _differs
from calib.diagnosis.noise import STATED, Noise
from calib.diagnosis.rejection import is_negligible

SAMPLES, WHOLE = 5000, 100_000.0  # residuals, and the excess chi-square of the calibrated model
STD = float(np.sqrt(2.0 * SAMPLES))
EVIDENCE = SimpleNamespace(parts=(), counted=lambda: float(SAMPLES))


def fit(excess):
    """Stand in for a model of no parameter that leaves this excess chi-square."""
    return SimpleNamespace(
        chi2=SAMPLES + excess, columns=np.zeros((0, 0)), nuisances=np.zeros((0, 0)), residual=np.zeros(0),
        point=SimpleNamespace(simulated={}),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("left", "reduction", "negligible"),
    [
        (0.05 * WHOLE, 0.009 * WHOLE, True),  # of the whole misfit
        (0.05 * WHOLE, 0.012 * WHOLE, True),  # not of the whole, but less than a quarter of what is left
        (0.05 * WHOLE, 0.02 * WHOLE, False),
        (2.0 * STD, 0.012 * WHOLE, False),  # what is left is no more than noise: the rest is no yardstick
    ],
)
def test_a_further_cause_explains_a_share_of_the_whole_and_of_what_is_left(left, reduction, negligible):
    assert is_negligible(EVIDENCE, fit(WHOLE), fit(left), reduction) is negligible


@pytest.mark.parametrize(
    ("left", "left_by_pair", "more"),
    [
        (900.0, 100.0, False),  # 0.8 % of the misfit: it corrects the form of the cause that explains the rest
        (3000.0, 0.0, True),
        (3000.0, 2500.0, False),
        (3000.0, 1200.0, False),  # 1.5 times what it leaves itself
        (3000.0, 900.0, True),
        (50.0, 45.0, False),  # a tie in AIC
    ],
)
def test_a_pair_takes_the_place_of_a_cause_only_where_it_explains_more_than_a_negligible_part(left, left_by_pair, more):
    cause = SimpleNamespace(aic_penalty=2.0)
    pair = [(cause, ()), (cause, ())], fit(left_by_pair)
    assert _explains_more(EVIDENCE, fit(WHOLE), [(cause, ())], fit(left), pair) is more


@pytest.mark.parametrize(
    ("sigma", "ar", "differs"),
    [(1.0, [0.9], False), (1.01, [0.9], False), (1.05, [0.9], True), (1.0, [0.2], True), (1.0, [-0.9], True)],
)
def test_noise_is_another_where_its_level_or_its_autocorrelation_is(sigma, ar, differs):
    def evidence(sigma, ar):
        noise = (Noise(sigma, np.array(ar), STATED),)
        return SimpleNamespace(parts=[SimpleNamespace(noise=noise, clock_share=0.0)])

    assert _differs(evidence(sigma, ar), evidence(1.0, [0.9])) is differs
