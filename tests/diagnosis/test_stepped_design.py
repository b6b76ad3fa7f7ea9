"""Stepped sines that could be measured: which sweeps they make, and what the laboratory may state of them."""

import numpy as np
import pytest

from calib.diagnosis.diagnose import diagnose
from calib.diagnosis.laboratory import (
    STEPPED_SINE,
    DesignPoint,
    Laboratory,
    base_record,
    inapplicable,
    mistakes_of,
    regions,
)
from calib.diagnosis.noise import STATED, Noise
from calib.diagnosis.part import Part
from calib.diagnosis.stepped_design import as_read, unread_sweeps
from calib.dynamics.swept_response import swept_response
from calib.execution.pool import InProcess
from calib.features.frequency_response import ResponseDistance
from calib.modelling.model import Model
from calib.modelling.parameter import Space, Window
from calib.objective import Objective, Reference, Term
from calib.objective.stable_stretches import read_at
from calib.plugins import load
from calib.records import make
from calib.records.excitation import Excitation
from calib.records.response import UNKNOWN_PHASE, complex_amplitude, complex_harmonics, make_response, with_amplitude
from calib.study import CalibrationStudy

MODEL = Model(load("calib.simulators", "oscillator")())
FORCE = Excitation("mass", "force", frequency=5.0, amplitude=1.0)
SHAKEN = Excitation("base", "base motion", frequency=5.0, amplitude=1e-3)
SIGMA = 2e-4  # m
WHITE = Noise(1.0, np.zeros(0), STATED)


def response(levels=(0.2, 0.5), directions=(1.0, -1.0), **attrs):
    """Sweeps up and down of eleven points at each level, of 10 mm rms for 1 N."""
    up = np.linspace(4.0, 6.0, 11)
    ways = [(level, way) for level in levels for way in directions]
    frequency = np.concatenate([up[:: int(way)] for _, way in ways])
    level, direction = np.repeat(ways, 11, axis=0).T
    amplitude = 0.01 * level * np.exp(-1j * frequency)
    return make_response(
        frequency, ["mass"], amplitude[None], level, "N", np.repeat(np.arange(len(ways)), 11), direction,
        sigma=np.full((1, level.size), SIGMA), place="mass", quantity="force", **attrs,
    )  # fmt: skip


def reference(record, name="sweeps"):
    return Reference(name, record, excitation=FORCE)


def part_of(own):
    zero = np.zeros((1, 2))
    return Part(
        own.name, (("mass", "in_phase"),), zero[0], zero, None, 1, (), (WHITE,), zero > 0.0, zero, sweep=zero[0]
    )


def test_sweeps_of_a_level_go_as_the_measured_ones_do():
    unread = unread_sweeps(DesignPoint(STEPPED_SINE, 0.8, 4.5, 5.5), response())
    assert unread.sizes["point"] == 22
    assert np.unique(unread.level.values) == pytest.approx([0.8])
    assert unread.frequency.values[[0, 10, 11, 21]] == pytest.approx([4.5, 5.5, 5.5, 4.5])
    assert unread.direction.values[[0, 21]].tolist() == [1.0, -1.0]
    assert np.unique(unread.sweep.values).tolist() == [0.0, 1.0]


def test_what_is_read_is_uncertain_in_proportion_to_the_motion():
    measured = response()
    unread = unread_sweeps(DesignPoint(STEPPED_SINE, 0.8, 4.0, 6.0), measured)
    amplitude = 0.03 * np.exp(1j * unread.frequency.values)[None]
    read = as_read(unread, amplitude[None], measured, part_of(reference(measured)))
    assert complex_amplitude(read) == pytest.approx(amplitude)
    assert read.response_sigma.values == pytest.approx(SIGMA * 0.03 / (0.01 * 0.5))  # as at the largest level
    alone = as_read(unread, amplitude[None], response(phases=UNKNOWN_PHASE), part_of(reference(measured)))
    assert alone.in_phase.values == pytest.approx(0.03)
    assert not alone.quadrature.values.any()


def test_an_uncertainty_that_grows_with_the_amplitude_does_so_in_what_is_read():
    measured = response(levels=(0.5,), directions=(1.0,))
    size = np.linspace(1e-4, 5e-3, 11)[None]
    measured = with_amplitude(measured, size * (1.0 + 0.0j)).assign(response_sigma=(("body", "point"), 0.02 * size))
    unread = unread_sweeps(DesignPoint(STEPPED_SINE, 1.0, 4.0, 6.0), measured)
    read = as_read(unread, 3.0 * size[None, :, ::-1] + 0.0j, measured, part_of(reference(response())))
    assert read.response_sigma.values == pytest.approx(0.02 * 3.0 * size[:, ::-1], rel=1e-6)


def test_harmonics_are_read_with_noise_in_proportion_to_the_first():
    plain, second = response(), np.full((1, 44), 1e-5 + 0.0j)
    measured = plain.assign(
        {name: (("body", "point"), part, {"units": "m"}) for name, part in
         (("in_phase_2", second.real), ("quadrature_2", second.imag), ("response_2_sigma", np.full((1, 44), 1e-6)))}
    )  # fmt: skip
    unread = unread_sweeps(DesignPoint(STEPPED_SINE, 0.8, 4.0, 6.0), measured)
    own = np.array([0.03, 2e-4])[:, None, None] * np.exp(1j * unread.frequency.values)
    read = as_read(unread, own, measured, part_of(reference(measured)))
    np.testing.assert_allclose(complex_harmonics(read), own)
    assert read.response_2_sigma.values == pytest.approx(1e-6 * 0.03 / (0.01 * 0.5))


def test_levels_stepped_at_each_frequency_give_sweeps_over_all_of_them():
    frequency = np.repeat(np.linspace(4.0, 6.0, 5), 2)
    stepped = make_response(
        frequency, ["mass"], np.ones((1, 10)) * 0.01, np.tile([0.1, 0.2], 5), "N", np.arange(10.0), place="mass",
        quantity="force",
    )  # fmt: skip
    unread = unread_sweeps(DesignPoint(STEPPED_SINE, 0.8, 4.0, 6.0), stepped)
    assert unread.frequency.values == pytest.approx(np.linspace(4.0, 6.0, 5))


def test_a_level_that_follows_the_frequency_does_so_in_what_is_proposed():
    frequency = np.linspace(5.0, 20.0, 16)
    held = make_response(
        frequency, ["mass"], np.ones((1, 16)) * 0.01, 1.0 / frequency**2, "m", place="base", quantity="base motion"
    )
    own = {"held": Reference("held", held, excitation=Excitation("base", "base motion", frequency=5.0, amplitude=0.04))}
    [level] = regions(Laboratory(), own, MODEL, part_of(own["held"]))[STEPPED_SINE].variables
    assert (level.low, level.high, level.unit) == (pytest.approx(0.1 / 25.0), pytest.approx(1.5 / 25.0), "m")
    unread = unread_sweeps(DesignPoint(STEPPED_SINE, 0.08, 5.0, 20.0), held)
    assert unread.level.values == pytest.approx(2.0 / frequency**2, rel=1e-9)


def test_the_level_is_searched_about_those_of_the_records_unless_it_is_stated():
    own = reference(response())
    found = regions(Laboratory(), {"sweeps": own}, MODEL, part_of(own))
    [level] = found[STEPPED_SINE].variables
    assert list(found) == [STEPPED_SINE]
    assert (level.low, level.high, level.unit, level.stated) == (pytest.approx(0.02), pytest.approx(0.75), "N", False)
    assert found[STEPPED_SINE].fixed.frequency == 4.0
    stated = Laboratory(amplitude=(0.1, 2.0), frequency=(3.0, 8.0))
    region = regions(stated, {"sweeps": own}, MODEL, part_of(own))[STEPPED_SINE]
    assert (region.variables[0].low, region.variables[0].high) == (0.1, 2.0)
    assert (region.fixed.frequency, region.fixed.end_frequency) == (3.0, 8.0)


def test_beside_a_record_over_time_tones_are_searched_and_beside_sweeps_alone_sweeps():
    tone = make(np.arange(40) / 100.0, ("mass",), {"displacement": np.zeros((1, 40))})
    both = {"sweeps": reference(response()), "tone": reference(tone, "tone")}
    found = regions(Laboratory(tests=("steady tone",)), both, MODEL, part_of(both["tone"]))["steady tone"]
    bounds = {variable.name: (variable.low, variable.high) for variable in found.variables}
    assert bounds == {"amplitude": (0.1, 1.5), "frequency": (2.5, 10.0)}, "of the tone alone"
    assert base_record(both) == "tone"
    assert inapplicable(STEPPED_SINE, both["tone"], MODEL)
    assert not inapplicable(STEPPED_SINE, both["sweeps"], MODEL)
    assert "every record is a frequency response" in inapplicable("steady tone", both["sweeps"], MODEL)


def test_what_a_study_states_for_records_over_time_is_a_mistake_beside_sweeps():
    own = {"sweeps": reference(response())}
    right = Laboratory(frequency=(3.0, 8.0), amplitude=(0.1, 2.0), tests=(STEPPED_SINE,))
    assert not list(mistakes_of(right, own, MODEL))
    wrong = Laboratory(release=(1e-3, 2e-3), channels=(("mass", "velocity"),), tests=("free decay",))
    told = dict(mistakes_of(wrong, own, MODEL))
    assert told.keys() == {"release", "channels", "tests"}
    assert "only the level of a stepped sine is searched" in told["release"]


@pytest.mark.parametrize(
    ("phases", "drive"),
    [
        ("known", FORCE),
        pytest.param(UNKNOWN_PHASE, FORCE, marks=pytest.mark.slow),
        pytest.param("known", SHAKEN, marks=pytest.mark.slow),
    ],
)
def test_two_springs_are_distinguished_at_a_higher_level_than_those_of_the_records(phases, drive):
    truth = {"mass": 1.0, "stiffness": 400.0, "damping": 1.0}
    frequency, stated = np.linspace(2.8, 3.8, 21), {"place": drive.place, "quantity": drive.quantity}
    level = 0.1 if drive is FORCE else 2.5e-4 * (2.8 / frequency) ** 2  # of a held acceleration
    largest = float(np.max(level))
    wanted = make_response(frequency, ["mass"], np.ones((1, 21)), level, drive.unit, **stated)
    hidden = MODEL.extended(load("calib.effects", "cubic_stiffness"))
    amplitude = read_at(swept_response(hidden, {**truth, "k3": 5e5}, drive, wanted), wanted)
    sigma, rng = 0.01 * np.abs(amplitude).max(), np.random.default_rng(4)
    noisy = amplitude + sigma * (rng.standard_normal((2, 21)).T @ [1.0, 1j])
    noisy = noisy if phases == "known" else np.abs(noisy)
    measured = make_response(
        frequency, ["mass"], noisy, level, drive.unit, sigma=np.full((1, 21), sigma),
        frequency_sigma=np.full(21, 1e-4), phases=phases, **stated,
    )  # fmt: skip
    own = Objective({"low": Reference("low", measured, excitation=drive)}, [Term(ResponseDistance())])
    space = Space({"damping": Window(0.3, 3.0, "log"), "stiffness": Window(370.0, 430.0)}, {"mass": 1.0})
    study = CalibrationStudy("springs", MODEL, space, own, None, 9)
    springs = [load("calib.effects", name) for name in ("cubic_stiffness", "softening")]
    laboratory = Laboratory(amplitude=(0.5 * largest, 4.0 * largest), simulations=150)
    found = diagnose(study, {}, {**MODEL.nominal, **truth}, springs, seed=3, pool=InProcess, laboratory=laboratory)
    assert found.verdict == "one_of"
    [best] = found.design.measurements
    assert (best.kind, best.point.amplitude > largest, best.distinguished) == (STEPPED_SINE, True, 1)
    assert found.design.simulations <= 150
    assert [(known.record, known.amplitude) for known in found.design.known] == [("low", largest)]
