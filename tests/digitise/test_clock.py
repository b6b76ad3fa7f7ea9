"""Time is recovered from a phase curve alone."""

import numpy as np
import pytest
from phase_loops import FREQUENCY, clapping

from calib.digitise.clock import clock, loop
from calib.errors import CalibError

PERIOD = 1.0 / FREQUENCY


def points(body="layer", count=4000, **motion):
    one = clapping(periods=1, samples=count, **motion).sel(body=body)
    return np.column_stack([one.displacement.values, one.velocity.values])


def over_time(drawn, found, count=2000):
    """Displacement (count,) at equal times over one period."""
    even = np.arange(count) * found.period / count
    return np.interp(even, found.time, np.append(drawn.displacement, drawn.displacement[0]))


def off(recovered, true):
    """Root mean square difference at the best start, over that of the true displacement about its mean."""
    true = np.interp(np.arange(recovered.size) / recovered.size, np.arange(true.size) / true.size, true)
    product = np.fft.irfft(np.conj(np.fft.rfft(recovered)) * np.fft.rfft(true))
    best = min(np.mean((np.roll(recovered, int(np.argmax(product)) + shift) - true) ** 2) for shift in range(-3, 4))
    return np.sqrt(best) / true.std()


@pytest.mark.parametrize("jump", [0.0, 0.3, 0.5, 0.7])
@pytest.mark.parametrize("count", [400, 4000])
def test_displacement_over_time_and_period_come_out_of_a_phase_curve_alone(jump, count):
    drawn = loop(points(jump=jump, count=count))
    found = clock(drawn)
    assert found.period == pytest.approx(PERIOD, rel=0.005)
    assert off(over_time(drawn, found), points(jump=jump)[:, 0]) < 0.01


@pytest.mark.parametrize("jump", [0.0, 0.4])
def test_a_rough_trace_gives_them_too(jump):
    rng = np.random.default_rng(1)
    clean = points(jump=jump, count=2000)
    noise = 5e-4 * np.ptp(clean, axis=0) / 2.0
    rough = clean + noise * rng.standard_normal(clean.shape)
    drawn = loop(rough)
    found = clock(drawn, noise[0])
    assert found.period == pytest.approx(PERIOD, rel=0.005)
    assert off(over_time(drawn, found), clean[:, 0]) < 0.01


def test_the_order_of_the_points_does_not_matter():
    forward, backward = loop(points()), loop(points()[::-1])
    assert backward.reversed
    assert not forward.reversed
    assert clock(backward).period == pytest.approx(clock(forward).period, rel=1e-3)


def test_a_jump_takes_no_time():
    drawn = loop(points(jump=0.5))
    found = clock(drawn)
    change = np.diff(drawn.velocity, append=drawn.velocity[:1])
    steps = np.diff(found.time)
    jumping = np.abs(change) / np.maximum(steps, 1e-12) > 5000.0  # m/s^2; elsewhere it is below 200
    assert change[jumping].sum() == pytest.approx(0.5, abs=0.03)
    assert steps[jumping].sum() < 0.002 * PERIOD


def test_time_never_runs_back():
    rng = np.random.default_rng(2)
    clean = points(count=1500)
    found = clock(loop(clean + 3e-3 * np.ptp(clean, axis=0) * rng.standard_normal(clean.shape)))
    assert (np.diff(found.time) >= 0.0).all()


@pytest.mark.parametrize("offset", [-0.04, 0.0, 0.03])
def test_a_velocity_axis_read_at_the_wrong_place_shows(offset):
    top = np.abs(points(jump=0.0)[:, 1] + offset).max()
    assert clock(loop(points(jump=0.0) + (0.0, offset))).zero == pytest.approx(offset / top, abs=1e-4)


@pytest.mark.parametrize(
    ("damaged", "said"),
    [
        (np.zeros((20, 2)), "at least 8 points that differ"),
        (points()[:5], "at least 8 points"),
        (points(count=400) + (0.0, 2.0), "one sign only"),
        (np.column_stack([np.linspace(-1, 1, 20), np.linspace(-1, 1, 20)]), "encloses no area"),
    ],
)
def test_what_is_no_phase_curve_is_refused(damaged, said):
    with pytest.raises(CalibError) as raised:
        clock(loop(damaged))
    assert said in str(raised.value)
