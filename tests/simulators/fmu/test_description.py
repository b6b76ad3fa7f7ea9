"""What is refused of a file that is no FMU that can be run here, and units of variables."""

import re
import zipfile

import pytest
from impact_fmu.build import description

from calib.errors import CalibError
from calib.simulators.fmu.description import read_description
from calib.simulators.fmu.units import UnitDefinition, VariableUnit, defined_unit, named_unit


@pytest.fixture
def archived(tmp_path):
    """Write an FMU with this description and these other files, and read it."""

    def read(text, *names):
        with zipfile.ZipFile(tmp_path / "some.fmu", "w") as archive:
            archive.writestr("modelDescription.xml", text)
            for name in names:
                archive.writestr(name, "")
        return read_description(tmp_path / "some.fmu")

    return read


OWN = "binaries/linux64/impact_oscillator.so"
GOOD = description("2.0", ["CoSimulation"])


def test_a_description_is_read(archived):
    read = archived(GOOD, OWN)
    assert (read.version, list(read.interfaces), read.states, read.indicators) == ("2.0", ["co-simulation"], 2, 1)
    assert read.variables["spring.stiffness"].start == 4000.0


@pytest.mark.parametrize(
    ("text", "names", "message"),
    [
        ("<broken", [OWN], "is no FMU that can be read"),
        ("<a/>", [OWN], "is no FMU that can be read"),
        (GOOD, ["binaries/win64/impact_oscillator.dll"], "has no binary for linux64 .it has win64"),
        (GOOD, ["sources/a.c"], "its C code can be compiled: fmpy compile"),
        (re.sub(r"<CoSimulation[^>]*/>", "", GOOD), [OWN], "offers neither co-simulation nor model exchange"),
        (GOOD.replace('fmiVersion="2.0"', 'fmiVersion="4.0"'), [OWN], "Unsupported FMI version"),
    ],
)
def test_what_cannot_be_run_here_is_refused(archived, text, names, message):
    with pytest.raises(CalibError, match=message):
        archived(text, *names)


def test_a_file_that_is_absent_or_no_archive_is_refused(tmp_path):
    with pytest.raises(CalibError, match="there is no file .*relative to the study file"):
        read_description(tmp_path / "absent.fmu")
    (tmp_path / "text.fmu").write_text("text")
    with pytest.raises(CalibError, match="is no FMU that can be read"):
        read_description(tmp_path / "text.fmu")


@pytest.mark.parametrize(
    ("name", "powers", "factor", "offset", "expected"),
    [
        ("N/m", {"kg": 1, "s": -2}, 1.0, 0.0, "N/m"),
        ("N.s/m", {"kg": 1, "s": -1}, 1.0, 0.0, "N s/m"),
        ("m/s2", {"m": 1, "s": -2}, 1.0, 0.0, "m/s^2"),
        ("mm", {"m": 1}, 1e-3, 0.0, "m"),
        ("degC", {"K": 1}, 1.0, 273.15, "K"),
        ("rpm", {"rad": 1, "s": -1}, 0.10471975511965977, 0.0, "rad/s"),
        ("Hz", {"s": -1}, 1.0, 0.0, "Hz"),
        ("1", {}, 1.0, 0.0, "1"),
        ("a unit of its own", {"kg": 1, "m": 2, "s": -2}, 1.0, 0.0, "kg m^2/s^2"),
    ],
)
def test_a_defined_unit_is_converted_to_si(name, powers, factor, offset, expected):
    unit = defined_unit(name, UnitDefinition(powers, factor, offset))
    assert unit == VariableUnit(expected, factor, offset)
    assert unit.from_si(unit.to_si(3.0)) == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("name", "expected", "three"),
    [("N.m/rad", "N m/rad", 3.0), ("mm", "m", 3e-3), ("kN/mm", "N/m", 3e6), ("deg", "rad", 0.05235987755982989)],
)
def test_a_unit_without_definition_is_read_by_its_name(name, expected, three):
    unit = named_unit(name)
    assert (unit.si, unit.to_si(3.0)) == (expected, pytest.approx(three))


def test_a_unit_that_is_none_has_to_be_stated(archived):
    read = archived(GOOD.replace('unit="mm" start', 'unit="ticks" start'), OWN)
    variable = read.variables["gap"]
    with pytest.raises(CalibError, match="in 'ticks', which is not understood .*state the unit"):
        read.unit(variable, None, "parameters.gap")
    assert read.unit(variable, "mm", "parameters.gap").to_si(2.0) == pytest.approx(2e-3)
