"""Which explanations are distinguishable."""

from types import SimpleNamespace

import numpy as np
import pytest

from calib.diagnosis.search import rival_suspects

SIZE, LIMIT = 1000.0, 3.4
EVIDENCE = SimpleNamespace(counted=lambda: SIZE)


def suspect(name, parameters, reduction, chi2):
    """Stand in for a suspect that reduces chi-square by `reduction` to `chi2`."""
    fit = SimpleNamespace(chi2=chi2, columns=np.zeros((0, 0)), nuisances=np.zeros((0, 0)))
    penalty = 2.0 * parameters
    return SimpleNamespace(
        name=name, parameter_count=parameters, aic_penalty=penalty, chi2_reduction=reduction, fit=fit
    )


@pytest.mark.parametrize(
    ("parameters", "behind", "left", "alike"),
    [
        (2, 5.0, SIZE, True),
        (2, 7.0, SIZE, False),  # two models of one size, as far apart as data have to tell them
        (1, 11.0, SIZE, True),  # the best has a parameter more, which is below the threshold: 3.4^2
        (1, 12.0, SIZE, False),
        (3, 3.0, SIZE, True),
        (3, 5.0, SIZE, False),
        (2, 50.0, 10.0 * SIZE, True),  # where much is left that nothing explains
        (1, 110.0, 10.0 * SIZE, True),
    ],
)
def test_a_rival_is_alike_within_what_its_parameters_and_the_noise_allow(parameters, behind, left, alike):
    best, other = suspect("best", 2, 200.0, left), suspect("other", parameters, 200.0 - behind, left)
    assert [s.name for s in rival_suspects(EVIDENCE, [other, best], LIMIT)] == ["best", "other"][: 1 + alike]
