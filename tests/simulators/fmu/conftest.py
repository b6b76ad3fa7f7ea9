"""FMUs that are built once, where a test asks for them."""

from pathlib import Path

import pytest
from impact_fmu.build import build

from calib.simulators.fmu import Fmu

PARAMETERS = {"stiffness": {"variable": "spring.stiffness"}, "mass": {}, "damping": {}, "gap": {}, "stop_stiffness": {}}
OUTPUTS = {"mass": {"displacement": "x", "velocity": "v"}}
INPUT = {"quantity": "base motion", "place": "base", "displacement": "base", "velocity": "base_rate"}


@pytest.fixture(scope="session")
def fmu_file(tmp_path_factory):
    """Build the FMU of a version and an interface, with attributes of the interface."""
    folder = tmp_path_factory.mktemp("fmus")
    built: dict[tuple[str, str, str], Path] = {}

    def file(version="2.0", interface="CoSimulation", flags=""):
        key = version, interface, flags
        if key not in built:
            built[key] = build(folder, version, interface, f"oscillator{len(built)}.fmu", flags)
        return built[key]

    return file


@pytest.fixture(scope="session")
def fmu(fmu_file):
    """Make the simulator of an FMU, with some options changed."""

    def simulator(version="2.0", kind="CoSimulation", flags="", **options):
        path = fmu_file(version, kind, flags)
        given = {"parameters": PARAMETERS, "outputs": OUTPUTS, "input": INPUT} | options
        return Fmu(path.name, **given).placed(path.parent, path.parent / "out", None)

    return simulator
