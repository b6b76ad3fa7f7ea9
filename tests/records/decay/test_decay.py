"""Frequency and damping over amplitude, of decays that are known in closed form."""

import numpy as np
import pytest
from decays import bouncing, integrated, linear, noisy, record, rubbing
from scipy.integrate import solve_ivp

from calib.errors import CalibError
from calib.records.clipping import clipped_runs
from calib.records.decay import (
    amplitude_curves,
    analytic_curves,
    crossing_curves,
    release,
    smoothed_decay,
    smoothed_record,
)
from calib.records.decay.analytic_signal import analytic_signal
from calib.records.decay.smoother import _bases

TIME = np.arange(0.0, 40.0, 0.021)  # s: 31.7 samples a period of 1.5 Hz
OMEGA = 2.0 * np.pi * 1.5  # rad/s


def within(curves, name, expected, sigmas=4.0, share=0.0):
    """Whether a curve is `expected` (amplitude ->) within so many standard uncertainties, or a share of itself."""
    wanted = expected(curves.amplitude.values)
    off = np.abs(curves[name].values - wanted)
    return (off <= np.maximum(sigmas * curves[f"{name}_sigma"].values, share * np.abs(wanted))).all()


def clock(rng, count, rate):
    """Instants (count,) of a clock that jitters, or of a steady one."""
    steps = rng.uniform(0.6, 1.4, count) if rng.random() < 0.5 else np.ones(count)
    return rng.uniform(-5.0, 5.0) + np.cumsum(steps) / rate


@pytest.mark.slow
def test_the_stated_uncertainties_of_a_viscous_decay_cover_the_truth():
    rng, off = np.random.default_rng(5), []
    for seed in range(30):
        frequency, damping, per_period = rng.uniform(0.3, 30.0), 10.0 ** rng.uniform(-2.8, -1.4), rng.uniform(7.0, 40.0)
        time = clock(rng, int(rng.uniform(20.0, 80.0) * per_period), frequency * per_period)
        values = rng.uniform(-3.0, 3.0) + linear(time - time[0], frequency, damping, rng.uniform(0.0, 6.0))
        curves = amplitude_curves(smoothed_decay(time, noisy(values, 10.0 ** rng.uniform(-3.0, -1.6), seed)))
        off.append(
            [
                (curves.frequency.values - frequency) / curves.frequency_sigma.values,
                (curves.damping_ratio.values - damping) / curves.damping_ratio_sigma.values,
            ]
        )
    for z in np.moveaxis(off, 1, 0):
        assert 0.5 < np.sqrt(np.mean(z**2)) < 1.25
        assert np.mean(np.abs(z) < 2.0) > 0.9
        assert np.abs(z).max() < 5.0


@pytest.mark.parametrize("noise", [0.0, 0.005])
def test_dry_friction_damps_in_inverse_proportion_to_the_amplitude(noise):
    curves = amplitude_curves(smoothed_decay(TIME, noisy(rubbing(TIME, 1.5, 0.004), noise, 1)))
    assert within(curves, "damping_ratio", lambda a: 2.0 * 0.004 / (np.pi * a), share=0.06)
    large = curves.sel(point=curves.amplitude.values > 0.2)
    assert within(large, "frequency", lambda a: 1.5 + 0.0 * a, share=5e-4)


def test_a_motion_that_friction_has_stopped_is_left_out():
    time = np.arange(0.0, 60.0, 0.021)
    decay = smoothed_decay(time, noisy(rubbing(time, 1.5, 0.01), 0.002, 2))
    assert decay.cut == pytest.approx(0.5 / 1.5 * 50.0, rel=0.1)  # it stops after 50 half waves
    curves = amplitude_curves(decay)
    middle = curves.sel(point=curves.amplitude.values > 0.1)
    assert within(middle, "damping_ratio", lambda a: 2.0 * 0.01 / (np.pi * a), share=0.05)


def test_quadratic_drag_damps_in_proportion_to_the_amplitude():
    drag = 0.05
    values = noisy(integrated(TIME, lambda x, v: -(OMEGA**2) * x - drag * v * abs(v)), 0.01, 3)
    curves = amplitude_curves(smoothed_decay(TIME, values))
    assert within(curves, "damping_ratio", lambda a: 4.0 * drag * a / (3.0 * np.pi), share=0.05)
    assert within(curves, "frequency", lambda a: 1.5 + 0.0 * a)


@pytest.mark.parametrize("k3", [0.3, -0.2])
def test_a_cubic_spring_bends_the_backbone(k3):
    values = integrated(TIME, lambda x, v: -(OMEGA**2) * (x + k3 * x**3) - 0.02 * OMEGA * v)
    curves = amplitude_curves(smoothed_decay(TIME, noisy(values, 0.01, 4)))

    def backbone(a):  # of two harmonics, over the amplitude of the first
        return 1.5 * np.sqrt(1.0 + 0.75 * k3 * a**2 + 3.0 / 128.0 * (k3 * a**2) ** 2)

    assert within(curves, "frequency", backbone, share=2e-3)
    assert abs(curves.frequency.values[0] / 1.5 - 1.0) > 0.05


def test_impacts_raise_the_frequency_and_damp_by_the_restitution():
    values = noisy(bouncing(TIME, 1.5, 0.95), 0.005, 5)
    curves = amplitude_curves(smoothed_decay(TIME, values))
    rate = -np.log(0.95) / (2.0 * np.pi)
    assert within(curves, "frequency", lambda a: 3.0 + 0.0 * a, share=1e-3)
    assert within(curves, "damping_ratio", lambda a: rate / np.hypot(1.0, rate) + 0.0 * a, share=0.05)


def test_the_dominant_one_of_two_modes_is_followed_and_the_other_named():
    values = linear(TIME, 1.5, 0.01) + 0.3 * linear(TIME, 1.9, 0.008, 1.0)
    decay = smoothed_decay(TIME, noisy(values, 0.01, 6))
    curves = amplitude_curves(decay)
    assert decay.frame.companions == pytest.approx((1.9,), abs=0.02)
    assert curves.attrs["other_modes"] == f"{decay.frame.companions[0]:.4g}"
    assert within(curves, "frequency", lambda a: 1.5 + 0.0 * a, share=2e-3)
    assert within(curves, "damping_ratio", lambda a: 0.01 + 0.0 * a, share=0.05)


def test_an_offset_and_outliers_change_nothing():
    values = noisy(linear(TIME, 1.5, 0.01), 0.01, 7)
    plain = amplitude_curves(smoothed_decay(TIME, values))
    spoilt = values + 20.0
    spoilt[[100, 101, 350, 800]] += 3.0
    decay = smoothed_decay(TIME, spoilt)
    assert decay.outliers == pytest.approx(TIME[[100, 101, 350, 800]])
    curves = amplitude_curves(decay)
    assert curves.frequency.values == pytest.approx(
        plain.frequency.values, abs=2.0 * plain.frequency_sigma.max().item()
    )
    assert within(curves, "damping_ratio", lambda a: 0.01 + 0.0 * a)


def test_the_noise_is_found_and_the_tail_below_it_left_out():
    time = np.arange(0.0, 100.0, 0.021)
    decay = smoothed_decay(time, noisy(linear(time, 1.5, 0.01), 0.02, 8))
    assert decay.noise == pytest.approx(0.02, rel=0.1)
    floor = 5.0 * 0.02 * np.sqrt(2.0 / (1.0 / (1.5 * 0.021)))
    assert decay.floor == pytest.approx(floor, rel=0.1)
    assert decay.cut == pytest.approx(-np.log(floor) / (OMEGA * 0.01), rel=0.1)
    assert amplitude_curves(decay).attrs["cut"] == decay.cut


def test_a_stated_uncertainty_counts_where_it_exceeds_the_residual():
    values = noisy(linear(TIME, 1.5, 0.01), 0.002, 9)
    assert smoothed_record(record(TIME, values, sigma=0.01), "mass", "displacement").noise == 0.01
    assert smoothed_record(record(TIME, values, sigma=1e-4), "mass", "displacement").noise == pytest.approx(
        0.002, rel=0.1
    )


def test_zero_crossings_and_the_analytic_signal_agree_with_the_smoother():
    values = integrated(TIME, lambda x, v: -(OMEGA**2) * (x + 0.3 * x**3) - 0.02 * OMEGA * v)
    decay = smoothed_decay(TIME, noisy(values, 0.002, 10))
    smooth = amplitude_curves(decay)
    for curves, share in ((crossing_curves(decay), 0.15), (analytic_curves(decay), 0.15)):
        large = curves.sel(point=curves.amplitude.values > 0.1)
        for name, close in (("frequency", 2e-3), ("damping_ratio", share)):
            there = np.interp(large.amplitude.values, smooth.amplitude.values[::-1], smooth[name].values[::-1])
            assert np.median(np.abs(large[name].values / there - 1.0)) < close


def test_the_uncertainties_of_zero_crossings_cover_a_viscous_decay():
    time = np.arange(0.0, 80.0, 0.0213)
    curves = crossing_curves(smoothed_decay(time, noisy(linear(time, 1.5, 0.004), 0.01, 11)))
    assert curves.sizes["point"] == pytest.approx(2 * 1.5 * 64.0, abs=10)  # down to 9 times the noise
    for name, truth in (("frequency", 1.5), ("damping_ratio", 0.004)):
        z = (curves[name].values - truth) / curves[f"{name}_sigma"].values
        assert 0.8 < np.sqrt(np.mean(z**2)) < 1.2


def test_velocity_has_the_frequency_and_damping_of_displacement():
    values = linear(TIME, 1.5, 0.01)
    both = [
        amplitude_curves(smoothed_record(record(TIME, noisy(own, noise, 12), channel=channel), "mass", channel))
        for channel, own, noise in (("displacement", values, 1e-3), ("velocity", np.gradient(values, TIME), 1e-2))
    ]
    assert both[1].amplitude.values[0] == pytest.approx(OMEGA * both[0].amplitude.values[0], rel=0.05)
    for curves in both:
        assert within(curves, "frequency", lambda a: 1.5 + 0.0 * a)


def before_release(rest, held, noise, seed):
    """A decay of 20 Hz and 1 % behind a rest of so many seconds: held at its amplitude, or at 0 before a blow."""
    time = np.arange(0.0, 1.5, 0.002)
    since = np.maximum(time - rest, 0.0)
    values = np.where(time < rest, 1.0 if held else 0.0, linear(since, 20.0, 0.01, 0.0 if held else -0.5 * np.pi))
    return time, noisy(values, noise, seed)


@pytest.mark.parametrize("rest", [0.01, 0.03, 0.05, 0.4])
@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize("noise", [0.0003, 0.003])
def test_the_rest_before_the_release_is_left_out(rest, held, noise):
    """A fifth of a period of it, seen as motion, put the frequency 8 standard uncertainties off."""
    decay = smoothed_decay(*before_release(rest, held, noise, 14))
    assert decay.start == pytest.approx(rest, abs=0.006)
    assert decay.frame.companions == ()
    curves = amplitude_curves(decay)
    assert curves.attrs["start"] == decay.start
    assert within(curves, "frequency", lambda a: 20.0 + 0.0 * a)
    assert within(curves, "damping_ratio", lambda a: 0.01 + 0.0 * a)


def test_a_hand_that_pulls_before_the_release_is_left_out():
    time = np.arange(0.0, 2.0, 0.002)
    pulled = np.minimum(time / 0.4, 1.0) + 0.02 * np.sin(2.0 * np.pi * 3.0 * time)
    values = np.where(time < 0.5, pulled, linear(np.maximum(time - 0.5, 0.0), 20.0, 0.01))
    start = smoothed_decay(time, noisy(values, 0.003, 15)).start
    assert 0.488 < start < 0.5 + 0.55 / 20.0  # up to half a period more, where the last of the pull is a disturbance


@pytest.mark.parametrize("phase", np.linspace(0.0, 6.0, 7))
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_a_free_motion_has_no_rest_whatever_its_waves(phase, noise):
    tall = 1.0 - 0.9 * np.cos(phase)
    waves = [
        linear(TIME, 1.5, 0.03, phase),
        linear(TIME, 1.5, 0.01, phase) - linear(TIME, 4.5, 0.01, 3.0 * phase) / 9.0,  # flat crests
        bouncing(TIME + phase / 20.0, 1.5, 0.95),
        rubbing(TIME, 1.5, 0.004),
        integrated(TIME, lambda x, v: -(OMEGA**2) * (x - 0.2 * x**3) - 0.02 * OMEGA * v, tall),
    ]
    for seed, values in enumerate(waves):
        assert release(TIME, noisy(values, noise, seed)) == 0


@pytest.mark.parametrize(("low", "high"), [(-0.7, 0.7), (-0.9, 0.9), (-2.0, 0.8)])
def test_what_a_converter_has_clipped_is_left_out(low, high):
    """At 0.7 of the amplitude the damping came out at two thirds, 15 standard uncertainties off."""
    time = np.arange(0.0, 1.5, 0.001)
    free = noisy(linear(time, 20.0, 0.01, 0.3), 0.003, 16)
    decay = smoothed_decay(time, np.clip(free, low, high))
    assert decay.start >= time[np.flatnonzero((free < low) | (free > high))[-1]] - 0.026  # a run has two samples
    curves = amplitude_curves(decay)
    assert within(curves, "frequency", lambda a: 20.0 + 0.0 * a)
    assert within(curves, "damping_ratio", lambda a: 0.01 + 0.0 * a)


@pytest.mark.parametrize("step", [0.0, 0.001, 0.01, 0.1])
@pytest.mark.parametrize("samples", [12.0, 30.3, 200.0])
def test_the_crests_of_a_coarse_converter_are_not_clipped(step, samples):
    time = np.arange(0.0, 20.0, 1.0 / samples)
    for seed, damping in enumerate([0.001, 0.02]):
        values = noisy(linear(time, 1.0, damping, 0.4), 0.3 * step, seed)
        assert clipped_runs(step * np.round(values / step) if step else values).size == 0


@pytest.mark.parametrize(
    ("values", "time", "match"),
    [
        (linear(TIME[:10], 1.5, 0.01), TIME[:10], "at least 16 samples, got 10"),
        (linear(TIME[:80], 1.5, 0.01), TIME[:80], "need 4 periods .* got 2.5"),
        (linear(np.arange(200) / 4.0, 1.5, 0.01), np.arange(200) / 4.0, "4 samples a period, got 2.7"),
        (linear(TIME, 1.5, 0.0), TIME, "expected a motion that decays"),
        (np.full(TIME.size, 2.0), TIME, "expected a motion that decays, got the constant 2"),
        (linear(TIME, 1.5, -0.01), TIME, "expected a motion that decays|need 4 periods"),
    ],
    ids=["few samples", "few periods", "slow clock", "undamped", "at rest", "growing"],
)
def test_what_is_no_decay_is_refused(values, time, match):
    with pytest.raises(CalibError, match=match):
        amplitude_curves(smoothed_decay(time, values))


def test_noise_alone_is_refused():
    with pytest.raises(CalibError, match="periods with amplitudes above|expected a motion that decays"):
        amplitude_curves(smoothed_decay(TIME, noisy(0.0 * TIME, 1.0, 13)))


def test_a_record_under_excitation_and_a_wrong_name_are_refused():
    good = record(TIME, linear(TIME, 1.5, 0.01))
    with pytest.raises(CalibError, match="those of a free decay, got a record of base motion"):
        smoothed_record(good.assign_attrs(quantity="base motion"), "mass", "displacement")
    with pytest.raises(CalibError, match="no body 'mess' .did you mean 'mass'"):
        smoothed_record(good, "mess", "displacement")
    with pytest.raises(CalibError, match="no channel 'velocity'"):
        smoothed_record(good, "mass", "velocity")


def slipping(time, frequency, damping, slip, force, seed=0):
    """Let go from 1 by a magnet that rubs and chatters for `slip` seconds, the less the later, then free."""
    omega, chatter = 2.0 * np.pi * frequency, 6.0 * np.pi * frequency

    def force_of_all(t, x, v):
        drag = force * omega**2 * max(1.0 - t / slip, 0.0) * (1.0 if np.sin(chatter * t) > 0.0 else 0.3)
        return -(omega**2) * x - 2.0 * damping * omega * v + drag

    return solve_ivp(
        lambda t, s: [s[1], force_of_all(t, *s)],
        (time[0], time[-1]),
        [1.0, 0.0],
        t_eval=time,
        rtol=1e-9,
        atol=1e-12,
        max_step=0.02 / frequency,
    ).y[0]


@pytest.fixture(scope="module", params=[0.6, 1.2])
def disturbed(request):
    """A decay of 30 Hz and 0.3 % that is disturbed for so many periods; its number of disturbed samples."""
    time = np.arange(0.0, 2.0, 1.0 / 2048.0)
    slip = request.param / 30.0
    return time, noisy(slipping(time, 30.0, 0.003, slip, 0.15), 0.002, 17), int(np.ceil(slip * 2048.0))


def test_what_a_release_disturbs_is_left_out(disturbed):
    """A magnet that slipped for 0.6 of a period put frequency and damping 15 standard uncertainties off."""
    time, values, count = disturbed
    decay = smoothed_decay(time, values)
    assert 0.5 * count <= decay.disturbed <= count + 0.75 / 30.0 * 2048.0
    assert decay.start == time[decay.disturbed]
    assert decay.noise == pytest.approx(0.002, rel=0.15)
    curves = amplitude_curves(decay)
    assert within(curves, "frequency", lambda a: 30.0 * np.sqrt(1.0 - 0.003**2) + 0.0 * a)
    assert within(curves, "damping_ratio", lambda a: 0.003 + 0.0 * a)


def test_behind_a_disturbed_release_nothing_more_is_left_out(disturbed):
    time, values, _ = disturbed
    free = smoothed_decay(time, values).disturbed
    assert smoothed_decay(time[free:], values[free:]).disturbed == 0


def test_a_rest_and_a_disturbed_release_are_left_out_together(disturbed):
    time, values, _ = disturbed
    held = np.concatenate([noisy(np.ones(100), 0.002, 18), values])
    decay = smoothed_decay(np.arange(held.size) / 2048.0, held)
    assert decay.disturbed > 0
    assert decay.start == pytest.approx(100.0 / 2048.0 + smoothed_decay(time, values).start, abs=0.3 / 30.0)


@pytest.mark.parametrize("noise", [1e-4, 0.01])
def test_a_free_motion_is_not_disturbed_whatever_its_beginning(noise):
    rng = np.random.default_rng(19)
    free = {
        "viscous": linear(TIME, 1.5, 0.01),
        "heavy": linear(TIME, 1.5, 0.04, 2.0),
        "dry": rubbing(TIME, 1.5, 0.004),
        "drag": integrated(TIME, lambda x, v: -(OMEGA**2) * x - 0.3 * v * abs(v)),
        "hardening": integrated(TIME, lambda x, v: -(OMEGA**2) * (x + 3.0 * x**3) - 0.03 * OMEGA * v),
        "stop": integrated(TIME, lambda x, v: -(OMEGA**2) * (x + 8.0 * max(x - 0.6, 0.0)) - 0.02 * OMEGA * v),
        "bouncing": bouncing(TIME, 1.5, 0.95),
        "two modes": linear(TIME, 1.5, 0.01) + 0.3 * linear(TIME, 1.9, 0.008, 1.0),
    }
    falling = noise + 0.02 * np.exp(-0.1 * TIME)  # noise that falls as the motion does
    for name, values in free.items():
        assert smoothed_decay(TIME, noisy(values, noise, 20)).disturbed == 0, name
        assert smoothed_decay(TIME, values + falling * rng.standard_normal(TIME.size)).disturbed == 0, name


def test_the_breaks_of_the_splines_do_not_depend_on_the_phase_at_which_the_record_begins():
    """An envelope that began too low put no break into the first half, and a frequency 8 sigma off."""
    time, first = np.arange(0.0, 2.0, 1.0 / 2048.0), []
    values = linear(time, 30.0, 0.005)
    for begin in range(0, 68, 3):
        tone = analytic_signal(time[begin:], values[begin:])
        splines = [basis for basis in _bases(tone, tone.time.size - 1) if basis.degree == 3]
        first.append(np.unique(splines[5].knots)[1] - time[begin])
    assert max(first) < 2.0 * min(first)  # 5 times before
