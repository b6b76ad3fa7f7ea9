"""When causes may be a compromise between two others."""

from types import SimpleNamespace

import numpy as np
import pytest

from calib.diagnosis.compromise import may_be_compromise
from calib.diagnosis.criteria import CRITERIA

SAMPLES = 5000  # residuals
STD = float(np.sqrt(2.0 * SAMPLES))  # of the chi-square of noise
SIGNIFICANT, DOMINANT = CRITERIA.significance_std * STD, CRITERIA.dominant_excess * STD**2  # excess chi-squares
FITTER = SimpleNamespace(evidence=SimpleNamespace(parts=(), counted=lambda: float(SAMPLES)))


def state(excess, rejected=None, causes=()):
    """Stand in for a selection that leaves this excess chi-square; a suspect was rejected: name and reduction."""
    final = SimpleNamespace(
        chi2=SAMPLES + excess, columns=np.zeros((0, 0)), nuisances=np.zeros((0, 0)), residual=np.zeros(0),
        point=SimpleNamespace(simulated={}),
    )  # fmt: skip
    suspect = None if rejected is None else SimpleNamespace(name=rejected[0], chi2_reduction=rejected[1])
    return SimpleNamespace(
        final=final, null=final, known={}, causes=causes, names=causes, rounds=[SimpleNamespace(rejected=suspect)]
    )


@pytest.mark.parametrize(
    ("excess", "rejected", "possible"),
    [
        (0.9 * SIGNIFICANT, None, False),
        (1.1 * SIGNIFICANT, None, True),
        (0.9 * DOMINANT, None, True),
        (1.1 * DOMINANT, None, False),
        (1.1 * DOMINANT, ("drag", 0.2 * DOMINANT), True),  # the rejected one explains what is too much
        (1.1 * DOMINANT, ("drag", 0.05 * DOMINANT), False),
    ],
)
def test_without_a_cause_a_misfit_may_be_of_two_unless_it_dominates_beside_the_rejected_one(excess, rejected, possible):
    assert may_be_compromise(FITTER, state(excess, rejected), ()) is possible


@pytest.mark.parametrize(
    ("excess", "rejected", "pair", "possible"),
    [
        (0.9 * SIGNIFICANT, None, False, False),
        (1.1 * SIGNIFICANT, None, False, True),
        (0.9 * SIGNIFICANT, None, True, True),
        (0.9 * SIGNIFICANT, ("drag", 40.0), False, True),
        (0.9 * SIGNIFICANT, ("lag", 40.0), False, False),  # it is the cause itself
        (2.0 * DOMINANT, None, False, True),
    ],
)
def test_a_cause_may_stand_for_two_where_more_is_left_or_another_or_a_pair_shows(
    excess, rejected, pair, possible, monkeypatch
):
    monkeypatch.setattr("calib.diagnosis.compromise.is_pair_significant", lambda *given: pair)
    assert may_be_compromise(FITTER, state(excess, rejected, ("lag",)), ()) is possible
