"""Higher harmonics from time records of stepped and swept sines whose harmonics are known."""

import numpy as np
import pytest
from scipy.signal import hilbert

from calib import records
from calib.errors import CalibError
from calib.records.order_tracking import STEPPED, SWEPT, tracked
from calib.records.response import complex_harmonics, harmonic_orders, harmonic_tolerances

RATE, NOISE = 1_000.0, 2e-6  # Hz, m
SIZES = np.array([1e-3, 1e-4, 3e-5])[:, None]  # m
PHASE = 1.1  # of the drive when the record begins  [rad]


def harmonics(frequency):
    """Complex amplitudes (3, n) whose phases pass a quarter of a period at 22 Hz  [m]."""
    first = 0.5 / (22.0 - frequency + 0.5j)
    return SIZES * np.array([first, np.exp(0.4j) * first**2, np.exp(-1.0j) * first**3])


def record_of(frequency, seed, channel="displacement", noise=NOISE):
    """Record of a drive cos(phase) whose frequency is that of each sample (n,)."""
    rng, phase = np.random.default_rng(seed), PHASE + 2.0 * np.pi * np.cumsum(frequency) / RATE
    orders = np.arange(1, 4)[:, None]
    rates = {"displacement": 0, "acceleration": 2}[channel]
    own = harmonics(frequency) * (2j * np.pi * orders * frequency) ** rates
    motion = np.sum(own * np.exp(1j * orders * phase), axis=0).real
    size = noise * (2.0 * np.pi * 22.0) ** rates
    made = records.make(
        np.arange(frequency.size) / RATE, ["mass"], {channel: motion[None] + size * rng.standard_normal(phase.size)},
        {channel: "m" if rates == 0 else "m/s^2"}, source="sweeps.csv", place="mass", quantity="force",
    )  # fmt: skip
    made["excitation"] = "time", 2.0 * np.cos(phase) + 1e-3 * rng.standard_normal(phase.size), {"units": "N"}
    return made


def stepped(seed, **further):
    return record_of(np.repeat(np.arange(20.0, 24.1, 0.5), int(5.0 * RATE)), seed, **further)


def normalised(response):
    apart = complex_harmonics(response)[:, 0] - harmonics(response.frequency.values)
    return apart / harmonic_tolerances(response)[:, 0]


@pytest.mark.parametrize("channel", ["displacement", "acceleration"])
def test_harmonics_of_a_stepped_sine_are_known_to_their_uncertainty(channel):
    left = np.concatenate([normalised(tracked(stepped(s, channel=channel), STEPPED, 20, 3)) for s in range(4)], axis=1)
    rms = np.sqrt(np.mean(np.abs(left) ** 2, axis=1) / 2.0)
    assert (rms > 0.5).all(), rms
    assert (rms < 1.5).all(), rms


def test_harmonics_of_a_swept_sine_are_known_to_their_uncertainty():
    frequency = np.linspace(19.0, 25.0, int(120.0 * RATE))
    with pytest.warns(UserWarning, match="lags behind the sweep"):  # as a resonance would that is so narrow
        response = tracked(record_of(frequency, 1), SWEPT, 20, 3)
    left = np.abs(normalised(response)[:, 2:-2])
    assert np.median(left, axis=1).max() < 2.0
    assert left.max() < 6.0


def test_without_them_the_response_is_of_the_first_harmonic():
    record = stepped(1)
    plain = tracked(record, STEPPED)
    assert harmonic_orders(plain) == (1,)
    both = tracked(record, STEPPED, highest=2)
    assert harmonic_orders(both) == (1, 2)
    np.testing.assert_allclose(complex_harmonics(both)[0], complex_harmonics(plain)[0], atol=3.0 * NOISE)


def test_harmonics_of_the_excitation_itself_are_told():
    record = stepped(1)
    phase = np.unwrap(np.angle(hilbert(record.excitation.values)))
    record["excitation"] = record.excitation + 0.1 * np.cos(2.0 * phase + 0.3)
    with pytest.warns(
        UserWarning, match=r"the excitation itself has 5(\.\d)? % of harmonic 2, to which a linear struct"
    ):
        tracked(record, STEPPED, 20, 3)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"highest": 0}, "from 1 to 7, got 0"),
        ({"highest": 8}, "from 1 to 7, got 8"),
        ({"highest": 2, "cycles": 9}, "windows of 10 cycles or more, got 9"),
    ],
)
def test_an_order_that_cannot_be_tracked_is_refused(given, message):
    with pytest.raises(CalibError, match=message):
        tracked(stepped(1), STEPPED, **given)


def test_a_harmonic_beyond_the_nyquist_frequency_is_not_made_up():
    record = stepped(1).isel(time=slice(None, None, 10))  # 100 Hz: the third harmonic of 20 Hz is beyond 50 Hz
    with pytest.raises(CalibError, match="take other cycles, fewer harmonics"):
        tracked(record, STEPPED, 20, 3)
