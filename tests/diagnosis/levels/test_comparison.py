"""Frequency responses compared level by level, and the sentences on them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calib.diagnosis.document import DiagnosisResult
from calib.diagnosis.levels.comparison import compared_levels
from calib.diagnosis.levels.document import LawTrendResult
from calib.diagnosis.noise import STATED, Noise
from calib.records.held_response import at_one_level
from calib.records.response import make_response
from calib.report.pages.diagnosis.levels import level_trends

FREQUENCY = np.linspace(2.8, 3.6, 40)  # Hz
DRAG = LawTrendResult("quadratic_drag", True, 1.0, 1, 0)
FRICTION = LawTrendResult("coulomb_friction", False, -1.0, -1, 0)


class NoSimulations:
    """A pool whose budget is spent."""

    left = 0.0

    def map(self, payloads):
        return iter(())


def sweeps(levels, dampings):
    """Record of a mode of 1 kg with a damping of its own in each sweep, the body behind it moving less."""
    omega = 2.0 * np.pi * FREQUENCY
    own = [a / (400.0 - omega**2 + 1j * omega * c) for a, c in zip(levels, dampings, strict=True)]
    amplitude = np.concatenate(own)
    level, sweep = (np.repeat(values, FREQUENCY.size) for values in (levels, np.arange(float(len(levels)))))
    frequency = np.tile(FREQUENCY, len(levels))
    return make_response(
        frequency, ["base", "mass"], np.array([0.2 * amplitude, amplitude]), level, "N", sweep,
        sigma=np.full((2, amplitude.size), 0.01 * np.abs(amplitude).min()), place="mass", quantity="force",
    )  # fmt: skip


def compared(record, gross=()):
    """What is told of a record of which nothing was simulated, some of its points being gross errors."""
    rows = [(body, part) for body in ("base", "mass") for part in ("in_phase", "quadrature")]
    part = SimpleNamespace(
        name="levels", rows=rows, is_swept=True, noise=[Noise(1.0, np.zeros(0), STATED)] * 4, used=np.ones((4, 1))
    )
    bench = SimpleNamespace(
        objective=SimpleNamespace(references={"levels": SimpleNamespace(record=record)}), model=None
    )
    trust = np.ones(record.sizes["point"])
    trust[list(gross)] = 0.1
    point = SimpleNamespace(simulated={"levels": SimpleNamespace(trust=trust)})
    fit = SimpleNamespace(point=point)
    selection = SimpleNamespace(
        causes=(), runners_up=(), null=fit, final=fit, rounds=[SimpleNamespace(suspects=(), threshold=3.0)]
    )
    return compared_levels(NoSimulations(), bench, [part], selection)


def said(levels):
    """Sentences on levels."""
    return level_trends(DiagnosisResult("named", levels=tuple(levels)))


def test_the_peaks_of_the_body_with_the_largest_amplitude_are_told_sweep_by_sweep():
    [levels] = compared(sweeps((0.1, 0.2, 0.4), (1.0, 1.2, 1.5)))
    assert (levels.body, levels.unit) == ("mass", "N")
    assert [one.level for one in levels.sweeps] == [0.1, 0.2, 0.4]
    expected = [a / (20.0 * c) for a, c in ((0.1, 1.0), (0.2, 1.2), (0.4, 1.5))]
    assert [one.amplitude for one in levels.sweeps] == pytest.approx(expected, rel=0.01)
    assert all(one.resolved for one in levels.sweeps)


def test_no_peak_is_read_from_a_gross_error():
    record = sweeps((0.1, 0.2, 0.4), (1.0, 1.2, 1.5))
    wrong = 2 * FREQUENCY.size - 3
    spoilt = record.copy(deep=True)
    spoilt["in_phase"].values[:, wrong] *= 100.0
    amplitudes = [[one.amplitude for one in compared(own, gross)[0].sweeps]
                  for own, gross in ((record, ()), (spoilt, (wrong,)), (spoilt, ()))]  # fmt: skip
    assert amplitudes[1] == pytest.approx(amplitudes[0], rel=1e-9)
    assert amplitudes[2][1] > 5.0 * amplitudes[0][1]


def test_a_gross_error_does_not_make_a_body_the_one_with_the_largest_amplitude():
    record = sweeps((0.1, 0.2, 0.4), (1.0, 1.2, 1.5))
    wrong = 2 * FREQUENCY.size - 3
    record["in_phase"].values[0, wrong] = 1e3
    assert [compared(record, gross)[0].body for gross in ((wrong,), ())] == ["mass", "base"]


def test_damping_that_grows_excludes_laws_whose_damping_falls():
    [levels] = compared(sweeps((0.1, 0.2, 0.4), (1.0, 1.2, 1.5)))
    [sentence] = said([replace(levels, laws=(DRAG, FRICTION))])
    assert (
        "levels 0.1 N to 0.4 N: the equivalent damping of mass grows with the amplitude, as its power 0.4" in sentence
    )
    assert "quadratic_drag (alone power 1) makes damping that grows; not so coulomb_friction" in sentence
    assert "whose damping falls" in sentence
    assert "does not move by more than" in sentence


def test_what_models_have_is_told_to_the_decimal_place_of_what_was_measured():
    [levels] = compared(sweeps((0.1, 0.2, 0.4), (1.0, 1.2, 1.5)))
    damping = replace(levels.damping, error=0.011, models={"calibrated": -1.2e-5, "coulomb_friction": -0.4})
    [sentence] = said([replace(levels, damping=damping)])
    assert "0.000 by the calibrated model, −0.400 with coulomb_friction" in sentence


def test_two_levels_say_nothing():
    [levels] = compared(sweeps((0.1, 0.4), (1.0, 1.5)))
    assert (levels.damping, levels.resonance) == (None, None)
    assert len(levels.sweeps) == 2
    assert said([levels]) == []


def test_one_level_is_no_comparison():
    assert compared(sweeps((0.1, 0.1), (1.0, 1.5))) == ()


def test_a_trend_below_three_standard_errors_is_not_said():
    [levels] = compared(sweeps((0.1, 0.2, 0.4), (1.0, 1.0, 1.0)))
    assert not levels.damping.significant
    assert said([replace(levels, laws=(DRAG, FRICTION))]) == []


def test_held_amplitudes_are_the_levels():
    held = (1e-3, 2e-3, 4e-3)
    record = sweeps((1.0, 1.0, 1.0), (1.0, 1.2, 1.5))
    size = np.abs(record["in_phase"].values[1] + 1j * record["quadrature"].values[1])
    factor = np.repeat(held, FREQUENCY.size) / size  # the level that holds the amplitude
    scaled = {name: record[name] * factor for name in ("level", "in_phase", "quadrature", "response_sigma")}
    for name, values in scaled.items():
        record = record.assign({name: values.assign_attrs(record[name].attrs)})
    [levels] = compared(at_one_level(record, "mass"))
    assert levels.held
    assert [one.level for one in levels.sweeps] == pytest.approx(held)
    assert levels.damping.power == pytest.approx(np.log(1.5) / np.log(4.0), abs=0.02)
