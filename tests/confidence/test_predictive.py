"""Claims about what a posterior distribution predicts, where that is known in closed form."""

import numpy as np
import pytest
import xarray as xr
from scipy import stats

from calib.confidence.bands import predicted_bands, read_bands, write_bands
from calib.confidence.predictive import TAILS, PredictedChannel, PredictedLoop, mixture_quantiles
from calib.errors import CalibError
from calib.records import make
from calib.records.held_response import at_one_level, is_held
from calib.records.response import make_response

SAMPLES = 400
TIME = np.linspace(0.0, 1.0, SAMPLES, endpoint=False)


def normal_curves(spread, draws=2000):
    """Curves about a sine, whose levels are the quantiles of a normal distribution."""
    levels = stats.norm.ppf((np.arange(draws) + 0.5) / draws)
    return np.sin(2.0 * np.pi * TIME) + spread * levels[:, None]


@pytest.mark.slow
def test_bands_of_normal_draws_and_normal_noise_are_those_of_their_sum():
    own = PredictedChannel(normal_curves(0.3), 0.4)
    known = np.sin(2.0 * np.pi * TIME) + stats.norm.ppf(TAILS)[:, None] * 0.5
    assert own.sample_quantiles == pytest.approx(known, abs=2e-3)
    known = np.sin(2.0 * np.pi * TIME) + stats.norm.ppf(TAILS)[:, None] * 0.3
    assert own.curve_quantiles == pytest.approx(known, abs=2e-3)


def test_without_noise_a_sample_is_a_curve():
    centres = np.arange(1.0, 101.0)[:, None]
    assert mixture_quantiles(centres, np.zeros(1))[:, 0] == pytest.approx([3.0, 25.0, 75.0, 98.0], abs=0.6)


@pytest.mark.parametrize(("offset", "share"), [(0.0, 0.95), (0.6, 0.765), (3.0, 0.0)])
def test_the_share_of_samples_inside_is_that_of_the_normal_distribution(offset, share):
    own = PredictedChannel(normal_curves(0.3), 0.4)
    rng = np.random.default_rng(0)
    measured = np.array([own.median + offset + 0.5 * rng.standard_normal(SAMPLES) for _ in range(20)])
    counted = np.ones(SAMPLES, dtype=bool)
    assert np.mean([own.inside(one, counted) for one in measured]) == pytest.approx(share, abs=0.01)


@pytest.mark.slow
def test_a_band_is_as_wide_as_the_noise_of_each_sample():
    noise = np.where(TIME < 0.5, 0.05, 0.5)
    own, rng = PredictedChannel(normal_curves(0.0), noise), np.random.default_rng(0)
    measured = np.array([own.median + noise * rng.standard_normal(SAMPLES) for _ in range(20)])
    for part in (TIME < 0.5, TIME >= 0.5):
        assert np.mean([own.inside(one, part) for one in measured]) == pytest.approx(0.95, abs=0.01)
    assert np.diff(own.sample_quantiles[[0, -1]], axis=0)[0] == pytest.approx(2.0 * 1.96 * noise, rel=0.01)
    loop = PredictedLoop(own, PredictedChannel(normal_curves(0.0), 0.1))
    assert np.isfinite(loop.bands()[1]).all()


def test_samples_that_do_not_count_are_left_out():
    own = PredictedChannel(normal_curves(0.3), 0.4)
    measured = own.median + np.where(TIME < 0.5, 9.0, 0.0)
    assert own.inside(measured, TIME >= 0.5) == 1.0
    assert np.isnan(own.inside(measured, np.zeros(SAMPLES, dtype=bool)))


def test_draws_without_a_motion_do_not_count():
    curves = normal_curves(0.3, draws=200)
    own, part = PredictedChannel(curves, 0.4), np.where(np.arange(len(curves))[:, None] % 2, curves, np.nan)
    part[:, :10] = np.nan
    fewer = PredictedChannel(part, 0.4)
    for name in ("median", "curve_quantiles", "sample_quantiles"):
        found = getattr(fewer, name)
        assert np.isnan(found[..., :10]).all()
        assert found[..., 10:] == pytest.approx(getattr(own, name)[..., 10:], abs=0.04)
    counted = np.arange(SAMPLES) >= 10
    assert fewer.inside(own.median, counted) == 1.0


def circles(radius, phase):
    angle = 2.0 * np.pi * TIME + phase[:, None]
    return PredictedLoop(
        PredictedChannel(radius[:, None] * np.cos(angle), 0.0), PredictedChannel(-radius[:, None] * np.sin(angle), 0.0)
    )


def test_the_band_of_a_phase_curve_is_taken_across_it():
    levels = stats.norm.ppf((np.arange(500) + 0.5) / 500)
    of_curve, of_samples = circles(1.0 + 0.02 * levels, np.zeros(500)).bands()
    inner = slice(2, -2)  # the normal at the ends is that of a secant
    for ends in (of_curve, of_samples):
        radii = np.sort(np.hypot(*np.moveaxis(ends, 1, 0))[:, inner], axis=0)
        assert radii == pytest.approx(np.tile(1.0 + 0.02 * stats.norm.ppf(TAILS)[:, None], (1, SAMPLES - 4)), abs=1e-3)


def test_draws_that_differ_along_a_phase_curve_widen_its_band_to_second_order_only():
    levels = stats.norm.ppf((np.arange(500) + 0.5) / 500)
    of_curve, _ = circles(np.ones(500), 0.02 * levels).bands()
    width = np.hypot(*(of_curve[-1] - of_curve[0]))[2:-2]
    assert np.all(width < 0.1 * 0.02 * 2.0 * 1.96)


def test_noise_widens_a_phase_curve_by_its_part_across_it():
    still = PredictedLoop(*(PredictedChannel(np.tile(row, (30, 1)), s) for row, s in ((TIME, 0.5), (0.0 * TIME, 0.1))))
    _, of_samples = still.bands()
    assert of_samples[-1, 1] - of_samples[0, 1] == pytest.approx(np.full(SAMPLES, 2.0 * 1.96 * 0.1), rel=1e-3)


def some_bands(period):
    measured = make(TIME, ["a", "b"], {c: np.array([np.sin(TIME), np.cos(TIME)]) for c in ("displacement", "velocity")})
    channels = {
        row: PredictedChannel(normal_curves(0.1, draws=30), 0.2)
        for row in (("a", "displacement"), ("a", "velocity"), ("b", "velocity"))
    }
    return predicted_bands(measured, channels, np.ones(SAMPLES), period)


def test_bands_are_read_as_they_were_written(tmp_path):
    bands = {"bench": some_bands(0.5), "a/b": some_bands(None)}
    write_bands(bands, tmp_path)
    again = read_bands(tmp_path)
    assert list(again) == list(bands)
    for name, own in bands.items():
        assert set(again[name].variables) == set(own.variables)
        for variable in own.variables:
            np.testing.assert_array_equal(again[name][variable].values, own[variable].values)
        assert again[name].attrs == own.attrs
    assert list(again["bench"]["loop_body"].values) == ["a"]


@pytest.mark.parametrize("held", [False, True])
def test_bands_of_a_response_are_read_as_they_were_written(tmp_path, held):
    amplitude = np.array([[1.0, 2.0, 1.5]]) * 1e-3
    measured = make_response(np.array([3.0, 3.1, 3.2]), ["mass"], amplitude, np.array([0.2, 0.3, 0.2]), "N")
    if held:
        measured = at_one_level(measured, "mass")
    measured = measured.assign(amplitude=(("body", "point"), np.abs(measured.in_phase.values), {"units": "m"}))
    curves = measured.amplitude.values + 1e-5 * np.arange(30.0)[:, None]
    curves[:, 2] = np.nan
    channel = PredictedChannel(curves, np.array([1e-5, 2e-5, 1e-5]))
    bands = {"sweep": predicted_bands(measured, {("mass", "amplitude"): channel}, np.ones(3), None)}
    write_bands(bands, tmp_path)
    again = read_bands(tmp_path)["sweep"]
    xr.testing.assert_identical(again, bands["sweep"])
    assert is_held(again) == held
    assert again["noise"].values == pytest.approx(np.array([[1e-5, 2e-5, 1e-5]]))
    assert np.isnan(again["sample"].values[..., 2]).all()


def test_a_file_without_predictions_is_named(tmp_path):
    assert read_bands(tmp_path) == {}
    xr.Dataset({"x": ("n", [1.0])}).to_netcdf(tmp_path / "predictive.nc")
    with pytest.raises(CalibError, match=r"predictive.nc holds no predictions; .*--posterior"):
        read_bands(tmp_path)
