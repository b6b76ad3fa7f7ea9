"""Frequency responses that [record.table] states."""

import re

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.io import savemat

from calib.cli import main
from calib.errors import CalibError
from calib.records.response import complex_amplitude, sweeps
from calib.study_file import load

STUDY = """
[study]
name = "held"
seed = 1
budget = 4

[[record]]
name = "bench"
path = "held.mat"

[record.table]
frequency = { column = "held(*).f", unit = "Hz", sigma = "0.01 Hz" }
channels = [
    { column = "held(*).a", body = "mass", channel = "amplitude", unit = "g", sigma = "0.05 m/s^2" },
    { column = "held(*).p", body = "mass", channel = "phase", unit = "deg", of = "displacement" },
]

[record.excitation]
place = "mass"
quantity = "force"
column = "held(*).F"
unit = "mN"

[model]
simulator = "oscillator"
fixed = { mass = 1, stiffness = 400 }

[windows]
damping = { low = 0.5, high = 2.0 }

[[term]]
feature = "frequency_response"
"""


def study(folder, *changes):
    array = np.zeros((1, 2), dtype=[(name, object) for name in "fapF"])
    for i in (0, 1):
        columns = {"f": [[3.0], [3.2]], "a": [[0.1], [0.1]], "p": [[-80.0], [-100.0]], "F": [[500.0 + i], [600.0 + i]]}
        for name, values in columns.items():
            array[name][0, i] = np.array(values)
    savemat(folder / "held.mat", {"held": array})
    text = STUDY
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "study.toml").write_text(text)
    return folder / "study.toml"


def test_sweeps_of_structures_are_a_record_in_si(tmp_path):
    reference = load(study(tmp_path)).reference("bench")
    record = reference.record
    np.testing.assert_allclose(record.level, [0.5, 0.6, 0.501, 0.601])
    assert [number for number, _ in sweeps(record)] == [1.0, 2.0]
    omega = 2.0 * np.pi * record.frequency.values
    amplitude = 0.980665 / omega**2 * np.exp(1j * np.radians([-80.0, -100.0] * 2))
    np.testing.assert_allclose(complex_amplitude(record)[0], amplitude)
    np.testing.assert_allclose(record.response_sigma[0], 0.05 / omega**2)
    np.testing.assert_allclose(record.frequency_sigma, 0.01)
    assert (reference.excitation.place, reference.excitation.quantity) == ("mass", "force")


def test_one_amplitude_of_the_excitation_is_that_of_all_points(tmp_path):
    record = (
        load(study(tmp_path, ('column = "held(*).F"\nunit = "mN"', 'amplitude = "0.5 N"'))).reference("bench").record
    )
    np.testing.assert_allclose(record.level, 0.5)


AMPLITUDE = 'channel = "amplitude", unit = "g"'


@pytest.mark.parametrize(
    ("old", "new", "key", "message"),
    [
        (AMPLITUDE, 'channel = "amplitude", unit = "kg"', "table.channels[1].unit", "displacement, velocity or accel"),
        ('unit = "deg", of', 'unit = "mm", of', "table.channels[2].unit", "can be given in rad, got"),
        ('unit = "Hz"', 'unit = "rad/s"', "table.frequency.unit", "is not converted to Hz"),
        ('unit = "mN"', 'unit = "g"', "excitation.unit", "expected a quantity that can be given in N"),
        ('unit = "mN"\n', "", "excitation", "states no unit; give one, such as unit = "),
        ('"0.05 m/s^2"', '"0.05 s"', "table.channels[1].sigma", "expected a displacement, velocity or acceleration"),
        ('channel = "phase"', 'channel = "phas"', "table.channels[2].channel", "(did you mean 'phase'?)"),
        ('channel = "phase", unit = "deg", of = "displacement"', 'channel = "amplitude", unit = "g"',
         "table.channels[2]", "a second column is the amplitude of body"),
        ('unit = "g", sigma', 'unit = "g", of = "velocity", sigma', "table.channels[1].of", "of belongs to a phase"),
        ("[record.table]\n", '[record.table]\nrate = "2 Hz"\n', "table.rate", "rate is a key that a table over time"),
        ("[record.table]\n", "[record.table]\nfirst = 7\nlast = 1\n", "table.last", "last = 1 is not above first"),
        ("[record.table]\n", "[record.table]\nelements = [1, 3]\n", "table.frequency.column", "'held(3).f'"),
        ('"held(*).F"', '"held(*).G"', "excitation.column", "no single column 'held(1).G' (did you mean"),
        ('"held(*).p"', '"hold(*).p"', "table.channels[2].column", "no single column 'hold(1).p'"),
        ('column = "held(*).F"\nunit = "mN"\n', "", "excitation", "expected the column that is the amplitude"),
        ('quantity = "force"', 'quantity = "torque"', "excitation", "an excitation's quantity is one of"),
        ('place = "mass"\nquantity = "force"', 'place = "mass"\nphase = 1.0\nquantity = "force"', "excitation",
         "drop the keys phase"),
    ],
)  # fmt: skip
def test_a_mistake_is_told_at_its_key(tmp_path, old, new, key, message):
    with pytest.raises(CalibError) as raised:
        load(study(tmp_path, (old, new)))
    assert f": record[1].{key}: " in str(raised.value)
    assert message in str(raised.value)


def test_keys_of_a_response_are_refused_in_a_table_over_time(tmp_path):
    frequency = 'frequency = { column = "held(*).f", unit = "Hz", sigma = "0.01 Hz" }'
    with pytest.raises(CalibError, match="sweep is a key that a frequency response has, and this table has no"):
        load(study(tmp_path, (frequency, 'rate = "1 Hz"\nsweep = "n"')))


HELD = ('unit = "mN"\n', 'unit = "mN"\nheld = "mass"\n')
FIXED = "fixed = { mass = 1, stiffness = 400 }"
DISTORTED = [
    (FIXED, "fixed = { mass = 1, stiffness = 400, h3_sin = 0 }\n[[model.effects]]\nname = 'drive_harmonic_3'"),
    ("[windows]\n", "[windows]\nh3_cos = { low = 0.0, high = 0.1 }\n"),
]
MAPLESS = [
    (f'"oscillator"\n{FIXED}', '"shaken:Shaken"'),
    ("damping = { low = 0.5, high = 2.0 }", "gain = { low = 0.1, high = 0.2 }"),
]


@pytest.mark.parametrize(
    ("changes", "key", "message"),
    [
        ([HELD, *DISTORTED], "excitation.held", "the drive has harmonics, beside which neither a phase nor an ampl"),
        ([HELD, *MAPLESS], "excitation.held", "no period map"),
        (MAPLESS, "excitation", "no period map"),
    ],
)
def test_what_no_simulation_answers_is_refused_when_the_study_is_read(tmp_path, changes, key, message):
    (tmp_path / "shaken.py").write_text(
        "from tiny_simulators import Echo\n"
        "class Shaken(Echo):\n    name, excitations = 'shaken', (('force', 'mass'),)\n"
    )
    with pytest.raises(CalibError, match=rf"{re.escape(key)}: .*{message}"):
        load(study(tmp_path, *changes))
    load(study(tmp_path, *(DISTORTED if key == "excitation" else [HELD])))


def test_a_harmonic_has_columns_of_its_own(tmp_path):
    second = (
        '{ column = "held(*).a", body = "mass", channel = "in-phase", unit = "mm", harmonic = 2, sigma = "1 um" },'
        '{ column = "held(*).p", body = "mass", channel = "quadrature", unit = "um", harmonic = 2 },\n]'
    )
    record = (
        load(study(tmp_path, (' of = "displacement" },\n]', f' of = "displacement" }},\n    {second}')))
        .reference("bench")
        .record
    )
    np.testing.assert_allclose(record.in_phase_2[0], 1e-4)
    np.testing.assert_allclose(record.quadrature_2[0], [-80e-6, -100e-6] * 2)
    np.testing.assert_allclose(record.response_2_sigma, 1e-6)


@pytest.mark.parametrize(
    ("harmonic", "message"),
    [
        ("harmonic = 0", "harmonic"),
        ("harmonic = 8", "harmonic"),
        ("harmonic = 2", r"of body 'mass' there are the columns \['amplitude'\]"),
    ],
)
def test_a_harmonic_that_is_none_is_refused(tmp_path, harmonic, message):
    old = 'channel = "phase", unit = "deg", of = "displacement"'
    with pytest.raises(CalibError, match=message):
        load(study(tmp_path, (old, f"{old}, {harmonic}")))


def test_a_finished_study_of_a_response_is_read_without_its_simulator(tmp_path):
    path = study(tmp_path, HELD)
    for command in (["run", "--quiet"], ["report"]):
        ended = CliRunner().invoke(main, [command[0], str(path), *command[1:]])
        assert ended.exit_code == 0, ended.output
