"""Shares and the remainder, as diagnosis.json and the page tell them."""

from types import SimpleNamespace

import numpy as np
import pytest

from calib.diagnosis.candidate import Candidate
from calib.diagnosis.search import Round
from calib.diagnosis.serialise import _excess_by_row, _joint_size, _round
from calib.diagnosis.verdict import explained
from calib.modelling.parameter import Parameter


@pytest.mark.parametrize(
    ("before", "above_noise", "share"),
    [
        ((), 0.5, 0.9),  # beside the calibrated model, over the samples on which its suspects are compared
        (("friction",), 0.5, 0.45),
        ((), -0.1, None),  # no misfit
        ((), 0.0, None),
    ],
)
def test_a_round_explains_a_share_of_what_the_noise_at_the_end_leaves_of_the_misfit(before, above_noise, share):
    base, chosen = SimpleNamespace(candidates=before), SimpleNamespace(name="drag", chi2_reduction=45.0)
    outcome = Round(base, (), 3.2, chosen, (), base_chi2=100.0, chi2_of_null=200.0)
    assert _round(outcome, above_noise).share == (share if share is None else pytest.approx(share))


@pytest.mark.parametrize(
    ("share", "words"),
    [
        (1.02, "all"), (0.9997, "more than 99.9 %"), (0.996, "99.6 %"), (0.88, "88 %"), (0.0026, "0.3 %"),
        (2e-5, "less than 0.1 %"), (0.0, "0 %"),
    ],
)  # fmt: skip
def test_no_share_is_rounded_to_all_or_to_nothing(share, words):
    assert explained(share) == words


def test_a_gross_error_is_no_remainder_of_its_row():
    residual = np.array([[1.0, -1.0, 1.0, 1.0], [1.0, 1.0, 9.0, -1.0]])
    part = SimpleNamespace(
        name="levels", is_swept=True, rows=("in_phase", "quadrature"), measured=residual, weight=np.ones((2, 4))
    )
    evidence = SimpleNamespace(parts=(part,), of=lambda name: slice(0, residual.size))

    def excess(trust):
        point = SimpleNamespace(simulated={"levels": SimpleNamespace(trust=np.array(trust))})
        return _excess_by_row(evidence, SimpleNamespace(residual=residual.ravel(), point=point))

    assert excess([1.0, 1.0, 1.0, 1.0]) == pytest.approx([0.0, 80.0])
    assert excess([1.0, 1.0, 0.3, 1.0]) == pytest.approx([0.0, 0.0])


def test_a_form_that_was_fitted_has_its_interval_beside_the_size():
    parameters = [Parameter(name, "1", 0.0, "made up") for name in ("drag", "exponent", "slip")]
    effect, held, scale = SimpleNamespace(parameters=parameters), {"exponent": 1.9, "slip": 1.0}, {"drag": 1.0}
    bounds = {"exponent": (0.5, 9.0), "slip": (0.1, 1.0)}
    candidate = Candidate(effect, ("drag",), held, scale | {"exponent": 1.0}, bounds=bounds, form=("exponent",))
    values, halves = {"drag": 2.4, "exponent": 1.9}, {"drag": 0.2, "exponent": 0.1}
    final = SimpleNamespace(value=values.get, half_width=lambda names: [halves[name] for name in names])
    selection = SimpleNamespace(final=final, bias_std=lambda fit, name: 0.3 * halves[name])
    joint = _joint_size(SimpleNamespace(candidate=candidate), selection)
    assert joint.size == values
    assert joint.interval["exponent"] == pytest.approx((1.8, 2.0))
    assert joint.limits["exponent"] == (0.5, 9.0)
    assert joint.bias["exponent"] == pytest.approx(0.03)
