"""What the model description of an FMU says, as far as it matters here."""

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calib.errors import CalibError, nearest
from calib.execution.files import checksum
from calib.simulators.fmu.package import fmpy
from calib.simulators.fmu.units import UnitDefinition, VariableUnit, defined_unit, named_unit

VERSIONS = ("2.0", "3.0")  # of FMI
REAL_TYPES = ("Real", "Float64")  # of FMI 2.0 and 3.0
CO_SIMULATION, MODEL_EXCHANGE = "co-simulation", "model exchange"
BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
MAX_DESCRIPTION_BYTES = 200_000_000  # of modelDescription.xml
MAX_LISTED_VARIABLES = 12  # names in a message


@dataclass(frozen=True)
class FmuVariable:
    """A variable of an FMU; `start`, `low` and `high` are in its own unit."""

    name: str
    reference: int
    type: str
    scalar: bool
    causality: str
    settable: bool
    unit: str
    start: float | None
    low: float | None
    high: float | None
    meaning: str


@dataclass(frozen=True)
class FmuInterface:
    """How an FMU is run.

    Attributes
    ----------
    kind : "co-simulation" or "model exchange"
    identifier : name of its shared library
    internal_step : of a co-simulation, of which communication steps are multiples  [s]
    interpolates : whether it takes the derivatives of its inputs
    reports_steps : whether each step of the integrator is reported to it
    """

    kind: str
    identifier: str
    internal_step: float | None = None
    interpolates: bool = False
    reports_steps: bool = True


@dataclass(frozen=True)
class FmuDescription:
    """An FMU, its interfaces by kind, its variables by name and the units it defines.

    Attributes
    ----------
    token : by which the shared library recognises its description
    states, indicators : numbers of continuous states and of event indicators; FMI 3.0 asks the instance instead
    step, tolerance : of its default experiment  [s], [1]
    """

    path: Path
    sha256: str
    version: str
    token: str
    interfaces: Mapping[str, FmuInterface]
    variables: Mapping[str, FmuVariable]
    definitions: Mapping[str, UnitDefinition]
    states: int
    indicators: int
    step: float | None
    tolerance: float | None

    @property
    def label(self) -> str:
        """Name of the file, for messages."""
        return self.path.name

    def variable(self, name: str, where: str, causality: str = "") -> FmuVariable:
        """Return a real scalar variable by its name.

        Parameters
        ----------
        where : key of the option, with which a message begins
        causality : "parameter" or "input", where it has to be one

        Raises
        ------
        CalibError : there is none, or it is something else
        """
        fitting = [other for other in self.variables.values() if _fits(other, causality)]
        variable = self.variables.get(name)
        if variable is not None and variable.type in REAL_TYPES and variable.scalar and _fits(variable, causality):
            return variable
        names = [other.name for other in fitting if other.type in REAL_TYPES and other.scalar]
        more = len(names) - MAX_LISTED_VARIABLES
        listed = ", ".join(names[:MAX_LISTED_VARIABLES]) + (f" and {more} more" if more > 0 else "")
        kind = causality or "variable"
        if variable is None:
            got = f"has no {kind} {name!r}{nearest(name, names)}"
        elif variable.type not in REAL_TYPES or not variable.scalar:
            what = variable.type if variable.scalar else f"an array of {variable.type}"
            got = f"has {name!r} as {what}; expected a scalar of type {' or '.join(REAL_TYPES)}"
        else:
            got = f"has {name!r} as {variable.causality} that cannot be set, not as {kind}"
        raise CalibError(f"{where}: {self.label} {got}; it has the {kind}s {listed or '(none)'}")

    def unit(self, variable: FmuVariable, stated: str | None, where: str) -> VariableUnit:
        """Return the unit of a variable: the FMU's own, or the one that is stated.

        Raises
        ------
        CalibError : there is neither, or the two differ
        """
        own = self._own_unit(variable, stated, where)
        if stated is None and own is None:
            raise CalibError(
                f"{where}: {self.label} gives {variable.name!r} no unit; state it, as in "
                f'{{ variable = "{variable.name}", unit = "mm" }}, or unit = "1" for a pure number'
            )
        given = own if stated is None else named_unit(stated)
        if given is None:
            raise AssertionError("a unit is stated, or the FMU's own")
        if own is not None and stated is not None and (own.factor, own.offset) != (given.factor, given.offset):
            raise CalibError(
                f"{where}: {self.label} gives {variable.name!r} in {variable.unit!r}, the option states {stated!r}; "
                "drop the option's unit"
            )
        return given

    def _own_unit(self, variable: FmuVariable, stated: str | None, where: str) -> VariableUnit | None:
        if variable.unit in self.definitions:
            return defined_unit(variable.unit, self.definitions[variable.unit])
        if not variable.unit:
            return None
        try:
            return named_unit(variable.unit)
        except CalibError as error:
            if stated is not None:
                return None
            raise CalibError(
                f"{where}: {self.label} gives {variable.name!r} in {variable.unit!r}, which is not understood "
                f"({error}); state the unit in the options"
            ) from error

    def interface(self, kind: str | None) -> FmuInterface:
        """Return the interface that is asked for; None: co-simulation, where the FMU offers both.

        Raises
        ------
        CalibError : the FMU does not offer it
        """
        if kind is None:
            return next(iter(self.interfaces.values()))
        if kind not in self.interfaces:
            offered = " and ".join(self.interfaces)
            raise CalibError(f"interface: {self.label} offers {offered}, got {kind!r}{nearest(kind, self.interfaces)}")
        return self.interfaces[kind]


def read_description(path: Path) -> FmuDescription:
    """Read the model description of an FMU; none of its code runs.

    Raises
    ------
    CalibError : no such file, no FMU, another version of FMI, or no binary for this machine
    """
    package = fmpy()
    if not path.is_file():
        raise CalibError(f"path: there is no file {path}; state the path of the .fmu relative to the study file")
    try:
        with zipfile.ZipFile(path) as archive:
            size = archive.getinfo("modelDescription.xml").file_size
        if size > MAX_DESCRIPTION_BYTES:
            raise CalibError(f"path: the model description of {path.name} has {size:.3g} bytes, too many to be one")
        described = package.read_model_description(str(path), validate=False)
        platforms = package.supported_platforms(str(path))
    except CalibError:
        raise
    except Exception as error:  # fmpy raises bare Exceptions, and what lxml and zipfile raise
        raise CalibError(f"path: {path} is no FMU that can be read: {error}; export it again") from error
    version = str(described.fmiVersion)
    version = "3.0" if version.startswith("3.") else version
    if version not in VERSIONS:
        raise CalibError(f"path: {path.name} is of FMI {version}, expected {' or '.join(VERSIONS)}; export it so")
    if package.platform not in platforms:
        hint = "; its C code can be compiled: fmpy compile FILE" if "c-code" in platforms else ""
        raise CalibError(
            f"path: {path.name} has no binary for {package.platform} (it has {', '.join(platforms) or 'none'}){hint}"
        )
    return _description(path, version, described)


def _description(path: Path, version: str, described: Any) -> FmuDescription:
    interfaces = {}
    co_simulation, model_exchange = described.coSimulation, described.modelExchange
    if co_simulation is not None:
        interfaces[CO_SIMULATION] = FmuInterface(
            CO_SIMULATION,
            co_simulation.modelIdentifier,
            internal_step=_number(co_simulation.fixedInternalStepSize),
            interpolates=version == "2.0" and co_simulation.canInterpolateInputs,
        )
    if model_exchange is not None:
        interfaces[MODEL_EXCHANGE] = FmuInterface(
            MODEL_EXCHANGE, model_exchange.modelIdentifier, reports_steps=model_exchange.needsCompletedIntegratorStep
        )
    if not interfaces:
        raise CalibError(f"path: {path.name} offers neither {CO_SIMULATION} nor {MODEL_EXCHANGE}; export it again")
    experiment = described.defaultExperiment
    return FmuDescription(
        path=path,
        sha256=checksum(path),
        version=version,
        token=described.guid,
        interfaces=interfaces,
        variables={one.name: _variable(one) for one in described.modelVariables},
        definitions={
            unit.name: _definition(unit.baseUnit) for unit in described.unitDefinitions if unit.baseUnit is not None
        },
        states=described.numberOfContinuousStates,
        indicators=described.numberOfEventIndicators,
        step=None if experiment is None else _number(experiment.stepSize),
        tolerance=None if experiment is None else _number(experiment.tolerance),
    )


def _variable(given: Any) -> FmuVariable:
    real = given.type in REAL_TYPES and not given.dimensions
    declared = given.declaredType
    return FmuVariable(
        name=given.name,
        reference=given.valueReference,
        type=given.type,
        scalar=not given.dimensions,
        causality=given.causality,
        settable=given.variability != "constant" and given.initial in ("exact", "approx"),
        unit=given.unit or getattr(declared, "unit", None) or "",
        start=_number(given.start) if real else None,
        low=_number(given.min or getattr(declared, "min", None)) if real else None,
        high=_number(given.max or getattr(declared, "max", None)) if real else None,
        meaning=given.description or f"{given.causality} {given.name} of the FMU",
    )


def _definition(base: Any) -> UnitDefinition:
    powers = {name: getattr(base, name) for name in BASE_UNITS if getattr(base, name)}
    return UnitDefinition(powers, base.factor, base.offset)


def _fits(variable: FmuVariable, causality: str) -> bool:
    if causality == "parameter":
        return variable.settable and variable.causality in ("parameter", "local", "output")
    return variable.causality == causality if causality else variable.causality != "independent"


def _number(text: str | float | None) -> float | None:
    """Return a number of the model description; None where there is none, or it is no number."""
    try:
        return None if text is None else float(text)
    except ValueError:
        return None
