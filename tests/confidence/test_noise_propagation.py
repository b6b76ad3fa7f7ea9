"""Claims about the echo of measurement noise in the residuals."""

from dataclasses import dataclass

import numpy as np
import pytest
import xarray as xr

from calib.confidence.noise_propagation import UNSTATED_NOISE_SHARE, noise_draws
from calib.errors import CalibError
from calib.records import make
from calib.records.response import make_response


@dataclass(frozen=True)
class Reference:
    record: xr.Dataset


class Objective:
    """Residuals of two terms that look at the same displacement, the second at its mean."""

    def __init__(self, references, terms):
        self.references, self.terms = references, terms

    def residuals(self, records):
        difference = (records["a"].displacement - self.references["a"].record.displacement).values[0]
        return xr.DataArray(np.append(difference, difference.mean()), dims="residual")


def record(**more):
    time = np.arange(50.0)
    return make(time, ["mass"], {"displacement": np.sin(time)[None], **more})


def found(reference, seed=1, number=400):
    return noise_draws(Objective({"a": Reference(reference)}, ()), {"a": record()}, seed, number)


def test_the_echo_has_the_size_of_the_stated_uncertainty():
    noise = found(record(displacement_sigma=np.array([0.2])))
    assert noise.shape == (400, 51)
    assert np.std(noise[:, :-1]) == pytest.approx(0.2, rel=0.03)


def test_without_an_uncertainty_it_is_small():
    assert np.std(found(record())[:, :-1]) == pytest.approx(
        UNSTATED_NOISE_SHARE * np.std(np.sin(np.arange(50.0))), rel=0.03
    )


def test_terms_of_one_channel_echo_together():
    noise = found(record())
    np.testing.assert_allclose(noise[:, -1], noise[:, :-1].mean(axis=1), atol=1e-12)


def test_the_same_seed_gives_the_same_echo():
    np.testing.assert_array_equal(found(record(), 3, 2), found(record(), 3, 2))


def test_frequencies_of_a_stated_uncertainty_are_drawn_with_the_parts():
    frequency = np.linspace(8.0, 12.0, 30)
    response = make_response(frequency, ["mass"], np.ones((1, 30)), 1.0, "N", frequency_sigma=np.full(30, 0.02))

    class Swept(Objective):
        def residuals(self, records):
            return self.references["a"].record["frequency"].rename(point="residual")

    draws = noise_draws(Swept({"a": Reference(response)}, ()), {}, 1, 200)
    assert np.std(draws) == pytest.approx(0.02, rel=0.05)


def test_a_draw_without_what_a_term_compares_is_left_out():
    class Fragile(Objective):
        def residuals(self, records):
            found = super().residuals(records)
            if found.values[-1] > 0.0:
                raise CalibError("the reference shows no impact")
            return found if found.values[-1] > -0.001 else found[:-1]

    draws = noise_draws(Fragile({"a": Reference(record())}, ()), {"a": record()}, 1, 100)
    assert 0 < len(draws) < 60
    assert draws.shape[1] == 51
