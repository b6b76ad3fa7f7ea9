"""Laboratories: their clocks look at the same motions, and their noise is what z takes it for."""

import numpy as np
import pytest
from hidden.hider import SYSTEMS, bench, hide
from hidden.laboratory import MOST, NOISE, SAMPLES, Laboratory
from hidden.noise import coloured, whitened
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from calib.objective import CLOCK_RATE
from calib.records import read
from calib.study_file import load

MEMORIES = [(), (0.8,), (2.0 * 0.9 * np.cos(0.4), -(0.9**2))]
SYSTEM = SYSTEMS["oscillator"]()
DRAWN = [Laboratory.drawn(seed, SYSTEM) for seed in range(200)]
FREE = next(seed for seed, lab in enumerate(DRAWN) if lab.facts["clock"]["free"])


def autocorrelation(memory, size):
    """Of the noise (size,), by its impulse response."""
    response = lfilter([1.0], np.concatenate([[1.0], -np.array(memory)]), np.eye(1, 4000)[0])
    full = np.array([response[: response.size - lag] @ response[lag:] for lag in range(size)])
    return full / full[0]


@pytest.mark.parametrize(
    ("simulator", "options"),
    [pytest.param("four_dof", {}, marks=pytest.mark.slow), ("oscillator", {"stop": True})],
)
def test_a_free_clock_looks_at_the_motion_that_the_steady_one_sees(simulator, options, cache):
    """Samples of both, taken in one flight with those of the free clock between them."""
    steady = bench(simulator, cache, **options)
    free = bench(simulator, cache, laboratory=FREE, **options)
    for plan in steady.system.plans:
        old = steady.system.times(plan)
        motion = steady.system.moved(plan, steady.system.truth, {})
        index = list(steady.system.measured.values())
        both = np.concatenate([old, free.system.times(plan)])
        order = np.argsort(both, kind="stable")
        rows = np.concatenate([part[index] for part in motion.look(both[order])])[:, np.argsort(order)]
        size = np.abs(rows).max(axis=1, keepdims=True)
        apart = np.abs(motion.impacts[:, None] - np.mod(old, 1.0 / plan.frequency if plan.frequency else np.inf))
        away = apart.min(axis=0, initial=np.inf) > 1e-9
        assert np.abs((rows[:, : old.size] - steady.clean(plan).rows)[:, away] / size).max() < 1e-8
        assert np.abs((rows[:, old.size :] - free.clean(plan).rows) / size).max() < 1e-8


def test_between_samples_a_linear_motion_is_the_harmonic_through_them(cache):
    steady, free = bench("oscillator", cache), bench("oscillator", cache, laboratory=FREE)
    for plan in steady.system.plans[:2]:

        def tones(times, plan=plan):
            turn = 2.0 * np.pi * plan.frequency * times
            return np.column_stack([np.cos(turn), np.sin(turn)])

        rows = steady.clean(plan).rows
        through = np.linalg.lstsq(tones(steady.system.times(plan)), rows.T)[0]
        expected = (tones(free.system.times(plan)) @ through).T
        assert free.clean(plan).rows == pytest.approx(expected, abs=1e-8 * np.abs(rows).max())


@pytest.mark.parametrize("memory", MEMORIES)
def test_noise_has_unit_variance_and_is_whitened_by_its_memory(memory):
    rows = coloured(np.random.default_rng(1), (4000, 60), np.array(memory))
    assert rows.var(axis=0) == pytest.approx(1.0, abs=0.15)
    assert (rows[:, 40] * rows[:, 43]).mean() == pytest.approx(autocorrelation(memory, 4)[3], abs=0.1)
    assert whitened(rows, np.array(memory)) == pytest.approx(
        np.random.default_rng(1).standard_normal(rows.shape), abs=1e-9
    )


@pytest.mark.parametrize("memory", MEMORIES)
def test_a_whitened_change_has_the_length_that_its_covariance_gives_it(memory):
    change = np.cumsum(np.random.default_rng(2).standard_normal((1, 50)), axis=1)
    covariance = toeplitz(autocorrelation(memory, 50))
    squared = change[0] @ np.linalg.solve(covariance, change[0])
    assert (whitened(change, np.array(memory)) ** 2).sum() == pytest.approx(squared, rel=1e-6)


def test_half_of_the_laboratories_have_a_free_clock_and_half_coloured_noise():
    facts = [
        (
            lab.facts["clock"]["free"],
            lab.facts["clock"]["jitter_told"],
            lab.facts["noise"]["colour"] != "white",
            lab.stated,
        )
        for lab in DRAWN
    ]
    assert np.mean(facts, axis=0) == pytest.approx([0.5] * 4, abs=0.12)
    assert all(NOISE[0] <= lab.noise <= NOISE[1] for lab in DRAWN)


def test_records_are_as_long_and_as_densely_sampled_as_drawn():
    for lab in DRAWN:
        for plan in SYSTEM.plans:
            clock = lab.clocks[plan.name]
            assert clock.true.size == clock.stamps.size <= MOST
            assert (np.diff(clock.true) > 0.0).all()
            if plan.kind == "harmonic":
                record = lab.facts["records"][plan.name]
                assert SAMPLES[0] <= record["samples"] <= SAMPLES[1]
                assert SYSTEM.cycles[0] * 0.97 <= record["cycles"] <= SYSTEM.cycles[1] * 1.01


def test_a_clock_in_step_has_exact_stamps_and_a_free_one_drifts():
    assert {lab.facts["clock"]["free"] for lab in DRAWN} == {True, False}
    for lab in DRAWN:
        free, clock = lab.facts["clock"], lab.clocks["loud"]
        if not free["free"]:
            assert (clock.true == clock.stamps).all()
            continue
        step = clock.stamps[-1] / (clock.stamps.size - 1)
        apart = clock.true - (1.0 + free["drift"]) * clock.stamps
        assert abs(free["drift"]) == pytest.approx(50e-6)
        assert np.std(apart) < (1e-5 if free["jitter_told"] else 0.02) * step
        assert (clock.jitter > 0.0) != free["jitter_told"]


def test_what_errors_of_the_stamps_make_of_the_motion_lowers_z(cache):
    seed = next(
        seed for seed, lab in enumerate(DRAWN)
        if lab.clocks["loud"].jitter and lab.facts["records"]["loud"]["samples"] < 40.0
    )  # fmt: skip
    at = bench("oscillator", cache, laboratory=seed)
    assert (at._deviation(at.plans[1]) > at._sigma(at.plans[1])).any()


def test_the_noise_of_a_record_is_the_drawn_one(cache, tmp_path):
    seed = next(
        seed for seed, lab in enumerate(DRAWN)
        if lab.facts["noise"]["colour"] == "AR(2)" and lab.stated and lab.clocks["loud"].true.size > 3000
    )  # fmt: skip
    hide("oscillator", None, None, 1, folder=tmp_path, cache=cache, laboratory=seed)
    at = bench("oscillator", cache, laboratory=seed)
    record = read(tmp_path / "loud.nc")
    noise = record.displacement.values - at.clean(at.plans[1]).rows[:1]
    white = whitened(noise / DRAWN[seed].noise, np.array(DRAWN[seed].memory["loud"]))[0]
    rms = np.sqrt((at.clean(at.plans[1]).rows[0] ** 2).mean())
    assert record.displacement_sigma.values[0] == pytest.approx(DRAWN[seed].noise * rms)
    assert white.std() == pytest.approx(rms, rel=0.1)
    assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 0.1


@pytest.mark.parametrize("simulator", [pytest.param("four_dof", marks=pytest.mark.slow), "oscillator"])
def test_strength_is_z_in_the_records_as_they_are_drawn(simulator, cache, tmp_path):
    hidden = hide(simulator, "quadratic_drag", 12.0, 1, folder=tmp_path, cache=cache, laboratory=FREE)
    assert hidden.z["quadratic_drag"] == pytest.approx(12.0, rel=0.03)
    at = bench(simulator, cache, laboratory=FREE)
    assert at.linear_z_of("quadratic_drag", hidden.values["c2"]) == pytest.approx(12.0, rel=0.2)
    assert bench(simulator, cache).z_of("quadratic_drag", hidden.values["c2"]) != pytest.approx(12.0, rel=0.05)


def test_a_clock_that_drifts_is_seen_in_proportion_to_its_drift(cache):
    at = bench("oscillator", cache, laboratory=FREE)
    drift = DRAWN[FREE].facts["clock"]["drift"]
    assert at.drift_z(drift) > 1.0
    assert at.drift_z(0.5 * drift) == pytest.approx(0.5 * at.drift_z(drift), rel=0.01)


@pytest.mark.parametrize("seed", [FREE, FREE + 1, FREE + 2])
def test_the_study_of_a_laboratory_can_be_read_and_covers_its_records(seed, cache, tmp_path):
    hide("oscillator", None, None, 1, folder=tmp_path, cache=cache, laboratory=seed)
    file = load(tmp_path)
    references = {**file.study.objective.references, **file.others}
    assert set(references) == {plan.name for plan in SYSTEM.plans}
    for name, reference in references.items():
        if reference.excitation.periodic:
            assert reference.request.periods > reference.record.time.values[-1] * reference.excitation.frequency
        stamps = Laboratory.drawn(seed, SYSTEM).clocks[name].stamps
        rate = reference.record.attrs.get(CLOCK_RATE, 0.0)  # put on the clock of the drive
        assert abs(rate) < 1e-4
        assert reference.record.time.values == pytest.approx((1.0 + rate) * stamps, abs=1e-12)
