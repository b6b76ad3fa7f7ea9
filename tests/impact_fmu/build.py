"""Builds the FMU of `impact_oscillator.c`: ``PYTHONPATH=tests python -m impact_fmu.build FILE`` for one of FMI 2.0."""

import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import fmpy
from fmpy import fmi2, fmi3
from programs import required

FOLDER = Path(__file__).parent
SOURCE = FOLDER / "impact_oscillator.c"
HEADERS = Path(fmpy.__file__).parent / "c-code"
MODEL = "impact_oscillator"
TOKEN = "{8c4e810f-3df3-4a00-8276-176fa3c9f013}"
LIBRARY = {"2.0": "linux64", "3.0": "x86_64-linux"}  # folder in binaries/
UNITS = """
    <Unit name="m"><BaseUnit m="1"/></Unit>
    <Unit name="mm"><BaseUnit m="1" factor="0.001"/></Unit>
    <Unit name="m/s"><BaseUnit m="1" s="-1"/></Unit>
    <Unit name="m/s2"><BaseUnit m="1" s="-2"/></Unit>
    <Unit name="kg"><BaseUnit kg="1"/></Unit>
    <Unit name="N/m"><BaseUnit kg="1" s="-2"/></Unit>
    <Unit name="N.s/m"><BaseUnit kg="1" s="-1"/></Unit>
    <Unit name="1"><BaseUnit/></Unit>
    <Unit name="s"><BaseUnit s="1"/></Unit>
"""
# name, unit, causality, variability, initial, start, index of the state of which it is the derivative
VARIABLES = (
    ("time", "", "independent", "continuous", "", "", ""),
    ("x", "m", "output", "continuous", "exact", "0", ""),
    ("v", "m/s", "output", "continuous", "exact", "0", ""),
    ("der(x)", "m/s", "local", "continuous", "", "", "x"),
    ("der(v)", "m/s2", "local", "continuous", "", "", "v"),
    ("base", "m", "input", "continuous", "", "0", ""),
    ("base_rate", "m/s", "input", "continuous", "", "0", ""),
    ("mass", "kg", "parameter", "fixed", "exact", "1", ""),
    ("spring.stiffness", "N/m", "parameter", "tunable", "exact", "4000", ""),
    ("damping", "N.s/m", "parameter", "tunable", "exact", "8", ""),
    ("gap", "mm", "parameter", "tunable", "exact", "1", ""),
    ("stop_stiffness", "N/m", "parameter", "tunable", "exact", "40000", ""),
    ("fault", "", "parameter", "tunable", "exact", "0", ""),
    ("x_start", "m", "parameter", "fixed", "exact", "0", ""),
    ("restitution", "1", "parameter", "fixed", "exact", "-1", ""),
    ("kick_time", "s", "parameter", "fixed", "exact", "0", ""),
)


def build(
    folder: Path, version: str = "2.0", interface: str = "CoSimulation", name: str = "oscillator.fmu", flags: str = ""
) -> Path:
    """Build the FMU in a folder.

    Parameters
    ----------
    version : of FMI, "2.0" or "3.0"
    interface : "CoSimulation", "ModelExchange", or both with a blank between
    flags : attributes of the interface in the model description
    """
    library = compiled(folder, version)
    path = folder / name
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", description(version, interface.split(), flags))
        archive.write(library, f"binaries/{LIBRARY[version]}/{MODEL}.so")
        archive.writestr("resources/readme.txt", "nothing")
    return path


def compiled(folder: Path, version: str) -> Path:
    """Compile the shared library; the functions of FMI that the model has no use for return an error."""
    library = folder / f"{MODEL}-{version}.so"
    if library.exists():
        return library
    module = {"2.0": fmi2, "3.0": fmi3}[version]
    prefix = f"fmi{version[0]}"
    classes = [getattr(module, f"FMU{version[0]}{kind}") for kind in ("Model", "Slave")]
    wanted = {name for one in classes for name in dir(one) if name.startswith(prefix)}
    defined = set(re.findall(rf"\b({prefix}\w+)\(", SOURCE.read_text()))
    stubs = folder / f"stubs-{version}.c"
    stubs.write_text("".join(f"int {name}(void) {{ return 3; }}\n" for name in sorted(wanted - defined)))
    define = ["-DFMI3"] if version == "3.0" else []
    command = [required("cc"), "-O1", "-shared", "-fPIC", *define, f"-I{HEADERS}", str(SOURCE), str(stubs)]
    subprocess.run([*command, "-o", str(library), "-lm"], check=True, capture_output=True)
    return library


def description(version: str, interfaces: list[str], flags: str = "") -> str:
    """Return the model description."""
    own = {"ModelExchange": 'needsCompletedIntegratorStep="true"'} if version == "3.0" else {}
    kinds = "".join(f'<{kind} modelIdentifier="{MODEL}" {own.get(kind, "")} {flags}/>' for kind in interfaces)
    token = "guid" if version == "2.0" else "instantiationToken"
    indicators = ' numberOfEventIndicators="1"' if version == "2.0" else ""
    write = _second if version == "2.0" else _third
    variables = "".join(write(reference, *row) for reference, row in enumerate(VARIABLES))
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="{version}" modelName="{MODEL}" {token}="{TOKEN}"{indicators}>
  {kinds}
  <UnitDefinitions>{UNITS}</UnitDefinitions>
  <DefaultExperiment stepSize="0.001"/>
  <ModelVariables>{variables}</ModelVariables>
  <ModelStructure>{_structure(version)}</ModelStructure>
</fmiModelDescription>
"""


def _structure(version: str) -> str:
    if version == "2.0":
        return (
            '<Outputs><Unknown index="2"/><Unknown index="3"/></Outputs>'
            '<Derivatives><Unknown index="4"/><Unknown index="5"/></Derivatives>'
        )
    return (
        '<Output valueReference="1"/><Output valueReference="2"/><ContinuousStateDerivative valueReference="3"/>'
        '<ContinuousStateDerivative valueReference="4"/><EventIndicator valueReference="1"/>'
    )


def _attributes(**given: str) -> str:
    return "".join(f' {name}="{value}"' for name, value in given.items() if value)


def _second(reference: int, name: str, unit: str, causality: str, variability: str, initial: str, start: str, of: str):
    index = str([row[0] for row in VARIABLES].index(of) + 1) if of else ""
    head = _attributes(name=name, valueReference=str(reference), causality=causality, variability=variability)
    head += _attributes(initial=initial)
    return f"<ScalarVariable{head}><Real{_attributes(unit=unit, start=start, derivative=index)}/></ScalarVariable>"


def _third(reference: int, name: str, unit: str, causality: str, variability: str, initial: str, start: str, of: str):
    index = str([row[0] for row in VARIABLES].index(of)) if of else ""
    head = _attributes(name=name, valueReference=str(reference), causality=causality, variability=variability)
    return f"<Float64{head}{_attributes(initial=initial, unit=unit, start=start, derivative=index)}/>"


if __name__ == "__main__":
    target = Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as scratch:
        shutil.copy(build(Path(scratch)), target)
