"""Frequency responses from time records of stepped and swept sines of an oscillator with known response."""

import re
import warnings

import numpy as np
import pytest
import xarray as xr
from scipy.signal import cont2discrete, lfilter, ss2tf

from calib import records
from calib.errors import CalibError
from calib.records.order_tracking import STEPPED, SWEPT, tracked
from calib.records.response import complex_amplitude
from calib.study_file import load
from calib.workflows.calibrate import calibrate

MASS, STIFFNESS, DAMPING = 0.8, 15_523.0, 4.0  # 22.2 Hz, 1.8 %
RATE = 1_003.7  # Hz, which knows nothing of the drive
FINER = 16  # of the integration: its first-order hold errs by less than 2e-6
UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s^2"}
UP_AND_DOWN = np.concatenate([np.arange(20.0, 24.6, 0.5), np.arange(24.2, 19.9, -0.5)])


def receptance(frequency):
    w = 2.0 * np.pi * np.asarray(frequency)
    return 1.0 / (STIFFNESS - MASS * w**2 + 1j * DAMPING * w)


def measured(phase, level, seed, noise=0.01, hum=0.03, channel="displacement"):
    """Record of a drive level (n,) cos(phase (n,)), both finely sampled: noise, hum of the mains, an offset."""
    force = level * np.cos(phase)
    system = [[0.0, 1.0], [-STIFFNESS / MASS, -DAMPING / MASS]], [[0.0], [1.0 / MASS]]
    reading = {"displacement": (1, 0, 0), "velocity": (0, 1, 0)}.get(channel)
    c, d = ([[*reading[:2]]], [[0.0]]) if reading else ([[-STIFFNESS / MASS, -DAMPING / MASS]], [[1.0 / MASS]])
    b, a, *_ = _transfer(system, c, d)
    motion = lfilter(b, a, force)[::FINER]
    rng, force = np.random.default_rng(seed), force[::FINER]
    time = np.arange(motion.size) / RATE
    mains = np.sin(2.0 * np.pi * 50.0 * time)
    motion = motion + motion.std() * (noise * rng.standard_normal(time.size) + hum * mains)
    force = force + force.std() * (noise * rng.standard_normal(time.size) + hum * mains + 0.2)
    record = records.make(time, ["mass"], {channel: motion[None]}, {channel: UNITS[channel]}, source="sweeps.csv")
    record["excitation"] = "time", force, {"units": "N"}
    record.attrs |= {"place": "mass", "quantity": "force"}
    return record


def _transfer(system, c, d):
    a, b, c, d, _ = cont2discrete((*map(np.array, system), np.array(c), np.array(d)), 1.0 / (RATE * FINER), "foh")
    numerator, denominator = ss2tf(a, b, c, d)
    return numerator[0], denominator


def stepped(seed, dwell=8.0, frequencies=UP_AND_DOWN, **trouble):
    frequency = np.repeat(frequencies, int(dwell * RATE * FINER))
    return measured(2.0 * np.pi * np.cumsum(frequency) / (RATE * FINER), 0.5, seed, **trouble)


def swept(seed, rate, idle=3.0, **trouble):
    """Up and down from 19 to 26 Hz, with a pause before each."""
    fine, wait = int(7.0 / rate * RATE * FINER), int(idle * RATE * FINER)
    up = np.linspace(19.0, 26.0, fine)
    frequency = np.concatenate([np.full(wait, 19.0), up, np.full(wait, 26.0), up[::-1]])
    return measured(2.0 * np.pi * np.cumsum(frequency) / (RATE * FINER), 0.5, seed, **trouble)


def departures(response):
    """Departures (point,) of the complex amplitude from that of the oscillator, in standard uncertainties."""
    exact = receptance(response.frequency.values) * 0.5
    return (complex_amplitude(response)[0] - exact) / response.response_sigma.values[0]


@pytest.mark.parametrize("channel", UNITS)
def test_steps_give_the_steady_response_within_its_uncertainty_whatever_was_measured(channel):
    response = tracked(stepped(3, channel=channel), STEPPED)
    assert response.frequency.values == pytest.approx(UP_AND_DOWN, abs=2e-3)
    assert response.direction.values == pytest.approx(np.repeat([1.0, -1.0], [10, 9]))
    assert np.unique(response.sweep.values).tolist() == [0.0, 1.0]
    assert np.unique(response.level.values).size <= 2  # of a sweep it is one
    assert response.level.values == pytest.approx(0.5, rel=2e-3)
    assert (response.attrs["place"], response.attrs["quantity"]) == ("mass", "force")
    assert np.abs(departures(response)).max() < 4.5
    assert response.response_sigma.values.max() < 0.01 * np.abs(complex_amplitude(response)).max()


@pytest.mark.slow
def test_stated_uncertainties_are_those_over_many_records():
    off = np.concatenate([departures(tracked(stepped(seed, hum=0.0, noise=0.05), STEPPED)) for seed in range(12)])
    assert np.sqrt(np.mean(np.abs(off) ** 2) / 2.0) == pytest.approx(1.0, abs=0.15)


def test_a_step_that_has_not_settled_has_that_in_its_uncertainty():
    hurried = tracked(stepped(4, dwell=1.5, noise=0.001, hum=0.0), STEPPED, 8)  # of a decay time of 0.4 s
    settled = tracked(stepped(4, noise=0.001, hum=0.0), STEPPED, 8)
    assert np.median(hurried.response_sigma) > 1.5 * np.median(settled.response_sigma)
    assert np.mean(np.abs(departures(hurried)) < 3.0) > 0.8


@pytest.mark.slow
@pytest.mark.parametrize("rate", [0.02, 0.05])
def test_a_sweep_gives_the_response_up_and_down_within_its_uncertainty(rate):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        response = tracked(swept(5, rate), SWEPT)
    assert [np.unique(own.direction).tolist() for _, own in response.groupby("sweep")] == [[1.0], [-1.0]]
    assert np.ptp(response.frequency.values) > 6.5
    off = np.abs(departures(response))
    assert np.sqrt(np.mean(off**2) / 2.0) < 1.2
    assert off.max() < 7.0
    exact = receptance(response.frequency.values) * 0.5
    assert np.abs(complex_amplitude(response)[0] - exact).max() < 2.5 * rate * np.abs(exact).max()


@pytest.mark.slow
def test_a_sweep_that_is_too_fast_says_where_and_by_how_much():
    with warnings.catch_warnings(record=True) as noted:
        warnings.simplefilter("always")
        response = tracked(swept(5, 0.2), SWEPT)
    for way, one in zip(("up", "down"), noted, strict=True):
        begin = rf"sweeps.csv, sweep {way} at 0.2 Hz/s: from 2\d\.\d+ to 2\d\.\d+ Hz the response lags behind the sweep"
        assert re.match(begin, str(one.message))
    exact = receptance(response.frequency.values) * 0.5
    peak = np.abs(exact) > 0.7 * np.abs(exact).max()
    assert np.abs(complex_amplitude(response)[0] - exact)[peak].max() > 0.05 * np.abs(exact).max()
    assert np.abs(departures(response))[peak].max() < 6.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tracked(swept(5, 0.02, noise=0.1), SWEPT)  # within the noise


def test_a_level_that_a_shaker_does_not_hold_is_kept_point_by_point():
    frequency = np.repeat(UP_AND_DOWN[:10], int(6.0 * RATE * FINER))
    level = 0.5 - 0.3 * np.exp(-((frequency - 22.2) ** 2))
    response = tracked(measured(2.0 * np.pi * np.cumsum(frequency) / (RATE * FINER), level, 6), STEPPED)
    expected = 0.5 - 0.3 * np.exp(-((UP_AND_DOWN[:10] - 22.2) ** 2))
    assert response.level.values == pytest.approx(expected, rel=3e-3)
    exact = receptance(response.frequency.values) * response.level.values
    assert np.abs((complex_amplitude(response)[0] - exact) / response.response_sigma.values[0]).max() < 5.0


def test_several_levels_at_each_frequency_are_a_sweep_each():
    frequency, level = np.repeat(UP_AND_DOWN[:10], 3), np.tile([0.1, 0.3, 1.0], 10)
    fine = int(7.3 * RATE * FINER)
    phase = 2.0 * np.pi * np.cumsum(np.repeat(frequency, fine)) / (RATE * FINER)
    response = tracked(measured(phase, np.repeat(level, fine), 9, noise=1e-3, hum=0.0), STEPPED)
    assert response.level.values == pytest.approx(np.repeat([0.1, 0.3, 1.0], 10), rel=5e-3)
    assert response.sweep.values.tolist() == np.repeat([0.0, 1.0, 2.0], 10).tolist()
    exact = receptance(response.frequency.values) * response.level.values
    assert np.abs((complex_amplitude(response)[0] - exact) / response.response_sigma.values[0]).max() < 5.0


def staircase(frequencies, levels, seconds=7.3, **trouble):
    """Record of steps of these frequencies and levels, in the order given."""
    fine = int(seconds * RATE * FINER)
    phase = 2.0 * np.pi * np.cumsum(np.repeat(frequencies, fine)) / (RATE * FINER)
    return measured(phase, np.repeat(levels, fine), 9, **{"noise": 1e-3, "hum": 0.0, **trouble})


def of_sweeps(response):
    """Level and frequencies of each sweep."""
    return [(round(float(own.level[0]), 2), own.frequency.values.round(2)) for _, own in response.groupby("sweep")]


SNAKE = np.concatenate([[0.1, 0.3, 1.0], [1.0, 0.3, 0.1]] * 5)
ALL_BUT_ONE = np.delete(np.arange(30), 13)  # the level 0.3 of the fifth frequency


@pytest.mark.parametrize(
    ("places", "levels", "counts"),
    [
        (np.arange(30) // 3, SNAKE, {0.1: 10, 0.3: 10, 1.0: 10}),
        (ALL_BUT_ONE // 3, np.tile([0.1, 0.3, 1.0], 10)[ALL_BUT_ONE], {0.1: 10, 0.3: 9, 1.0: 10}),
        (np.arange(20) // 2, np.tile([1.0, 1.06], 10), {1.0: 10, 1.06: 10}),
    ],
    ids=["to and fro", "one is missing", "nearly equal"],
)
def test_a_step_belongs_to_the_sweep_of_its_level_in_any_order(places, levels, counts):
    response = tracked(staircase(UP_AND_DOWN[places], levels), STEPPED)
    assert {level: frequency.size for level, frequency in of_sweeps(response)} == counts
    assert all(np.ptp(own.level.values) < 5e-3 * own.level.values.mean() for _, own in response.groupby("sweep"))


def without_force(record, begin, seconds):
    force = record.excitation.values.copy()
    force[int(begin * RATE) : int((begin + seconds) * RATE)] = 0.0
    return record.assign(excitation=("time", force, {"units": "N"}))


def test_a_step_in_which_the_force_cell_is_loose_is_one_point_of_one_sweep():
    record = without_force(staircase(UP_AND_DOWN[:10], np.ones(10), 12.0), 4 * 12.0 + 5.0, 1.5)
    ((_, frequencies),) = of_sweeps(tracked(record, STEPPED))
    assert frequencies == pytest.approx(UP_AND_DOWN[:10], abs=5e-3)


def stopped(frequency, begin, seconds, seed=9):
    """Record of a drive of this frequency (n,), finely sampled, that stops at instants for some seconds."""
    level = np.ones(frequency.size)
    for one in begin:
        level[int(one * RATE * FINER) : int((one + seconds) * RATE * FINER)] = 0.0
    return measured(2.0 * np.pi * np.cumsum(frequency) / (RATE * FINER), level, seed, noise=1e-3, hum=0.0)


def test_a_stop_until_the_motion_is_at_rest_begins_another_sweep():
    steps = np.repeat([*UP_AND_DOWN[:5], *UP_AND_DOWN[4:10]], int(7.3 * RATE * FINER))
    counts = [frequencies.size for _, frequencies in of_sweeps(tracked(stopped(steps, [5 * 7.3 - 1.6], 1.6), STEPPED))]
    assert counts == [5, 6]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the lag
        both = tracked(stopped(np.linspace(19.0, 26.0, int(140 * RATE * FINER)), [70.0], 2.0), SWEPT)
    assert [own.direction.values[0] for _, own in both.groupby("sweep")] == [1.0, 1.0]


def test_stops_before_every_step_are_said_and_end_no_sweep():
    steps = np.repeat(UP_AND_DOWN[:10], int(7.3 * RATE * FINER))
    with pytest.warns(UserWarning, match="sweeps.csv: the excitation stops between the steps"):
        response = tracked(stopped(steps, 7.3 * np.arange(1, 10) - 1.6, 1.6), STEPPED)
    assert [frequencies.size for _, frequencies in of_sweeps(response)] == [10]


def test_steps_that_return_at_a_repeated_frequency_begin_the_way_back_with_it():
    levels = np.repeat([0.3, 1.0], 5)
    response = tracked(staircase(np.array([20, 21, 22, 23, 24, 24, 23, 22, 21, 20.0]), levels), STEPPED)
    assert [(level, frequencies.size) for level, frequencies in of_sweeps(response)] == [(0.3, 5), (1.0, 5)]


@pytest.mark.parametrize("between", [(21.0, 22.2, 120.0), (21.0, 21.0, 20.0)], ids=["slower", "waiting"])
def test_a_sweep_that_slows_down_or_waits_goes_on(between):
    begin, end, seconds = between
    parts = (19.0, 21.0, 40.0), (begin, end, seconds), (end, 26.0, (26.0 - end) / 0.05)
    frequency = np.concatenate([np.linspace(low, high, int(s * RATE * FINER)) for low, high, s in parts])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the lag
        response = tracked(measured(2.0 * np.pi * np.cumsum(frequency) / (RATE * FINER), 0.5, 4), SWEPT)
    assert np.unique(response.sweep.values).tolist() == [0.0]
    assert np.ptp(response.frequency.values) > 6.5


@pytest.mark.parametrize("hum", [0.01, 0.03])
def test_steps_beside_the_hum_of_the_mains_have_its_beating_in_their_uncertainty(hum):
    frequencies = np.arange(47.27, 53.3, 0.4)  # 0.13 to 3.3 Hz beside it, in windows of 0.4 s
    response = tracked(staircase(frequencies, np.full(16, 0.5), 8.0, hum=hum), STEPPED)
    ((_, tracked_frequencies),) = of_sweeps(response)
    assert tracked_frequencies == pytest.approx(frequencies, abs=0.05)
    off = np.abs(departures(response))
    assert np.sqrt(np.mean(off**2) / 2.0) < 1.2
    assert off.max() < 4.5


@pytest.mark.parametrize("back", [3.0, 10.0, 20.0])
def test_a_fast_return_between_sweeps_leaves_nothing_that_is_wrong(back):
    up, down = (np.linspace(*ends, int(s * RATE * FINER)) for ends, s in (((19, 26), 140.0), ((26, 19), back)))
    frequency = np.concatenate([up, down, up])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        response = tracked(measured(2.0 * np.pi * np.cumsum(frequency) / (RATE * FINER), 0.5, 10), SWEPT)
    ways = [own.direction.values[0] for _, own in response.groupby("sweep") if own.sizes["point"] > 100]
    assert ways == [1.0, 1.0]
    exact = receptance(response.frequency.values) * 0.5
    assert np.abs(complex_amplitude(response)[0] - exact).max() < 0.2 * np.abs(exact).max()


def test_sweeps_go_on_over_a_gap():
    record = swept(11, 0.05)
    force = record.excitation.values.copy()
    force[int(60.0 * RATE) : int(61.0 * RATE)] = 0.0  # a loose contact
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        response = tracked(record.assign(excitation=("time", force, {"units": "N"})), SWEPT)
    assert np.unique(response.sweep.values).size == 2


def test_a_motion_below_its_noise_loses_no_point():
    record = swept(12, 0.05, hum=0.0)
    noise = np.random.default_rng(1).standard_normal(record.displacement.shape)
    record = record.assign(displacement=record.displacement + 5.0 * float(record.displacement.std()) * noise)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        response = tracked(record, SWEPT)
    off = np.abs(departures(response))
    assert response.sizes["point"] > 250
    assert np.sqrt(np.mean(off**2) / 2.0) == pytest.approx(1.0, abs=0.1)


def test_what_the_excitation_prescribes_is_left_out():
    record = stepped(3)
    base = record.assign_coords(body=["base"])
    both = xr.concat([base, record], "body", data_vars="minimal", combine_attrs="override")
    response = tracked(both.assign_attrs(prescribed=records.prescription(["base"])), STEPPED)
    assert response.body.values.tolist() == ["mass"]
    with pytest.raises(CalibError, match="prescribes the motion of all bodies"):
        tracked(base.assign_attrs(prescribed=records.prescription(["base"])), STEPPED)


def test_instants_that_are_rounded_are_an_even_clock():
    record = stepped(3)
    rounded = record.assign_coords(time=np.round(record.time.values, 4) + 1234.5)
    assert tracked(rounded, STEPPED).sizes["point"] == UP_AND_DOWN.size


def test_what_is_no_such_sine_is_refused():
    steps = stepped(7)
    with pytest.raises(CalibError, match=r"sweeps.csv: the excitation is one sine in \d+ windows of 20 cycles, but no"):
        tracked(steps, SWEPT)
    with pytest.raises(CalibError, match="needs a recorded excitation"):
        tracked(steps.drop_vars("excitation"), STEPPED)
    with pytest.raises(CalibError, match="constant interval"):
        tracked(steps.isel(time=[*range(500), *range(900, 4000)]), STEPPED)
    noise = steps.assign(excitation=("time", np.random.default_rng(1).standard_normal(steps.time.size), {"units": "N"}))
    with pytest.raises(CalibError, match="one sine in 0 windows"):
        tracked(noise, STEPPED)


STUDY = """
[study]
name = "sweeps"
seed = 1
budget = 30

[[record]]
name = "sweeps"
path = "sweeps.csv"

[record.table]
rate = "1003.7 Hz"
channels = [{ column = 2, body = "mass", channel = "displacement", unit = "mm" }]
tracking = { sine = "stepped", cycles = 25 }

[record.excitation]
place = "mass"
quantity = "force"
column = 1
unit = "N"

[model]
simulator = "oscillator"
fixed = { mass = "0.8 kg" }

[windows]
stiffness = { low = "12 kN/m", high = "20 kN/m" }
damping = { low = 1, high = 20, scale = "log" }

[[term]]
feature = "frequency_response"

[optimiser]
name = "multistart"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder, record = tmp_path_factory.mktemp("tracked"), stepped(8)
    np.savetxt(
        folder / "sweeps.csv", np.column_stack([record.excitation, 1e3 * record.displacement[0]]), "%.9g", delimiter=","
    )
    (folder / "study.toml").write_text(STUDY)
    return folder


def test_a_study_takes_a_record_over_time_as_a_response(folder):
    reference = load(folder / "study.toml").study.objective.references["sweeps"]
    assert reference.is_swept
    assert reference.record.frequency.values == pytest.approx(UP_AND_DOWN, abs=2e-3)
    assert (reference.excitation.place, reference.excitation.quantity) == ("mass", "force")


@pytest.mark.slow
def test_the_values_behind_tracked_steps_are_found_within_their_intervals(folder):
    result = calibrate(folder / "study.toml")
    for name, truth in (("stiffness", STIFFNESS), ("damping", DAMPING)):
        low, high = result.intervals[name]
        assert abs(result.values[name] - truth) < 0.75 * (high - low)
        assert high - low < 0.04 * truth


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('column = 1\nunit = "N"', 'amplitude = "0.5 N"', "tracking needs the excitation as measured"),
        (
            'rate = "1003.7 Hz"',
            'frequency = { column = 3, unit = "Hz" }',
            "tracking is a key that a table over time has",
        ),
        ('"stepped"', '"hopped"', "sine"),
        ("cycles = 25", "cycles = 4", "cycles"),
        ("cycles = 25 }", 'cycles = 25 }\ncutoff = "60 Hz"', "drop cutoff"),
        ('"stepped"', '"swept"', "are a swept sine one after the other"),
    ],
)
def test_a_mistake_in_tracking_is_named_with_its_line(folder, tmp_path, old, new, says):
    (tmp_path / "sweeps.csv").symlink_to(folder / "sweeps.csv")
    assert old in STUDY
    (tmp_path / "study.toml").write_text(STUDY.replace(old, new))
    with pytest.raises(CalibError, match=says) as refusal:
        load(tmp_path / "study.toml")
    assert re.search(r"study.toml:\d+: record\[1\]", str(refusal.value))
