"""Chi-square of a fit beyond that of noise."""

from types import SimpleNamespace

import numpy as np
import pytest

from calib.diagnosis.excess import excess_chi2

RESIDUAL = np.array([[1.0, -1.0, 4.0, 1.0], [1.0, 1.0, 3.0, -1.0]])  # (row, n)


def excess(trust, is_swept=True):
    part = SimpleNamespace(name="levels", is_swept=is_swept, rows=("in_phase", "quadrature"))
    evidence = SimpleNamespace(parts=(part,), of=lambda name: slice(0, RESIDUAL.size), counted=lambda: RESIDUAL.size)
    point = SimpleNamespace(simulated={"levels": SimpleNamespace(trust=np.array(trust))})
    residual, none = RESIDUAL.ravel(), np.zeros((RESIDUAL.size, 0))
    return excess_chi2(
        evidence,
        SimpleNamespace(chi2=float(residual @ residual), residual=residual, columns=none, nuisances=none, point=point),
    )


def test_what_a_gross_error_leaves_of_chi_square_is_no_excess():
    assert excess([1.0, 1.0, 0.4, 1.0]) == pytest.approx(0.0)
    assert excess([1.0, 1.0, 1.0, 1.0]) == pytest.approx(23.0)  # 16 + 9 less the two that noise would have


def test_a_point_in_doubt_that_is_near_takes_nothing_from_the_excess():
    assert excess([1.0, 0.9, 1.0, 1.0]) == pytest.approx(23.0)


def test_next_to_an_impact_of_a_record_over_time_residuals_count():
    assert excess([1.0, 1.0, 0.0, 1.0], is_swept=False) == pytest.approx(23.0)
