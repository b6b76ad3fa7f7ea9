"""One instance of an FMU: what FMI 2.0 and 3.0 do alike, under one name each."""

import ctypes
import math
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from calib.errors import CalibError
from calib.simulators.fmu.description import CO_SIMULATION, MODEL_EXCHANGE, FmuDescription, FmuInterface
from calib.simulators.fmu.package import fmpy

STATUSES = {2: "fmu discard", 3: "fmu error", 4: "fmu fatal", 5: "fmu pending"}  # by what a function of FMI returned
DISCARD, FATAL = 2, 4  # of these
TERMINATED = 3  # fmi2StatusKind: whether the FMU wants the simulation to end
MAX_MESSAGES = 5  # of an FMU's log in a reason, the last ones
MAX_EVENT_ITERATIONS = 1000  # updates of the discrete states at one event


class RunFailed(Exception):
    """A run that ended early: the status and the reason of its record."""

    def __init__(self, status: str, reason: str):
        super().__init__(reason)
        self.status = status
        self.reason = reason


class Instance:
    """One instance of an FMU, from its creation to its release.

    Every function that returns more than a warning raises a RunFailed with the last messages of the FMU's log.

    Parameters
    ----------
    folder : of the unpacked files
    outputs, inputs : value references of what is read and set
    """

    def __init__(
        self,
        description: FmuDescription,
        interface: FmuInterface,
        folder: Path,
        outputs: Sequence[int],
        inputs: Sequence[int],
    ):
        self._second = description.version == "2.0"
        self._identifier = interface.identifier
        self._messages: list[str] = []
        self._fatal = False
        self._fmu = _library(folder, description.version, description.token, interface.kind, interface.identifier)
        self._outputs, self._inputs = _references(outputs), _references(inputs)
        self._values = (ctypes.c_double * len(outputs))()
        self._instantiate()
        self.states, self.indicators = description.states, description.indicators
        if not self._second and interface.kind == MODEL_EXCHANGE:
            self.states = self._call(self._fmu.getNumberOfContinuousStates)
            self.indicators = self._call(self._fmu.getNumberOfEventIndicators)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if not self._fatal:  # after which FMI allows no call at all
            free = self._fmu.fmi2FreeInstance if self._second else self._fmu.fmi3FreeInstance
            free(self._fmu.component)
        self._fmu.component = None

    # --- initialisation

    def initialise(
        self, references: Sequence[int], values: Sequence[float], inputs: Sequence[float], start: float,
        tolerance: float | None,
    ) -> None:  # fmt: skip
        """Set the parameters, then the inputs, and compute the initial state at time `start` [s]."""
        if self._second:
            self._call(self._fmu.setupExperiment, tolerance=tolerance, startTime=start)
        self._set(_references(references), values)
        if self._second:
            self._call(self._fmu.enterInitializationMode)
        else:
            self._call(self._fmu.enterInitializationMode, tolerance=tolerance, startTime=start)
        self.set_inputs(inputs)
        self._call(self._fmu.exitInitializationMode)

    def terminate(self) -> None:
        """End the simulation, before the instance is released."""
        self._call(self._fmu.terminate)

    # --- variables

    def read(self) -> np.ndarray:
        """Values (output,) in the units of the FMU."""
        n = len(self._outputs)
        if self._second:
            self._call(self._fmu.fmi2GetReal, self._fmu.component, self._outputs, n, self._values)
        else:
            self._call(self._fmu.fmi3GetFloat64, self._fmu.component, self._outputs, n, self._values, n)
        return np.array(self._values)

    def set_inputs(self, values: Sequence[float], rates: Sequence[float] | None = None) -> None:
        """Set the inputs, in the units of the FMU, and their rates of change, where it interpolates them."""
        if not values:
            return
        self._set(self._inputs, values)
        if rates is not None:
            self._call(self._fmu.setRealInputDerivatives, list(self._inputs), [1] * len(rates), rates)

    def _set(self, references: Any, values: Sequence[float]) -> None:
        n = len(references)
        given = (ctypes.c_double * n)(*values)
        if self._second:
            self._call(self._fmu.fmi2SetReal, self._fmu.component, references, n, given)
        else:
            self._call(self._fmu.fmi3SetFloat64, self._fmu.component, references, n, given, n)

    # --- co-simulation

    def step(self, time: float, length: float) -> None:
        """Advance a co-simulation by a communication step  [s]."""
        if not self._second:
            _, terminates, early, last = self._call(self._fmu.doStep, time, length)
            if terminates or early:
                what = "terminated" if terminates else "returned early from"
                raise self.failed("fmu terminated", f"it {what} the step from {time:.6g} s on at {last:.6g} s")
            return
        try:
            self._call(self._fmu.doStep, time, length)
        except RunFailed as failure:
            if failure.status == STATUSES[DISCARD] and self._wants_to_end():
                raise self.failed("fmu terminated", f"it terminated in the step from {time:.6g} s on") from failure
            raise

    def _wants_to_end(self) -> bool:
        try:
            return bool(self._call(self._fmu.getBooleanStatus, TERMINATED))
        except RunFailed:
            return False

    # --- model exchange

    def enter_continuous_time(self) -> float:
        """Leave the initialisation of a model exchange; see `update`."""
        return self._updated()

    def update(self) -> float:
        """Update the discrete states at an event; time of the next event, inf without one  [s]."""
        self._call(self._fmu.enterEventMode)
        return self._updated()

    def _updated(self) -> float:
        updating = self._fmu.newDiscreteStates if self._second else self._fmu.updateDiscreteStates
        for _ in range(MAX_EVENT_ITERATIONS):
            again, terminates, _, _, timed, next_time = self._call(updating)
            if terminates:
                raise self.failed("fmu terminated", "it terminated at an event")
            if not again:
                self._call(self._fmu.enterContinuousTimeMode)
                return float(next_time) if timed else math.inf
        raise self.failed("step failure", f"the discrete states still change after {MAX_EVENT_ITERATIONS} iterations")

    def place(self, time: float, state: np.ndarray, inputs: Sequence[float]) -> None:
        """Set time [s], continuous states and inputs."""
        self._call(self._fmu.setTime, time)
        self._call(self._fmu.setContinuousStates, (ctypes.c_double * self.states)(*state), self.states)
        self.set_inputs(inputs)

    def continuous_states(self) -> np.ndarray:
        """Continuous states (state,)."""
        return self._vector(self._fmu.getContinuousStates, self.states)

    def nominals(self) -> np.ndarray:
        """Nominal values (state,) of the continuous states."""
        return self._vector(self._fmu.getNominalsOfContinuousStates, self.states)

    def rates(self) -> np.ndarray:
        """Derivatives (state,) of the continuous states."""
        getting = self._fmu.getDerivatives if self._second else self._fmu.getContinuousStateDerivatives
        return self._vector(getting, self.states)

    def event_indicators(self) -> np.ndarray:
        """Event indicators (indicator,)."""
        return self._vector(self._fmu.getEventIndicators, self.indicators) if self.indicators else np.zeros(0)

    def completed_step(self) -> bool:
        """Report a step of the integrator; whether there is an event."""
        event, terminates = self._call(self._fmu.completedIntegratorStep)
        if terminates:
            raise self.failed("fmu terminated", "it terminated after a step of the integrator")
        return bool(event)

    # --- calls

    def failed(self, status: str, reason: str) -> RunFailed:
        """Failure with the last messages of the FMU's log added to its reason."""
        said = "; ".join(self._messages[-MAX_MESSAGES:])
        return RunFailed(status, f"{self._identifier}: {reason}{f' ({said})' if said else ''}")

    def _vector(self, getting: Callable[..., Any], size: int) -> np.ndarray:
        values = (ctypes.c_double * size)()
        self._call(getting, values, size)
        return np.array(values)

    def _call(self, function: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
        try:
            return function(*arguments, **named)
        except fmpy().fmi1.FMICallException as error:
            self._fatal = self._fatal or error.status == FATAL
            status = STATUSES.get(error.status, "fmu error")
            raise self.failed(status, f"{error.function} returned {status.removeprefix('fmu ')}") from error

    def _instantiate(self) -> None:
        package = fmpy()
        try:
            if self._second:
                callbacks = package.fmi2.fmi2CallbackFunctions()
                callbacks.logger = package.fmi2.fmi2CallbackLoggerTYPE(lambda *given: self._log(given[3], given[4]))
                callbacks.allocateMemory = package.fmi2.fmi2CallbackAllocateMemoryTYPE(package.calloc)
                callbacks.freeMemory = package.fmi2.fmi2CallbackFreeMemoryTYPE(package.free)
                if hasattr(package, "logging"):  # which formats the messages; not there for every machine
                    package.logging.addLoggerProxy(ctypes.byref(callbacks))
                self._fmu.instantiate(callbacks=callbacks)
            else:
                self._fmu.instantiate(logMessage=lambda *given: self._log(given[2], given[3]))
        except Exception as error:  # a bare one of fmpy
            raise self.failed("fmu error", f"no instance can be made: {error}") from error

    def _log(self, category: bytes, message: bytes) -> None:
        self._messages.append((message or category or b"").decode(errors="replace").strip())


@cache
def _library(folder: Path, version: str, token: str, kind: str, identifier: str) -> Any:
    """Load the shared library of an FMU, once a process: some do not survive to be unloaded.

    Raises
    ------
    CalibError : it does not load, or lacks a function of FMI
    """
    package = fmpy()
    module = package.fmi2 if version == "2.0" else package.fmi3
    maker = getattr(module, f"FMU{version[0]}{'Slave' if kind == CO_SIMULATION else 'Model'}")
    try:
        return maker(guid=token, modelIdentifier=identifier, unzipDirectory=str(folder))
    except Exception as error:  # fmpy raises bare Exceptions, ctypes an AttributeError
        raise CalibError(
            f"the shared library of the FMU {identifier!r} does not load: {error}; see that it is built for this "
            "machine, completely, and that the libraries it needs are installed (ldd FILE)"
        ) from error


def _references(references: Sequence[int]) -> Any:
    return (ctypes.c_uint * len(references))(*references)
