"""A record cut by the period of its excitation."""

from pathlib import Path

import numpy as np
import pytest
from phase_loops import FREQUENCY, SIGMA, chaotic, clapping, noisy
from scipy.signal import lfilter

from calib.errors import CalibError
from calib.records import make, read
from calib.records.cycles import (
    averaged_at_impacts,
    gaps_in,
    harmonics,
    impact,
    impacts_per_period,
    kind_of_motion,
    phase_curve,
    poincare,
)

PERIOD = 1.0 / FREQUENCY
MEASURED = Path(__file__).parents[3] / "experiments_ref"


def size(record, channel="velocity"):
    return float(np.abs(record[channel]).max())


# --- the closed loop


def test_the_loop_of_a_periodic_motion_is_any_of_its_cycles():
    record = clapping(contacts=False)
    loop = phase_curve(record)
    assert loop.phase.values[[0, 1]] == pytest.approx([0.0, 1.0 / 400])
    assert np.allclose(loop.displacement, record.displacement[:, :400], atol=1e-15)
    assert loop.attrs["cycles"] == 6


@pytest.mark.parametrize("start", [0.0137 * PERIOD, 0.5 * PERIOD, 17.3 * PERIOD, -2.2 * PERIOD])
@pytest.mark.parametrize("samples", [None, 400])
def test_the_loop_does_not_depend_on_when_the_record_starts(start, samples):
    loop = phase_curve(clapping(start=start, jump=0.0), samples=samples)
    turns = 2.0 * np.pi * loop.phase.values
    assert np.abs(loop.displacement.values[0] - 2e-3 * np.cos(turns)).max() < 1e-4 * 2e-3


def test_samples_that_do_not_divide_the_period_are_interpolated():
    time = np.arange(1000) * PERIOD / 173.37
    record = make(time, ["mass"], {"displacement": np.cos(2 * np.pi * FREQUENCY * time)[None]}, frequency=FREQUENCY)
    loop = phase_curve(record)
    assert loop.sizes["phase"] == 173
    assert np.abs(loop.displacement.values[0] - np.cos(2 * np.pi * loop.phase.values)).max() < 2e-3
    assert np.diff(loop.phase).min() > 0.0


def test_one_period_is_enough_and_less_is_refused():
    assert phase_curve(clapping(periods=1)).attrs["cycles"] == 1
    with pytest.raises(CalibError, match="at least 1 period"):
        phase_curve(clapping(periods=1).isel(time=slice(0, 300)))
    with pytest.raises(CalibError, match="at least 2 period"):
        phase_curve(clapping(periods=1), periods=2)


def test_a_loop_of_two_periods_keeps_the_halves_of_a_period_2_motion():
    record = clapping(subharmonic=0.2, contacts=False)
    two, one = phase_curve(record, periods=2), phase_curve(record)
    assert two.sizes["phase"] == 800
    assert np.allclose(two.displacement, record.displacement[:, :800])
    assert np.abs(one.displacement - record.displacement[:, :400].values).max() > 1e-4


def test_uncertainty_of_the_loop_comes_from_the_record_and_falls_with_the_cycles():
    loop = phase_curve(noisy(clapping()))
    assert np.allclose(loop.displacement_sigma, SIGMA["displacement"] / np.sqrt(6))


def test_without_a_stated_uncertainty_the_spread_between_cycles_is_taken():
    loop = phase_curve(noisy(clapping(), stated=False))
    found = float(np.sqrt((loop.velocity_sigma.values**2).mean()))
    assert found == pytest.approx(SIGMA["velocity"] / np.sqrt(6), rel=0.05)


def test_a_record_without_period_has_no_loop():
    record = clapping()
    del record.attrs["frequency"]
    with pytest.raises(CalibError, match="no period"):
        phase_curve(record)


def test_velocity_at_an_impact_follows_its_instant_within_a_sample():
    moved = [phase_curve(clapping(impact=(120 + share) / 400)).velocity.values[1] for share in np.linspace(0.1, 0.9, 9)]
    steps = np.diff(moved, axis=0)[:, 120:122]  # the two samples around it
    assert np.allclose(steps.sum(axis=1), -0.4 * 0.1, atol=1e-3)  # the jump times a tenth of a sample, every time


def test_averaging_leaves_a_velocity_without_jump_alone():
    record = clapping(jump=0.0, contacts=False)
    time, velocity = record.time.values, record.velocity.values
    averaged = averaged_at_impacts(time, velocity, np.array([0.3012, 1.7]) * PERIOD, True)
    assert np.abs(averaged - velocity).max() < 2e-4 * size(record)


# --- once per period


def test_the_section_of_a_period_1_motion_is_one_point():
    section = poincare(clapping(), phase=0.25)
    assert section.displacement.dims == ("body", "cycle")
    assert section.displacement.std("cycle").max() < 1e-12
    assert section.displacement.values[0, 0] == pytest.approx(0.0, abs=1e-9)


def test_the_section_that_a_record_brings_is_preferred():
    assert poincare(clapping(section=64)).sizes["cycle"] == 64


@pytest.mark.parametrize("lost", [0.3, 0.6, 2.4])
def test_the_section_has_no_point_inside_a_gap_in_time(lost):
    """A straight line across a gap of half a period misses the motion by its amplitude."""
    whole = clapping(contacts=False)
    turns = whole.time.values / PERIOD
    record = whole.isel(time=(turns < 1.9) | (turns > 1.9 + lost))
    section = poincare(record)
    missing = int(1.9 + lost) - 1
    assert section.sizes["cycle"] == 6 - missing
    np.testing.assert_allclose(section.displacement, poincare(whole).displacement[:, missing:], atol=1e-9)


def test_a_section_that_lies_in_gaps_alone_is_refused():
    whole = clapping(contacts=False)
    turns = whole.time.values / PERIOD
    gaps = whole.isel(time=np.abs((turns + 0.5) % 1.0 - 0.5) > 0.1)
    with pytest.raises(CalibError, match="in gaps alone"):
        poincare(gaps)


def test_a_clock_that_jitters_has_no_gaps():
    rng = np.random.default_rng(1)
    assert gaps_in(np.cumsum(rng.uniform(0.6, 1.4, 500))).size == 0
    assert gaps_in(np.cumsum(rng.exponential(1.0, 500))).size == 0
    time = np.arange(500.0)
    np.testing.assert_array_equal(gaps_in(np.delete(time, [50, 200, 201])), [[49.0, 51.0], [199.0, 202.0]])


def test_a_phase_is_a_share_of_the_period():
    with pytest.raises(CalibError, match=r"\[0, 1\)"):
        poincare(clapping(), phase=1.5)


# --- impacts


@pytest.mark.parametrize("at", [0.1, 0.30123, 0.7777, 0.999])
def test_the_impact_is_found_where_the_velocity_jumps(at):
    loop = phase_curve(clapping(impact=at))
    phase, change, contact = impact(loop.phase.values, loop.velocity.values[1])
    assert (phase - at + 0.5) % 1.0 - 0.5 == pytest.approx(0.0, abs=0.2 / 400)
    assert change == pytest.approx(0.4, rel=0.03)
    assert contact < 2.7 / 400


@pytest.mark.parametrize("body", [0, 1])
@pytest.mark.parametrize("record", [clapping(jump=0.0), noisy(clapping(jump=0.0))], ids=["exact", "noisy"])
def test_a_smooth_motion_shows_no_impact_with_and_without_noise(record, body):
    loop = phase_curve(record)
    np.testing.assert_array_equal(impact(loop.phase.values, loop.velocity.values[body]), [np.nan] * 3)


def test_contact_time_is_the_length_of_the_pulse():
    phase = np.arange(800) / 800
    force = np.exp(-0.5 * ((phase - 0.4) / 0.004) ** 2)
    velocity = np.cumsum(force) * 0.02 + 0.1 * np.sin(2 * np.pi * phase)
    velocity -= velocity[-1] * phase  # closed
    at, _, contact = impact(phase, velocity)
    assert at == pytest.approx(0.4, abs=1e-3)
    assert contact == pytest.approx(2 * 0.004 * np.sqrt(2 * np.log(5)), rel=0.1)  # where a Gaussian exceeds 0.2


def test_impacts_are_counted_where_the_record_tells_them():
    assert impacts_per_period(clapping()) == 1.0
    assert np.isnan(impacts_per_period(clapping(contacts=False)))


def test_harmonics_are_amplitude_and_phase():
    phase = np.arange(400) / 400
    loop = 3.0 * np.cos(2 * np.pi * phase + 0.3) + 0.5 * np.cos(6 * np.pi * phase - 1.0)
    assert harmonics(loop, 3) == pytest.approx([3.0 * np.exp(0.3j), 0.0, 0.5 * np.exp(-1.0j)], abs=1e-12)


# --- kind of motion


def test_a_motion_that_returns_every_period_is_called_period_1():
    motion = kind_of_motion(clapping(section=64))
    assert (motion.kind, motion.period, motion.impacts) == ("period-1", 1, 1.0)
    assert "1 impact" in motion.evidence


@pytest.mark.parametrize("share", [0.3, 0.01])
def test_a_period_two_motion_is_called_period_2(share):
    motion = kind_of_motion(clapping(section=64, subharmonic=share))
    assert (motion.kind, motion.period) == ("period-2", 2)


@pytest.mark.parametrize("n", [3, 5, 16])
def test_longer_periods_are_counted(n):
    motion = kind_of_motion(clapping(section=96, wander=chaotic(n)))
    assert (motion.kind, motion.period) == (f"period-{n}", n)


def test_a_chaotic_motion_is_called_irregular():
    motion = kind_of_motion(clapping(section=128, wander=chaotic(200)))
    assert (motion.kind, motion.period) == ("irregular", None)


def test_a_quasi_periodic_motion_is_called_irregular():
    wander = 1.0 + 0.05 * np.sin(2 * np.pi * 0.6180339887 * np.arange(128))
    assert kind_of_motion(clapping(section=128, wander=wander)).kind == "irregular"


@pytest.mark.parametrize("rate", [0.9, 0.97, 0.995])
def test_a_motion_that_still_settles_is_undecided_not_irregular(rate):
    motion = kind_of_motion(clapping(section=64, wander=1.0 + 0.5 * rate ** np.arange(64)))
    assert (motion.kind, motion.likely) == ("undecided", 1)


def test_a_motion_that_settles_by_turns_is_not_taken_for_period_2():
    motion = kind_of_motion(clapping(section=64, wander=1.0 + 0.2 * (-0.99) ** np.arange(64)))
    assert (motion.kind, motion.likely) == ("undecided", 1)


def test_no_contact_is_said_only_of_a_record_that_tells_its_contacts():
    assert kind_of_motion(clapping(jump=0.0, section=64)).kind == "no contact"
    assert kind_of_motion(clapping(jump=0.0, section=64)).period == 1
    assert kind_of_motion(clapping(jump=0.0, section=64, contacts=False)).kind == "period-1"


def test_lasting_contact_without_an_impact_is_contact():
    motion = kind_of_motion(clapping(jump=0.0, section=64).assign_attrs(contact_fraction=1.0))
    assert motion.kind == "period-1"
    assert "in contact without an impact" in motion.evidence


def test_an_excitation_without_period_has_no_kind():
    record = clapping()
    del record.attrs["frequency"]
    assert kind_of_motion(record).kind == "not periodic"


def test_a_short_measured_record_is_judged_by_its_noise():
    assert kind_of_motion(noisy(clapping())).kind == "period-1"
    assert kind_of_motion(noisy(clapping(), stated=False)).kind == "period-1"
    assert kind_of_motion(noisy(clapping(subharmonic=0.1))).kind == "period-2"


@pytest.mark.parametrize("samples", [29.52, 61.7, 153.74])
@pytest.mark.parametrize("stated", [True, False])
def test_a_record_of_a_free_running_clock_has_the_same_kind(samples, stated):
    free = {"samples": samples, "periods": 20}
    assert kind_of_motion(noisy(clapping(**free), stated=stated)).kind == "period-1"
    assert kind_of_motion(noisy(clapping(subharmonic=0.1, **free), stated=stated)).kind == "period-2"
    assert kind_of_motion(noisy(clapping(wander=chaotic(20), **free), stated=stated)).kind == "undecided"


@pytest.mark.parametrize("periods", [8, 60, 90])
@pytest.mark.parametrize("seed", range(5))
def test_the_memory_of_noise_that_is_not_stated_does_not_lengthen_the_period(periods, seed):
    """Noise that resonates is smooth: its second differences are a seventh of those of white noise."""

    def measured(**motion):
        record = clapping(samples=200, periods=periods, **motion)[["displacement", "velocity"]]
        rng = np.random.default_rng(seed)
        for channel in ("displacement", "velocity"):
            noise = lfilter([1.0], [1.0, -1.6, 0.8], rng.standard_normal(record[channel].shape))
            record[channel] = record[channel] + 0.005 * size(record, channel) / noise.std() * noise
        return record

    assert kind_of_motion(measured()).kind == "period-1"
    assert kind_of_motion(measured(subharmonic=0.1)).kind == "period-2"
    if periods >= 64:
        assert kind_of_motion(measured(wander=chaotic(200)[:periods])).kind == "irregular"


def test_samples_that_return_to_the_same_phases_do_not_lengthen_the_period():
    """After 11 periods of 20.82 samples the samples fall where they did: what rings faster than these is the same."""
    record = clapping(samples=20.82, periods=77)[["displacement", "velocity"]]
    phase = record.time.values * FREQUENCY % 1.0
    ringing = np.exp(-phase / 0.3) * np.sin(2.0 * np.pi * 23.0 * phase)
    record["velocity"] = record.velocity + 0.1 * size(record) * ringing
    assert kind_of_motion(noisy(record)).kind == "period-1"


@pytest.mark.parametrize("step", [0.01, 0.05, 0.25])
@pytest.mark.parametrize("subharmonic", [0.0, 0.6])
def test_the_steps_of_a_converter_do_not_lengthen_the_period(step, subharmonic):
    """After 13 periods of 116.23 samples the samples fall nearly where they did, on the same levels."""
    record = clapping(samples=116.23, periods=60, subharmonic=subharmonic)[["displacement", "velocity"]]
    for channel in ("displacement", "velocity"):
        size = step * np.abs(record[channel]).max(dim="time")
        record[channel] = size * np.round(record[channel] / size)
    assert kind_of_motion(record).kind == ("period-2" if subharmonic else "period-1")


@pytest.mark.parametrize("samples", [400, 61.7])
def test_a_closed_curve_says_itself_after_how_many_periods_it_returns_whatever_its_samples(samples):
    motion = kind_of_motion(noisy(clapping(samples=samples, periods=2)).assign_attrs(returns_after=2))
    assert (motion.kind, motion.period) == ("period-2", 2)


def test_a_short_record_is_never_called_irregular():
    motion = kind_of_motion(noisy(clapping(wander=chaotic(6))))
    assert motion.kind == "undecided"
    assert "too few" in motion.evidence
    assert kind_of_motion(noisy(clapping(periods=1))).kind == "undecided"


@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_a_motion_is_the_same_in_any_unit_of_length(factor):
    motion = kind_of_motion(clapping(size=factor, section=64, subharmonic=0.1))
    assert (motion.kind, motion.period, motion.impacts) == ("period-2", 2, 1.0)


def harmonic(periods, samples, subharmonic=0.0, seed=0):
    """Two harmonics and a subharmonic of the drive with noise of 0.2 %, without a stated uncertainty."""
    time = np.arange(periods * samples) * PERIOD / samples
    turns = 2.0 * np.pi * FREQUENCY * time
    values = np.cos(turns) + 0.3 * np.cos(2.0 * turns + 0.5) + subharmonic * np.cos(0.5 * turns + 0.2)
    return time, values + 0.002 * np.random.default_rng(seed).standard_normal(time.size)


def kind_of(time, values):
    return kind_of_motion(make(time, ["mass"], {"displacement": values[None]}, frequency=FREQUENCY))


@pytest.mark.parametrize("samples", [12, 20, 100])
@pytest.mark.parametrize("periods", [2, 3, 5])
def test_the_bend_of_coarsely_sampled_motion_is_no_noise(samples, periods):
    """At 20 samples a period second differences of the motion itself are 4 % of its amplitude."""
    for seed in range(5):
        assert kind_of(*harmonic(periods, samples, 0.0, seed)).kind == "period-1"
        assert kind_of(*harmonic(periods, samples, 0.05, seed)).kind == ("undecided" if periods < 4 else "period-2")


@pytest.mark.parametrize("subharmonic", [0.0, 0.15])
@pytest.mark.parametrize("spoil", ["spike", "drop-out", "both"])
def test_bad_samples_do_not_make_a_motion_irregular(subharmonic, spoil):
    time, values = harmonic(80, 100, subharmonic)
    plain = kind_of(time, values)
    if spoil != "drop-out":
        values[3333] += 3.0
    if spoil != "spike":
        values[5100:5110] = 0.0
    motion = kind_of(time, values)
    assert motion.kind == plain.kind == ("period-2" if subharmonic else "period-1")
    count, stretches = {"spike": (1, 1), "drop-out": (10, 1), "both": (11, 2)}[spoil]
    assert f"{count} samples in {stretches} stretch(es) are left out as bad" in motion.evidence
    assert "left out" not in plain.evidence


@pytest.mark.parametrize("frequency", [5.0, 33.0, 70.0])  # Hz
@pytest.mark.parametrize("lasting", [3.0, 10.0])  # cycles
def test_a_motion_that_is_thrown_off_its_orbit_for_cycles_stays_irregular(frequency, lasting):
    time, values = harmonic(80, 100)
    since = time - 40.3 * PERIOD
    thrown = 0.8 * np.exp(-since / (lasting * PERIOD)) * np.cos(2.0 * np.pi * frequency * since)
    assert kind_of(time, values + np.where(since > 0.0, thrown, 0.0)).kind == "irregular"


@pytest.mark.parametrize("rate", [3.8275, 3.8284, 3.9])
def test_chaotic_and_intermittent_motion_stay_irregular(rate):
    """The logistic map below its window of period 3: long stretches that return, and bursts."""
    factor, (time, values) = [0.5], harmonic(80, 100)
    for _ in range(300):
        factor.append(rate * factor[-1] * (1.0 - factor[-1]))
    assert kind_of(time, values * np.repeat(1.0 + 0.2 * np.array(factor[-80:]), 100)).kind == "irregular"


@pytest.mark.parametrize("folder", ["clapping_minimal", "clapping_beam"])
@pytest.mark.parametrize("name", ["clapping", "louder", "slower", "quiet"])
def test_the_reference_records_are_period_1(folder, name):
    assert kind_of_motion(read(MEASURED / folder / f"{name}.nc")).kind == "period-1"


def test_the_impact_of_the_reference_records_is_seen():
    loop = phase_curve(read(MEASURED / "clapping_minimal" / "clapping.nc"))
    phase, change, contact = impact(loop.phase.values, loop.velocity.sel(body="layer").values)
    assert (change, contact) == (pytest.approx(0.41, abs=0.02), pytest.approx(0.007, abs=0.002))
    quiet = phase_curve(read(MEASURED / "clapping_minimal" / "quiet.nc"))
    assert np.isnan(impact(quiet.phase.values, quiet.velocity.sel(body="layer").values)).all()
