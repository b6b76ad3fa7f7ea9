"""Chi-square of a fit beyond that of noise."""

from types import SimpleNamespace

import numpy as np
import pytest

from calib.diagnosis.excess import excess_chi2, excess_over

RESIDUAL = np.array([[1.0, -1.0, 4.0, 1.0], [1.0, 1.0, 3.0, -1.0]])  # (row, n)


def excess(trust, is_swept=True, of=excess_chi2):
    part = SimpleNamespace(name="levels", is_swept=is_swept, rows=("in_phase", "quadrature"))
    evidence = SimpleNamespace(parts=(part,), of=lambda name: slice(0, RESIDUAL.size), counted=lambda: RESIDUAL.size)
    point = SimpleNamespace(simulated={"levels": SimpleNamespace(trust=np.array(trust))})
    residual, none = RESIDUAL.ravel(), np.zeros((RESIDUAL.size, 0))
    chi2 = float(residual @ residual)
    fit = SimpleNamespace(
        chi2=chi2, residual_over=lambda _: residual, residual=residual, columns=none, nuisances=none, point=point
    )
    return of(evidence, fit)


@pytest.mark.parametrize("of", [excess_chi2, excess_over])
def test_what_a_gross_error_leaves_of_chi_square_is_no_excess(of):
    assert excess([1.0, 1.0, 0.4, 1.0], of=of) == pytest.approx(0.0)
    assert excess([1.0, 1.0, 1.0, 1.0], of=of) == pytest.approx(23.0)  # 16 + 9 less the two that noise would have


def test_a_point_in_doubt_that_is_near_takes_nothing_from_the_excess():
    assert excess([1.0, 0.9, 1.0, 1.0]) == pytest.approx(23.0)


def test_next_to_an_impact_of_a_record_over_time_residuals_count():
    assert excess([1.0, 1.0, 0.0, 1.0], is_swept=False) == pytest.approx(23.0)
