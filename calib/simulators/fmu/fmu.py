"""The simulator `fmu`: a Functional Mock-up Unit as a simulator."""

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
import xarray as xr

from calib.errors import CalibError, nearest
from calib.modelling.laws import BoundLaw
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Request
from calib.modelling.simulator_check import check_driven
from calib.records import MIN_SECTION_PERIODS, STATE, failed, make
from calib.records.excitation import Excitation
from calib.simulators.fmu.archive import unpacked
from calib.simulators.fmu.co_simulation import CoSimulation
from calib.simulators.fmu.description import CO_SIMULATION
from calib.simulators.fmu.instance import Instance, RunFailed
from calib.simulators.fmu.model_exchange import SOLVERS, ModelExchange
from calib.simulators.fmu.motion import settled_motion
from calib.simulators.fmu.options import FREE_DECAY, FmuUse, fmu_use
from calib.simulators.fmu.signals import input_signal
from calib.units import to_si

SOLVER_TOLERANCE = 1e-6  # of a solver, where neither the options nor the FMU state one  [1]
MIN_SOLVER_STEPS_PER_PERIOD = 40  # of a model exchange
TOLERANCE_POWER = 4  # of the refinement of a time step, by which the tolerance of a solver is divided


class Fmu:
    """A Functional Mock-up Unit of FMI 2.0 or 3.0 (extra `calib[fmu]`).

    Units are those of the FMU's own definitions, converted to SI; for a variable without a unit the options state it.

    Attributes
    ----------
    path : of the .fmu, relative to the study file; its SHA-256 belongs to the study's identity
    parameters : variables that are parameters of the study: a list of names, `["stiffness", "gap"]`, or a table of
        tables, `{ gap = { variable = "stop.gap", unit = "mm", nominal = "1 mm" } }`, where each key has a default: the
        name, the FMU's unit and its start value
    outputs : for each body its channels and their variables: `{ mass = { displacement = "x", velocity = "v" } }`,
        or `{ variable = "x", unit = "mm" }` in the place of a name
    input : what the excitation of a record sets: `{ quantity = "base motion", place = "base", displacement =
        "u", velocity = "du" }`. Keys of a motion are displacement, velocity and acceleration, that of a force is force.
        Without it, only free decays are simulated
    interface : "co-simulation" or "model exchange"; default: what the FMU offers, co-simulation if both
    step : communication step of a co-simulation, or longest step of a model exchange, such as "0.1 ms"; it is divided
        so that samples fall on steps. Default: the step of the FMU's default experiment, at most the interval between
        samples, and a 40th of a period
    tolerance : relative tolerance, of a model exchange's solver or for the co-simulation; default: the FMU's, else 1e-6
    solver : of a model exchange: "RK45", "DOP853", "Radau" or "BDF" of scipy
    section : periods of the stroboscopic section, at least; the kind of motion is judged best by 64
    initial : parameters that set the initial state, each with body and channel, as in `{ x0 = "mass.displacement" }`
    """

    name = "fmu"
    sites = frozenset[str]()

    def __init__(
        self,
        path: str,
        parameters: Sequence[str] | Mapping[str, Mapping[str, Any]],
        outputs: Mapping[str, Mapping[str, Any]],
        input: Mapping[str, Any] | None = None,
        interface: str | None = None,
        step: str | float | None = None,
        tolerance: float | None = None,
        solver: str = "RK45",
        section: int = MIN_SECTION_PERIODS,
        initial: Mapping[str, str] | None = None,
    ) -> None:
        for name, text in (("path", path), ("solver", solver), ("interface", "" if interface is None else interface)):
            if not isinstance(text, str):
                raise CalibError(f"{name}: expected a text, got {text!r}")
        self._path = path
        self._stated = parameters, outputs, input, interface, initial
        self._step = None if step is None else _seconds("step", step)
        self._tolerance = None if tolerance is None else _positive("tolerance", tolerance)
        if solver not in SOLVERS:
            raise CalibError(f"solver: expected one of {', '.join(SOLVERS)}, got {solver!r}{nearest(solver, SOLVERS)}")
        self._solver = solver
        self._section = int(_positive("section", section))
        self._refinement = 1.0
        self._unpacked: Path | None = None

    def placed(self, study: Path, results: Path, modules: Path | None) -> Self:
        """Return the same with its path relative to the folder of the study, read there.

        Raises
        ------
        CalibError : no FMU that can be run here, or options that do not fit it
        """
        other = self._copy()
        other._use = fmu_use(study / self._path, *self._stated)
        return other

    def _copy(self) -> Self:
        """Copy without `__getstate__`, which would unpack the FMU."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)
        return other

    @cached_property
    def _use(self) -> FmuUse:
        return fmu_use(Path(self._path), *self._stated)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters that the options expose."""
        return tuple(variable.parameter for variable in self._use.parameters)

    @property
    def bodies(self) -> tuple[str, ...]:
        """Bodies of the outputs."""
        return tuple(dict.fromkeys(output.body for output in self._use.outputs))

    @property
    def initial(self) -> Mapping[str, tuple[str, str]]:
        """Parameters of the initial state."""
        return self._use.initial

    @property
    def excitations(self) -> frozenset[tuple[str, str]]:
        """Pairs (quantity, place) of the input, and free decays."""
        driven = self._use.input
        pairs = () if driven is None else ((driven.quantity, driven.place),)
        return frozenset([*pairs, *((FREE_DECAY, body) for body in self.bodies)])

    @property
    def code(self) -> dict[str, str]:
        """SHA-256 of the FMU."""
        return {f"file {self._path}": f"sha256 {self._use.fmu.sha256}"}

    @property
    def numerics(self) -> frozenset[str]:
        """The time step, unless the FMU states its own."""
        return frozenset() if self._use.interface.internal_step else frozenset({"time_step"})

    def __getstate__(self) -> dict[str, Any]:
        """Unpack the FMU for the processes that this simulator is sent to: this one removes the files in the end."""
        return {**self.__dict__, "_use": self._use, "_unpacked": unpacked(self._use.fmu.path, self._use.fmu.sha256)}

    def finer(self, what: str, factor: float) -> Self:
        """Return the same with its steps, and in a model exchange the tolerance too, refined by `factor`."""
        other = self._copy()
        other._refinement = self._refinement * factor
        return other

    def run(
        self, values: Mapping[str, float], excitation: Excitation, laws: Sequence[BoundLaw], request: Request
    ) -> xr.Dataset:
        """Simulate at `values` (SI); what the FMU or its solver reports as an error is a failed record.

        Raises
        ------
        CalibError : an excitation that it cannot take, a free decay without output times, or an FMU that does not load
        """
        self.check(excitation, request)
        attrs: dict[str, Any] = {"source": self.name, **excitation.attributes}
        for name, value in values.items():
            if not math.isfinite(value):
                return failed(self.bodies, "impossible value", f"{name} is {value}", **attrs)
        try:
            return self._simulated(values, excitation, request, attrs)
        except RunFailed as failure:
            return failed(self.bodies, failure.status, failure.reason, **attrs)

    def check(self, excitation: Excitation, request: Request) -> None:
        """Refuse an excitation that the FMU has no input for, and output times that cannot be.

        Raises
        ------
        CalibError : with what it takes
        """
        check_driven(self.name, excitation, self.excitations)
        if excitation.recorded and excitation.cutoff is None and any(v.order > 1 for v in self._use.driven(excitation)):
            raise CalibError(
                "a recorded motion is differentiated twice for the acceleration the FMU takes, and never silently: "
                'state the low-pass that goes before, as in cutoff = "100 Hz" in [record.excitation]'
            )
        _times(excitation, request)

    def _simulated(
        self, values: Mapping[str, float], excitation: Excitation, request: Request, attrs: Mapping[str, Any]
    ) -> xr.Dataset:
        use, folder = self._use, self._unpacked
        if folder is None or not folder.is_dir():  # in this process, or on another machine
            folder = unpacked(use.fmu.path, use.fmu.sha256)
        driven = use.driven(excitation)
        outputs = [output.reference for output in use.outputs]
        with Instance(use.fmu, use.interface, folder, outputs, [v.reference for v in driven]) as instance:
            run, times = self._begun(instance, values, excitation, request)
            if excitation.harmonic:
                period, periods = excitation.as_harmonic.period, max(request.periods, self._section)
                rows = settled_motion(run, period, request.samples, periods, request.settle)
            else:
                rows = run.advance(times)
            instance.terminate()
        channels = self._channels(rows)
        if not excitation.harmonic:
            return make(times, self.bodies, channels, self._units(), **attrs)
        section = {name: channels[name][:, :: request.samples] for name in STATE if name in channels}
        count = request.periods * request.samples
        last = {name: values[:, -count:] for name, values in channels.items()}
        return make(times, self.bodies, last, self._units(), section=section, **attrs)

    def _begun(
        self, instance: Instance, values: Mapping[str, float], excitation: Excitation, request: Request
    ) -> tuple[CoSimulation | ModelExchange, np.ndarray]:
        """Initialise an instance; what runs it on, and the times of the record (n,) [s]."""
        use, times = self._use, _times(excitation, request)
        start = float(excitation.as_samples.time[0]) if excitation.recorded else min(0.0, float(times[0]))
        signal = input_signal(excitation, use.driven(excitation))
        tolerance = self._tolerance or use.fmu.tolerance
        given = [variable.unit.from_si(values[variable.parameter.name]) for variable in use.parameters]
        references = [variable.reference for variable in use.parameters]
        instance.initialise(references, given, signal(start), start, tolerance)
        interval = _mean_interval(times)
        finest = min(interval, _mean_interval(excitation.as_samples.time)) if excitation.recorded else interval
        if use.interface.kind == CO_SIMULATION:
            step = self._communication_step(interval, finest)
            return CoSimulation(instance, signal, use.interface.interpolates, start, step, request.step_budget), times
        longest = excitation.as_harmonic.period / MIN_SOLVER_STEPS_PER_PERIOD if excitation.harmonic else finest
        run = ModelExchange(
            instance,
            signal,
            use.interface.reports_steps,
            start,
            self._solver,
            (tolerance or SOLVER_TOLERANCE) / self._refinement**TOLERANCE_POWER,
            (self._step or longest) / self._refinement,
            request.step_budget,
        )
        return run, times

    def _communication_step(self, interval: float, finest: float) -> float:
        """Largest step [s] that divides the interval between samples, or is a multiple of the FMU's internal step.

        finest : interval between the samples of the record or, where it is less, of the input  [s]
        """
        wanted = min(self._step or self._use.fmu.step or finest, finest)
        internal = self._use.interface.internal_step
        if internal:
            return internal * max(1, math.floor(wanted / internal * (1.0 + 1e-9)))
        return interval / math.ceil(self._refinement * interval / wanted * (1.0 - 1e-9))

    def _channels(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        """Channels (body, n) in SI of the outputs (n, output) in the FMU's units."""
        channels: dict[str, list[np.ndarray]] = {}
        for output, column in zip(self._use.outputs, rows.T, strict=True):
            channels.setdefault(output.channel, []).append(output.unit.factor * column + output.unit.offset)
        return {name: np.array(bodies) for name, bodies in channels.items()}

    def _units(self) -> dict[str, str]:
        return {output.channel: output.si for output in self._use.outputs}


def _seconds(name: str, time: str | float) -> float:
    try:
        return _positive(name, to_si(time, "s"))
    except CalibError as error:
        raise CalibError(f"{name}: expected a time above 0 s such as '0.1 ms', got {time!r} ({error})") from error


def _positive(name: str, value: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < math.inf:
        raise CalibError(f"{name}: expected a positive number, got {value!r}")
    return value


def _mean_interval(times: np.ndarray) -> float:
    return float(times[-1] - times[0]) / (times.size - 1)


def _times(excitation: Excitation, request: Request) -> np.ndarray:
    """Output times (n,) [s].

    Raises
    ------
    CalibError : none for a free decay, fewer than two, not increasing, or before the recorded input begins
    """
    if excitation.harmonic:
        tone = excitation.as_harmonic
        return np.arange(request.periods * request.samples) / (tone.frequency * request.samples)
    recorded = excitation.as_samples.time if excitation.recorded else None
    times = request.output_times(recorded)
    if recorded is not None and times[0] < recorded[0]:
        raise CalibError(
            f"output is requested from {times[0]:.6g} s on, the input begins at {recorded[0]:.6g} s; cut it"
        )
    return times
