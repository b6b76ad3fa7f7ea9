"""A model refitted to all records at once, against least squares over all of them."""

from types import SimpleNamespace

import numpy as np
import pytest

from calib.diagnosis.joint_misfit import joint_misfit

SIZES, TRUE = {"a": 60, "b": 40}, np.array([0.3, -2.0])
FIT = SimpleNamespace(names=("k", "c"), value=lambda name: {"k": 5.0, "c": 7.0}[name])


def evidence(name, seed, swept=False):
    """One record of noise and a change by both parameters, with a nuisance and a value of its own."""
    rng, n = np.random.default_rng(seed), SIZES[name]
    columns, nuisance = rng.standard_normal((n, 3)), rng.standard_normal((n, 1))
    residual = columns @ [*TRUE, 4.0] + 9.0 * nuisance[:, 0] + rng.standard_normal(n)
    own = SimpleNamespace(
        parts=(SimpleNamespace(name=name, is_swept=swept, rows=("in_phase", "quadrature")),), names=[name],
        residual=lambda _: residual, tangents=lambda _: nuisance, counted=lambda: float(n), of=lambda _: slice(0, n),
    )  # fmt: skip
    return own, {name: SimpleNamespace(trust=np.ones(n // 2))}, {name: columns}


def test_all_records_share_the_parameters_and_each_has_its_own_nuisances():
    several = [evidence("a", 0), evidence("b", 1)]
    found = joint_misfit(FIT, several)
    blocks, n = [], sum(SIZES.values())
    for k, (own, _, columns) in enumerate(several):
        [all_columns], alone = columns.values(), np.zeros((len(own.residual(None)), 4))
        alone[:, 2 * k : 2 * k + 2] = np.column_stack([all_columns[:, 2], own.tangents(None)])
        blocks.append(np.column_stack([all_columns[:, :2], alone]))
    matrix, residual = np.vstack(blocks), np.concatenate([own.residual(None) for own, _, _ in several])
    moves, [square], *_ = np.linalg.lstsq(matrix, residual, rcond=None)
    assert found.excess_chi2 == pytest.approx(square - (n - 6), abs=1e-8)
    assert found.chi2_std == pytest.approx(np.sqrt(2.0 * n))
    assert list(found.values.values()) == pytest.approx(np.array([5.0, 7.0]) + moves[:2])
    assert not found.is_significant


def test_records_that_need_other_values_leave_a_misfit():
    (own, simulated, columns), other = evidence("a", 0), evidence("b", 1)
    shifted = SimpleNamespace(**{**vars(own), "residual": lambda _: own.residual(None) + 3.0 * columns["a"][:, 0]})
    assert joint_misfit(FIT, [(shifted, simulated, columns), other]).is_significant
    assert not joint_misfit(FIT, [(shifted, simulated, columns)]).is_significant


def test_a_gross_error_of_a_response_is_no_misfit_of_the_model():
    own, simulated, columns = evidence("a", 0, swept=True)
    jump = 12.0 * (np.arange(SIZES["a"]) == 7)
    gross = SimpleNamespace(**{**vars(own), "residual": lambda _: own.residual(None) + jump})
    assert joint_misfit(FIT, [(gross, simulated, columns), evidence("b", 1)]).is_significant
    simulated["a"].trust[7] = 0.3
    assert not joint_misfit(FIT, [(gross, simulated, columns), evidence("b", 1)]).is_significant


def test_a_record_without_derivatives_leaves_the_joint_misfit_unknown():
    own, simulated, _ = evidence("b", 1)
    assert joint_misfit(FIT, [evidence("a", 0), (own, simulated, {})]) is None
