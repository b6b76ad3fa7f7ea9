"""The rate of a recorder's clock against that of the drive."""

import numpy as np
import pytest
import xarray as xr

from calib.objective import CLOCK_RATE, Reference, Term
from calib.records.cycles import clock_rate, kind_of_motion
from calib.records.excitation import Excitation
from calib.workflows.calibrate import Objective

FREQUENCY = 26.24  # Hz


def record(rate, cycles, per_cycle, noise=0.01, memory=0.0, seed=0, envelope=None, jitter=0.0):
    """Two harmonics, displacement and velocity, whose true instants are 1 + rate times the stamps."""
    rng, size = np.random.default_rng(seed), int(cycles * per_cycle)
    time = np.arange(size) / (per_cycle * FREQUENCY)
    true = (1.0 + rate) * time + jitter / (per_cycle * FREQUENCY) * rng.standard_normal(size)
    phase = 2.0 * np.pi * FREQUENCY * true
    new = np.sqrt(1.0 - memory**2) * rng.standard_normal((2, size))
    for k in range(1, size):
        new[:, k] += memory * new[:, k - 1]
    rows = [np.cos(phase) + 0.2 * np.cos(2.0 * phase + 1.0), -np.sin(phase) - 0.4 * np.sin(2.0 * phase + 1.0)]
    if envelope is not None:
        rows[0] = rows[0] + envelope(true) * np.sin(phase)
    rows = np.array(rows) + noise * new
    return xr.Dataset(
        {
            "displacement": (("body", "time"), rows[:1], {"units": "m"}),
            "velocity": (("body", "time"), 165.0 * rows[1:], {"units": "m/s"}),
        },
        coords={"body": ["mass"], "time": ("time", time, {"units": "s"})},
        attrs={"frequency": FREQUENCY},
    )


@pytest.mark.parametrize("memory", [0.0, 0.9])
@pytest.mark.parametrize(
    ("rate", "cycles", "per_cycle"), [(5e-5, 86.3, 200.0), (-5e-5, 60.0, 20.3), (1e-3, 40.5, 61.7)]
)
def test_the_rate_is_found_whatever_the_clock_and_the_noise(rate, cycles, per_cycle, memory):
    found = clock_rate(record(rate, cycles, per_cycle, 0.005, memory, jitter=0.01))
    assert found == pytest.approx(rate, rel=0.1)


def test_the_rate_of_a_motion_that_returns_after_two_periods_is_found():
    plain, double = record(1e-4, 60.0, 50.3), record(1e-4, 60.0, 50.3, seed=1)
    double["displacement"] += 0.3 * np.cos(np.pi * FREQUENCY * (1.0 + 1e-4) * plain.time)
    assert clock_rate(double, periods=2) == pytest.approx(1e-4, rel=0.1)


@pytest.mark.parametrize("memory", [0.0, 0.95])
@pytest.mark.parametrize(("cycles", "per_cycle"), [(10.2, 30.7), (40.0, 50.0), (80.7, 20.3)])
def test_noise_alone_is_no_rate(cycles, per_cycle, memory):
    found = [clock_rate(record(0.0, cycles, per_cycle, 0.02, memory, seed)) for seed in range(20)]
    assert found.count(0.0) >= 19


@pytest.mark.parametrize("rate", [0.0, 1e-4])
@pytest.mark.parametrize("periods", [0.5, 1.3, 6.5])
def test_a_gap_in_time_hinders_no_rate(rate, periods):
    """A recorder that stops for some cycles: they have no phase, and the others are not moved."""
    whole = record(rate, 80.0, 100.0, 0.002)
    begin = 20.2 / FREQUENCY
    kept = whole.isel(time=(whole.time.values < begin) | (whole.time.values > begin + periods / FREQUENCY))
    assert clock_rate(kept) == pytest.approx(rate, rel=0.1)


def test_too_few_cycles_beside_a_gap_tell_no_rate():
    whole = record(1e-3, 30.0, 50.0)
    time = FREQUENCY * whole.time.values
    assert clock_rate(whole.isel(time=(time < 4.0) | (time > 26.0))) == 0.0


@pytest.mark.parametrize("cycles", [9.9, 2.5])
def test_few_cycles_tell_no_rate(cycles):
    assert clock_rate(record(5e-5, cycles, 200.0, 1e-4), periods=1) == 0.0
    assert clock_rate(record(5e-5, cycles, 200.0, 1e-4), periods=3) == 0.0


def test_a_short_record_whose_period_is_not_known_is_compared_as_it_is():
    """2.9 cycles of a motion that grows do not show after how many periods it returns."""
    noisy = record(0.0, 2.86, 60.3, envelope=lambda time: 5.0 * FREQUENCY * time)
    assert kind_of_motion(noisy).period is None
    driven = Excitation("base", "displacement", amplitude=1e-3, frequency=FREQUENCY)
    reference = Objective({"run": Reference("run", noisy, excitation=driven)}, [Term(Loop())]).references["run"]
    assert reference.record.attrs[CLOCK_RATE] == 0.0
    np.testing.assert_array_equal(reference.record.time, noisy.time)


@pytest.mark.parametrize("cycles", [12.0, 60.0])
def test_a_motion_that_still_settles_is_no_rate(cycles):
    settling = record(0.0, cycles, 50.0, 0.0, envelope=lambda time: 1e-2 * np.exp(-time * FREQUENCY / 8.0))
    assert clock_rate(settling) == 0.0


@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_the_rate_does_not_depend_on_units(factor):
    plain = record(5e-5, 60.0, 50.3)
    other = plain.assign(velocity=factor * plain.velocity)
    assert clock_rate(other) == pytest.approx(clock_rate(plain), rel=1e-9)


def test_a_channel_that_stands_still_tells_no_rate_and_hinders_none():
    plain = record(1e-4, 60.0, 50.3)
    stuck = plain.assign(velocity=0.0 * plain.velocity)
    assert clock_rate(stuck) == pytest.approx(1e-4, rel=0.1)
    assert clock_rate(stuck.assign(displacement=0.0 * plain.displacement)) == 0.0


def test_a_motion_of_no_period_has_no_rate():
    """The phases of its cycles wander."""
    rng = np.random.default_rng(4)
    found = []
    for _ in range(20):
        wandering = record(0.0, 60.0, 50.0)
        walk = 0.3 * np.cumsum(rng.standard_normal(61))[np.arange(wandering.time.size) // 50]
        wandering["displacement"] += np.cos(2.0 * np.pi * FREQUENCY * wandering.time + walk)
        found.append(clock_rate(wandering))
    assert found.count(0.0) >= 19


def test_an_exact_record_has_no_rate():
    assert clock_rate(record(0.0, 60.0, 50.0, 0.0)) == 0.0


class Loop:
    """The displacement on the record's time base."""

    name, unit, channels = "loop", "m", ("displacement",)

    def __call__(self, record, bodies=None):
        return record["displacement"]

    def scale(self, reference):
        return 1.0


def test_a_reference_is_compared_on_the_clock_of_its_drive():
    fast = record(2e-4, 80.0, 100.3)
    driven = Excitation("base", "displacement", amplitude=1e-3, frequency=FREQUENCY)
    reference = Objective({"run": Reference("run", fast, excitation=driven)}, [Term(Loop())]).references["run"]
    rate = reference.record.attrs[CLOCK_RATE]
    assert rate == pytest.approx(2e-4, rel=0.02)
    np.testing.assert_allclose(reference.record.time, (1.0 + rate) * fast.time)
    again = Objective({"run": reference}, [Term(Loop())]).references["run"]
    assert again is reference
    assert reference.record.time.attrs == {"units": "s"}
    assert CLOCK_RATE not in fast.attrs


def test_a_motion_of_another_period_than_the_drive_s_has_no_clock_rate():
    """The search for the rate loses a whole cycle, which no recorder's clock does."""
    time = np.arange(600) / 900.0
    motion = np.cos(2.0 * np.pi * 9.0 * time)[None]
    measured = xr.Dataset(
        {"displacement": (("body", "time"), motion, {"units": "m"})},
        {"time": time, "body": ["mass"]},
        {"frequency": 56.5},
    )
    assert clock_rate(measured) == 0.0
