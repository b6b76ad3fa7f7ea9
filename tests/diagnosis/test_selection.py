"""Which explanations are told from each other."""

from types import SimpleNamespace

import numpy as np
import pytest

from calib.diagnosis.selection import _rivals

SIZE, LIMIT = 1000.0, 3.4
FITTER = SimpleNamespace(evidence=SimpleNamespace(counted=lambda: SIZE))


def suspect(name, parameters, drop, left):
    """Stand in for a suspect that lowers a sum of squares by `drop` to `left`."""
    fit = SimpleNamespace(square=left, columns=np.zeros((0, 0)), nuisances=np.zeros((0, 0)))
    return SimpleNamespace(name=name, parameters=parameters, price=2.0 * parameters, drop=drop, fit=fit)


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
    assert [s.name for s in _rivals(FITTER, [other, best], LIMIT)] == ["best", "other"][: 1 + alike]
