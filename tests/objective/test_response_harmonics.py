"""Distance of measured responses with higher harmonics from simulated curves."""

import numpy as np
import pytest

from calib.confidence.noise_propagation import noise_draws
from calib.features.frequency_response import ResponseDistance
from calib.objective import Objective, Reference, Term
from calib.objective.misfit import compared_rows
from calib.records.compared_response import compared_harmonics
from calib.records.excitation import Excitation
from calib.records.held_response import at_one_level
from calib.records.response import UNKNOWN_PHASE, complex_harmonics, make_response, modulus, parts_of

FORCE = Excitation("mass", "force", frequency=1.0, amplitude=1.0)
SIGMA, FREQUENCY_SIGMA = 0.01, 1e-4  # m, Hz
MEASURED, FINE = np.linspace(1.0, 2.0, 31), np.linspace(0.9, 2.1, 400)  # Hz


def harmonics(frequency):
    """Complex amplitudes (order, body, n) of two bodies  [m]."""
    first = 1.0 / (2.0 - frequency**2 + 0.5j * frequency)
    return np.array([[own, 0.5 * own] for own in (first, 0.2 * first**2, 0.05j * first**3)])


def response(frequency, own, **more):
    return make_response(
        frequency, ["mass", "tip"], own[0], 1.0, "N", place="mass", quantity="force", higher={2: own[1], 3: own[2]},
        **more,
    )  # fmt: skip


def simulated(factors=(1.0, 1.0, 1.0), turn=0.0):
    orders = np.arange(1, 4)
    factor = np.array(factors) * np.exp(1j * turn * orders)
    own = response(FINE, harmonics(FINE) * factor[:, None, None])
    return own.assign(piece=("point", np.zeros(FINE.size)))


def objective(record, *bodies):
    return Objective({"a": Reference("a", record, excitation=FORCE)}, [Term(ResponseDistance(), bodies or None)])


def stated(own, **more):
    shape = own.shape[1:]
    sigma = {"sigma": np.full(shape, SIGMA), "higher_sigma": {3: np.full(shape, 0.1 * SIGMA)}}
    return response(MEASURED, own, frequency_sigma=np.full(MEASURED.size, FREQUENCY_SIGMA), **sigma, **more)


def test_curves_through_all_harmonics_are_at_no_distance():
    compared = objective(stated(harmonics(MEASURED)))
    assert compared({"a": simulated()}).cost < 1e-5
    assert compared({"a": simulated((1.0, 1.3, 1.0))}).cost > 0.01
    np.testing.assert_allclose(complex_harmonics(compared.aligned("a", simulated())), harmonics(MEASURED), atol=1e-5)


def test_rounding_in_place_of_a_harmonic_that_a_model_lacks_leaves_the_others_where_they_are():
    own, rng = simulated((1.0, 0.0, 0.0)), np.random.default_rng(1)
    for name in parts_of(own)[2:]:
        own[name] = own[name] + 1e-17 * rng.standard_normal(own[name].shape)
    aligned = complex_harmonics(
        objective(stated(harmonics(MEASURED) * np.array([1.0, 0.0, 0.0])[:, None, None])).aligned("a", own)
    )
    np.testing.assert_allclose(aligned[0], harmonics(MEASURED)[0], atol=1e-5)


@pytest.mark.parametrize("factors", [(1.02, 1.02, 1.02), (1.02, 1.0, 1.0)])
def test_a_response_that_is_too_large_scores_as_one_of_the_first_harmonic_does(factors):
    record = stated(harmonics(MEASURED))
    first = record.drop_vars([name for name in record.data_vars if name[-1] in "23" or "3" in name])
    assert parts_of(first) == ("in_phase", "quadrature")
    found = simulated(factors)
    alone = objective(first)({"a": found.drop_vars([part for part in parts_of(found) if part[-1] in "23"])}).cost
    whole = objective(record)({"a": found}).cost
    assert alone == pytest.approx(0.02 / np.sqrt(3.0), rel=0.25)
    assert whole == pytest.approx(alone, rel=0.25)


def test_residuals_in_standard_uncertainties_have_unit_variance():
    rng, exact = np.random.default_rng(5), harmonics(MEASURED)
    squares = []
    for _ in range(20):
        noise = rng.standard_normal(exact.shape) + 1j * rng.standard_normal(exact.shape)
        noise *= SIGMA * np.array([1.0, 1.0, 0.1])[:, None, None]
        off = MEASURED + FREQUENCY_SIGMA * rng.standard_normal(MEASURED.size)
        record = stated(exact + noise).assign(frequency=("point", off, {"units": "Hz"}))
        compared = objective(record)
        left = compared.compared("a", simulated())
        own = compared.references["a"].compared
        squares.append([np.mean((own[part] - left[part]).values ** 2) for part in parts_of(record)])
    np.testing.assert_allclose(np.mean(squares, axis=0), 1.0, atol=0.12)


def test_amplitudes_alone_of_harmonics_are_compared_without_phases():
    measured = modulus(stated(harmonics(MEASURED), phases=UNKNOWN_PHASE))
    compared = objective(measured)
    assert compared({"a": simulated(turn=1.0)}).cost < 1e-4
    assert compared({"a": simulated((1.0, 1.3, 1.0))}).cost > 0.01
    rows = compared_rows(compared.references["a"], compared.terms)
    assert [channel for body, channel in rows if body == "mass"] == ["in_phase", "in_phase_2", "in_phase_3"]


def test_one_body_of_several_is_compared():
    own = harmonics(MEASURED)
    own[:, 0] *= 5.0
    assert objective(stated(own), "tip")({"a": simulated()}).cost < 1e-5
    assert objective(stated(own), "mass")({"a": simulated()}).cost > 0.1


def test_at_a_held_amplitude_harmonics_are_compared_whatever_the_phase_of_the_force():
    """The same motion under a force that lags: only the level of the body that was held differs."""
    own = harmonics(MEASURED)
    needed = 1.0 / np.abs(own[0, 0])
    record = at_one_level(stated(own * needed).assign(level=("point", needed, {"units": "N"})), "mass")
    compared, level = objective(record), float(record.level[0])
    plain, late = (simulated((level,) * 3, turn) for turn in (0.0, 0.05))
    assert compared({"a": plain}).cost < 1e-4
    parts = compared.aligned("a", plain), compared.aligned("a", late)
    plain, late = (compared_harmonics(own)[:, 0] for own in parts)
    np.testing.assert_allclose(late[1:], plain[1:], atol=0.1 * SIGMA)
    assert np.abs(late[0] - plain[0]).max() > SIGMA


def test_noise_of_each_harmonic_is_drawn_by_its_own_uncertainty():
    record = stated(harmonics(MEASURED))

    class Parts:
        def __init__(self, references, terms):
            self.references, self.terms = references, terms

        def residuals(self, _):
            return self.references["a"].record["in_phase_3"].isel(body=0).rename(point="residual")

    draws = noise_draws(Parts({"a": Reference("a", record, excitation=FORCE)}, ()), {}, 1, 100)
    assert np.std(draws) == pytest.approx(0.1 * SIGMA, rel=0.1)


def test_the_rms_of_a_harmonic_is_a_feature_less_what_noise_adds_to_it():
    rng, exact = np.random.default_rng(8), harmonics(MEASURED)
    exact[2] *= 0.01
    noise = 0.3 * SIGMA * (rng.standard_normal(exact.shape) + 1j * rng.standard_normal(exact.shape))
    sigma = np.full(exact.shape[1:], 0.3 * SIGMA)
    record = response(MEASURED, exact + noise, sigma=sigma)
    judged = objective(record, "mass").judged({"a": simulated((1.0, 0.0, 0.0))})[1]
    features = {feature.label: feature for feature in judged if feature.body == "mass"}
    second, third = (features[f"rms harmonic {order} (1 N, up)"] for order in (2, 3))
    assert second.measured == pytest.approx(np.sqrt(np.mean(np.abs(exact[1, 0]) ** 2)), rel=0.05)
    assert second.simulated == 0.0
    assert second.tolerance < 0.1 * second.measured, "a model without it does not reach it"
    assert third.measured < third.tolerance + np.sqrt(np.mean(np.abs(exact[2, 0]) ** 2))
    alike = objective(record, "mass").judged({"a": simulated((1.0, 1.0, 0.01))})[1]
    for feature in (one for one in alike if one.label.startswith("rms")):
        assert abs(feature.simulated - feature.measured) < 1.5 * feature.tolerance


def test_no_feature_is_read_from_a_point_that_may_be_a_gross_error():
    own = harmonics(MEASURED)
    spoilt, wrong = own.copy(), MEASURED.size - 6
    spoilt[:, :, wrong] *= 50.0
    [plain, out] = (objective(stated(one), "mass").judged({"a": simulated()})[1] for one in (own, spoilt))
    before, after = ({feature.label: feature.measured for feature in features} for features in (plain, out))
    assert before.keys() == after.keys()
    assert after["largest amplitude (1 N, up)"] == pytest.approx(before["largest amplitude (1 N, up)"])
    assert after["rms harmonic 2 (1 N, up)"] == pytest.approx(before["rms harmonic 2 (1 N, up)"], rel=0.1)
