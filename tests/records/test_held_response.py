"""Responses at a held amplitude as records: put at one level a sweep, from columns, comments and files."""

import numpy as np
import pytest
import xarray as xr

from calib.errors import CalibError
from calib.records import read, rename_bodies, write
from calib.records.held_response import as_measured, at_one_level, is_held, unsteady
from calib.records.replicates import levels_of_sweeps, replicates
from calib.records.response import complex_amplitude, make_response
from calib.records.response_table import read_response
from calib.report.record_description import record_description, record_warnings

FREQUENCY = np.array([9.0, 10.0, 11.0, 11.5, 10.5, 9.5])  # Hz
SWEEP = np.array([0, 0, 0, 1, 1, 1])
LEVEL = np.array([2.0, 0.5, 1.5, 4.0, 1.0, 3.0])  # N
AMPLITUDE = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])  # mm
LAG = np.radians([10.0, 90.0, 170.0, 172.0, 120.0, 30.0])


def measured(**further):
    amplitude = 1e-3 * AMPLITUDE * np.exp(-1j * LAG)
    return make_response(
        FREQUENCY, ["mass", "tip"], np.array([amplitude, 3.0 * amplitude]), LEVEL, "N", SWEEP, [1, 1, 1, -1, -1, -1],
        place="mass", quantity="force", **further,
    )  # fmt: skip


def test_each_sweep_is_at_a_level_in_proportion_to_what_was_held_with_the_receptances_measured():
    held = at_one_level(measured(), "mass")
    assert is_held(held)
    np.testing.assert_allclose(held.level.values, 1.5 * AMPLITUDE)  # N/mm: the median of level over amplitude
    np.testing.assert_allclose(
        complex_amplitude(held) / held.level.values, complex_amplitude(measured()) / LEVEL, rtol=1e-14
    )
    np.testing.assert_allclose(held.held_amplitude.values, 1e-3 * AMPLITUDE, rtol=1e-14)
    np.testing.assert_allclose(as_measured(held).level.values, LEVEL, rtol=1e-14)
    np.testing.assert_allclose(complex_amplitude(as_measured(held)), complex_amplitude(measured()), rtol=1e-14)
    assert not is_held(as_measured(held))
    xr.testing.assert_identical(as_measured(measured()), measured())
    xr.testing.assert_identical(at_one_level(held, "mass"), held)


def test_an_uncertainty_in_proportion_to_the_held_amplitude_is_one_of_the_level():
    sigma = 0.02 * np.abs(complex_amplitude(measured()))
    held = at_one_level(measured(sigma=sigma), "mass")
    np.testing.assert_allclose(held.response_sigma.values, 0.02 * np.abs(complex_amplitude(held)), rtol=1e-14)


@pytest.mark.parametrize(
    ("body", "change", "words"),
    [
        ("mas", 1.0, r"no body 'mas' \(did you mean 'mass'\?\)"),
        ("mass", 0.0, "mass does not move at 9 Hz"),
    ],
)
def test_what_cannot_have_been_held_is_refused(body, change, words):
    record = measured()
    record["in_phase"][0, 0] *= change
    record["quadrature"][0, 0] *= change
    with pytest.raises(CalibError, match=words):
        at_one_level(record, body)


def test_what_was_not_held_is_said():
    omega = 2.0 * np.pi * FREQUENCY
    for rate in range(3):  # displacement, velocity, acceleration
        record = measured()
        record["in_phase"][:] *= (omega[0] / omega) ** rate
        record["quadrature"][:] *= (omega[0] / omega) ** rate
        held = at_one_level(record, "mass")
        assert not unsteady(held)
        assert not [text for text in record_warnings(held) if "held" in text]
    record = measured()
    record["in_phase"][0, 1] *= 2.0
    record["quadrature"][0, 1] *= 2.0
    (warning,) = [text for text in record_warnings(at_one_level(record, "mass")) if "held" in text]
    assert "in sweep 0 its displacement, velocity and acceleration all vary by" in warning


def test_it_is_described_with_the_amplitude_and_the_levels():
    text = "\n".join(record_description(at_one_level(measured(), "mass")))
    assert "swept by force at the mass, 0.5 N to 4 N, mass held at a set amplitude, from 9 Hz to 11.5 Hz" in text
    assert "sweep 0 up, mass held at 1 mm, 3 points: level 0.5 N .. 2 N, the least at 10 Hz" in text
    assert "sweep 1 down, mass held at 2 mm, 3 points: level 1 N .. 4 N, the least at 10.5 Hz" in text


def test_a_text_file_says_it_in_a_comment(tmp_path):
    path = tmp_path / "held.csv"
    columns = np.column_stack([FREQUENCY, AMPLITUDE, -np.degrees(LAG), LEVEL])
    rows = [", ".join(map(str, row)) for row in columns.tolist()]
    head = (
        "# place: mass\n# quantity: force\n# held: mass\n"
        "frequency [Hz], mass amplitude [mm], mass phase [deg], level [N]"
    )
    path.write_text("\n".join([head, *rows[:3]]))
    np.testing.assert_allclose(as_measured(read_response(path)).level.values, LEVEL[:3], rtol=1e-14)
    assert is_held(read_response(path))
    path.write_text("\n".join([head.replace("held: mass", "held: tip"), *rows[:3]]))
    with pytest.raises(CalibError, match="no body 'tip'"):
        read_response(path)


def test_a_file_keeps_it_whichever_way_it_is_written(tmp_path):
    held = at_one_level(measured(), "mass")
    for number, record in enumerate((held, measured(held="mass"))):
        write(record, tmp_path / f"{number}.nc")
        again = read(tmp_path / f"{number}.nc")
        np.testing.assert_allclose(complex_amplitude(again), complex_amplitude(held), rtol=1e-14)
        np.testing.assert_allclose(again.held_amplitude.values, held.held_amplitude.values, rtol=1e-14)


def test_the_body_keeps_its_part_under_another_name():
    held = at_one_level(measured(), "mass")
    assert rename_bodies(held, {"mass": "q1", "tip": "q2"}).attrs["held"] == "q1"
    with pytest.raises(CalibError, match="the amplitude of 'mass' was held"):
        rename_bodies(held, {"tip": "q2"})


def test_sweeps_at_one_acceleration_are_at_one_level_whatever_their_bands():
    frequency = np.array([9.0, 10.0, 11.0, 12.0, 11.0, 12.0, 13.0, 14.0])
    sweep = np.repeat([0, 1], 4)
    omega = 2.0 * np.pi * frequency
    level = np.array([2.0, 0.5, 1.5, 2.5, 1.4, 2.6, 3.0, 4.0])
    record = at_one_level(make_response(frequency, ["mass"], (5.0 / omega**2)[None] + 0j, level, "N", sweep), "mass")
    assert np.ptp(record.level.values) < 1e-12
    assert set(levels_of_sweeps(record)) == {0}
    assert replicates(record)[[4, 5]].tolist() == [2, 3]
