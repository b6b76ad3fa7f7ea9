"""From a record to numbers with a unit."""

import pickle

import numpy as np
import pytest
from phase_loops import FREQUENCY, SIGMA, chaotic, clapping, noisy

from calib.errors import CalibError
from calib.features import (
    Amplitude,
    ContactTime,
    ForceBalance,
    Harmonics,
    ImpactPhase,
    PhaseCurve,
    PoincareSpread,
    TimeHistory,
)
from calib.records import make
from calib.records.cycles import phase_curve

FEATURES = [PhaseCurve(), TimeHistory(), Amplitude(), Harmonics(), ImpactPhase(), ContactTime(), PoincareSpread()]
REFERENCE = clapping(contacts=False)


def distance(feature, simulated, reference=REFERENCE):
    """Root mean square of the scaled difference (body, channel)."""
    measured = feature(reference)
    scaled = (feature(simulated) - measured) / feature.scale(measured)
    return np.sqrt((scaled**2).mean([d for d in scaled.dims if d not in ("body", "channel")]))


@pytest.mark.parametrize("feature", FEATURES, ids=lambda feature: feature.name)
def test_a_feature_gives_numbers_by_body_and_channel(feature):
    values = feature(REFERENCE)
    assert values.dims[:2] == ("body", "channel")
    assert list(values.body.values) == ["beam", "layer"]
    only = feature(REFERENCE, ["layer"])
    assert np.array_equal(only, values.sel(body=["layer"]), equal_nan=True)


@pytest.mark.parametrize("feature", [*FEATURES, ForceBalance(cutoff=100.0)], ids=lambda feature: feature.name)
def test_a_feature_pickles(feature):
    assert pickle.loads(pickle.dumps(feature)) == feature


@pytest.mark.parametrize("feature", [f for f in FEATURES if hasattr(f, "values")], ids=lambda feature: feature.name)
def test_bare_values_are_the_labelled_ones(feature):
    assert np.array_equal(feature.values(REFERENCE, ["layer"]), feature(REFERENCE, ["layer"]))


def test_features_do_not_change_the_record():
    before = REFERENCE.copy(deep=True)
    for feature in FEATURES:
        feature(REFERENCE)
    assert REFERENCE.identical(before)


@pytest.mark.parametrize("feature", [TimeHistory(), Amplitude(), Harmonics(number=20)], ids=lambda f: f.name)
def test_ten_per_cent_too_large_scores_a_tenth(feature):
    smooth = clapping(jump=0.0)
    assert distance(feature, clapping(jump=0.0, size=1.1), smooth).values == pytest.approx(0.1, rel=1e-3)


def test_a_loop_ten_per_cent_larger_about_its_centre_scores_a_tenth():
    centred = REFERENCE.copy(deep=True)
    for channel in ("displacement", "velocity"):
        loop = phase_curve(REFERENCE)[channel]
        centred[channel] = REFERENCE[channel] + 0.1 * (REFERENCE[channel] - loop.mean("phase"))
    assert distance(PhaseCurve(), centred).values == pytest.approx(0.1)


def test_identical_loops_score_zero():
    assert (distance(PhaseCurve(), REFERENCE) == 0.0).all()


def test_a_loop_of_displacement_alone_can_be_compared():
    one = REFERENCE.drop_vars("velocity")
    assert list(PhaseCurve(channels=["displacement"])(one).channel.values) == ["displacement"]
    with pytest.raises(CalibError, match="velocity"):
        PhaseCurve()(one)


def test_two_periods_show_what_one_hides():
    single, double = clapping(subharmonic=0.2, contacts=False), clapping(contacts=False)
    hidden = distance(PhaseCurve(), double, single).sel(body="layer").max()
    shown = distance(PhaseCurve(periods=2), double, single).sel(body="layer").max()
    assert shown > 0.15 > 2 * hidden


def test_the_uncertainty_of_a_loop_is_the_record_s():
    record = noisy(clapping())
    sigma = PhaseCurve().uncertainty(record, ["layer"])
    assert sigma.sel(channel="velocity").values == pytest.approx(SIGMA["velocity"] / np.sqrt(6))
    assert PhaseCurve().uncertainty(REFERENCE) is None
    assert TimeHistory().uncertainty(record).sel(channel="velocity").values == pytest.approx(SIGMA["velocity"])


def test_time_history_takes_the_channels_there_are():
    assert list(TimeHistory()(REFERENCE.drop_vars("velocity")).channel.values) == ["displacement"]
    with pytest.raises(CalibError, match="neither"):
        TimeHistory()(REFERENCE.drop_vars(["velocity", "displacement"]))
    with pytest.raises(CalibError, match="force"):
        TimeHistory(channels="force")(REFERENCE)


def test_the_amplitude_of_an_excitation_without_period_is_that_of_the_record():
    record = clapping()
    del record.attrs["frequency"]
    found = Amplitude()(record, ["beam"]).sel(channel="displacement")
    assert float(found[0]) == pytest.approx(2e-3)


def test_harmonics_are_those_of_the_drive_s_cosine():
    found = Harmonics(number=2)(clapping(start=0.3 / FREQUENCY, jump=0.0), ["beam"]).sel(channel="displacement")
    assert found.values[0] == pytest.approx(np.array([[2e-3, 0.0], [0.0, 0.0]]), abs=1e-12)
    with pytest.raises(CalibError, match="from 1 on"):
        Harmonics(number=0)


def test_impact_phase_is_a_number_only_where_there_is_an_impact():
    phase = ImpactPhase()(clapping(impact=0.4213))
    assert np.isnan(phase.sel(body="beam")).all()
    assert float(phase.sel(body="layer")[0]) == pytest.approx(0.4213, abs=1e-3)
    assert ImpactPhase().scale(phase) == pytest.approx(1 / (2 * np.pi))


def test_contact_time_of_an_instantaneous_impact_is_a_few_samples():
    assert 0.0 < float(ContactTime()(REFERENCE, ["layer"])[0, 0]) < 3 / 400


def test_the_spread_of_a_section_grows_with_the_disorder():
    spread = {
        w: float(PoincareSpread()(clapping(section=64, wander=chaotic(64)[:w] if w else None))[1, 0]) for w in (0, 64)
    }
    assert spread[0] < 1e-12
    assert spread[64] > 0.02


def forced(rate=1000.0, extra=0.0):
    time = np.arange(4000) / rate
    force = 20.0 * np.sin(2 * np.pi * 2.0 * time) + extra * np.sin(2 * np.pi * 200.0 * time)
    return make(time, ["mass"], {"force": force[None]})


def test_force_balance_is_the_relative_rms_of_the_force():
    larger = forced().assign(force=1.1 * forced()["force"])
    assert distance(ForceBalance(), larger, forced()).values == pytest.approx(0.1)


def test_the_filter_of_a_force_balance_takes_away_what_is_above_its_cutoff():
    assert distance(ForceBalance(), forced(extra=5.0), forced()) > 0.2
    assert distance(ForceBalance(cutoff=50.0), forced(extra=5.0), forced()) < 0.01
    assert ForceBalance(cutoff=50.0, decimate=25)(forced()).sizes["time"] == 160


def test_a_filter_that_cannot_be_is_refused():
    with pytest.raises(CalibError, match="half the sampling rate"):
        ForceBalance(cutoff=600.0)(forced())
    uneven = forced().isel(time=[0, 1, 3, *range(4, 400)])
    with pytest.raises(CalibError, match="uniform"):
        ForceBalance(cutoff=50.0)(uneven)
    with pytest.raises(CalibError, match="decimate"):
        ForceBalance(decimate=0)
