"""Describing functions of forces, against their closed forms."""

from types import SimpleNamespace

import numpy as np
import pytest

from calib.diagnosis.discovery.describing_function import describing_function
from calib.diagnosis.discovery.penalised import States

COEFFICIENTS = np.array([-2.0, -3.0, 5.0])  # of x^3, v |v| and x^2
PHASE = 2.0 * np.pi * np.arange(64) / 64
OMEGA = 40.0  # rad/s


def found(band, gap="", arguments=("displacement", "velocity")):
    fitted = SimpleNamespace(
        model=SimpleNamespace(matrix=lambda x, v: np.column_stack([x**3, v * np.abs(v), x**2])),
        combination=lambda rows: (rows @ COEFFICIENTS, np.abs(rows) @ np.abs(0.1 * COEFFICIENTS)),
    )
    states = States(0.2 * np.cos(PHASE), -0.2 * OMEGA * np.sin(PHASE))
    chosen = SimpleNamespace(place=SimpleNamespace(gap=gap), fitted=fitted, all_arguments=arguments)
    return SimpleNamespace(chosen=chosen, states=states, frequencies=band, partial_spline=None)


def test_equivalent_stiffness_and_damping_are_those_of_a_cubic_spring_and_drag():
    told = describing_function(found((6.0, 6.5)))
    a = np.array(told.amplitudes)
    assert (a[-1], told.frequency) == (pytest.approx(0.2), pytest.approx(OMEGA / (2.0 * np.pi)))
    assert told.stiffness == pytest.approx(0.75 * 2.0 * a**2)  # none of the even function
    assert told.damping == pytest.approx(8.0 * 3.0 * a * OMEGA / (3.0 * np.pi), rel=1e-3)
    assert told.damping_error == pytest.approx(0.1 * np.array(told.damping), rel=1e-3)


def test_a_function_of_displacement_has_no_equivalent_damping():
    told = describing_function(found((6.0, 6.5), arguments=("displacement",)))
    assert (any(told.damping), any(told.damping_error), any(told.stiffness)) == (False, False, True)


def test_what_a_narrow_band_cannot_tell_is_said():
    assert "|x| v" in describing_function(found((6.0, 6.5))).limits
    assert "|x| v" not in describing_function(found((3.0, 6.5))).limits


@pytest.mark.parametrize(("band", "gap"), [(None, ""), ((6.0, 6.5), "gap")])
def test_there_is_none_of_records_over_time_or_at_an_interface(band, gap):
    assert describing_function(found(band, gap)) is None
