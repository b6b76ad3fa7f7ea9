"""The simulator `command`: any external program, from a study file alone."""

import copy
import inspect
import math
import shlex
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import xarray as xr

from calib.errors import CalibError, nearest
from calib.modelling.dry_run import DryRun
from calib.modelling.laws import BoundLaw
from calib.modelling.simulator import Request
from calib.records import failed
from calib.records.excitation import Excitation
from calib.simulators.command.deck import KNOWN, deck_values, ignored_parts, output_times
from calib.simulators.command.dry_run import DRY_RUN, facts_of
from calib.simulators.command.evaluation import RUNS, ProgramRun, Surroundings, evaluated
from calib.simulators.command.inputs import Inputs, read_inputs
from calib.simulators.command.known_files import known_file
from calib.simulators.command.options import SIGNATURE, CommandOptions, described
from calib.simulators.command.quantities import declared_parameters
from calib.simulators.command.readers import check_options, reader_code
from calib.simulators.command.reading import Instants
from calib.simulators.command.templates import TemplateFault, check_names

STEP_BUDGET, IMPOSSIBLE = "step budget", "impossible value"  # statuses


class Command:
    """Any external program: templates of its input, its command lines, and a reader of its output.

    Each run has a folder of its own below `runs/` in the folder of the results, in which the templates are rendered and
    the command line is run without a shell. A program that fails is answered by the next command line of `run`, and
    where all fail the record says why, with the last lines of the log. A run that is given up is ended with all
    processes that it has started, and so are all runs when `calib` ends, however it ends.

    In templates (jinja2) stand the parameters by name, in SI, `cores`, and the fields of

    excitation : quantity, place, unit, frequency, period, omega, amplitude, phase; of a recorded input time, value, and
        samples, which have both; harmonic, recorded, periodic
    request : step, start, end and times of the output that is read; of a harmonic excitation periods, samples a period
        and settle; step_budget

    with the filters unit("MPa"), from SI, fortran("E12.5"), fixed(8), a field of 8 characters, and sin and cos of an
    angle in radians. Whatever is undefined is refused, and so is a parameter that no template names. The program's time
    begins at 0; the record begins `settle` periods later. Output on other instants than those of the request is
    interpolated, which the record says.

    Parameters
    ----------
    {options}
    """

    name = "command"
    sites: frozenset[str] = frozenset()
    incidental = frozenset({"keep", "cache", "folder"})

    __signature__ = SIGNATURE

    def __init__(self, **options: Any) -> None:
        self._options = CommandOptions.of(options)
        self._reading = self._options.reading.reading
        self.parameters = declared_parameters(self._options.program.parameters)
        names = [p.name for p in self.parameters]
        for name in names:
            if name in KNOWN:
                raise CalibError(f"parameters: {name!r} is the name of something else in templates; rename it")
        self.bodies = tuple(self._reading.channels)
        if self._options.reading.excitations is not None:
            self.excitations = self._options.reading.excitations
        self._study = Path.cwd() / (self._options.program.folder or "")
        self._results: Path | None = None
        self._modules: Path | None = None
        self._afresh = False
        self._inputs: Inputs | None = None

    def placed(self, study: Path, results: Path, modules: Path | None) -> "Command":
        """Return the same, of a study: see `calib.modelling.simulator.Simulator`.

        Raises
        ------
        CalibError : a file or program is missing, a template names what there is not, a parameter is in none
        """
        other = copy.copy(self)
        other._study = study / (self._options.program.folder or "")
        other._results, other._modules = results.absolute(), modules
        other._inputs = other._read()
        return other

    def afresh(self) -> "Command":
        """Return the same, answering nothing from its cache."""
        other = copy.copy(self)
        other._afresh = True
        return other

    @property
    def title(self) -> str:
        """Name of the program, with that of the simulator."""
        program = shlex.split(self._options.program.run[0])[0]
        return f"{Path(program).name} ({self.name})"

    @property
    def cores(self) -> int:
        """Cores that one run uses."""
        return self._options.program.cores

    @property
    def code(self) -> Mapping[str, str]:
        """Identity of templates, files, programs and a reader of one's own, by name."""
        return self._ready().code

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences on programs whose identity does not tell what they run."""
        return self._ready().programs.remarks

    @property
    def ignored(self) -> Mapping[str, str]:
        """Parts of an excitation that no template names, each with what to do where it matters."""
        return ignored_parts(self._ready().texts)

    def _read(self) -> Inputs:
        inputs = read_inputs(self._options.program, self._study)
        check_names(inputs.texts, [p.name for p in self.parameters], KNOWN)
        check_options(self._reading.reader, self._reading.options, self._modules)
        code = reader_code(self._reading.reader, self._modules)
        reader = tuple(known_file(module, file) for module, file in code.files.items())
        return replace(inputs, reader=reader, versions=code.versions)

    def _ready(self) -> Inputs:
        if self._inputs is None:
            self._inputs = self._read()
        return self._inputs

    def run(
        self, values: Mapping[str, float], excitation: Excitation, laws: Sequence[BoundLaw], request: Request
    ) -> xr.Dataset:
        """Run the program at `values` (SI).

        Raises
        ------
        CalibError : an excitation that the templates do not take
        CodeChanged : a file, the program or the reader has changed since the study was read
        """
        return self._evaluated(values, excitation, request).record

    def _evaluated(
        self, values: Mapping[str, float], excitation: Excitation, request: Request, kept_as: str = ""
    ) -> ProgramRun:
        """Run the program; `kept_as` is a name under which its folder is kept in any case."""
        self._check_drive(excitation)
        attrs = self._attrs(excitation)
        settle = self._settle(excitation, request)
        for name, value in values.items():
            if not math.isfinite(value):
                return ProgramRun(failed(self.bodies, IMPOSSIBLE, f"{name} is {value}", **attrs))
        times = output_times(excitation, request, settle)
        least = math.ceil(times.size * (settle + request.periods) / request.periods) if settle else times.size
        if least > request.step_budget:
            reason = f"{least} instants of output are at least as many steps; the budget is {request.step_budget}"
            return ProgramRun(failed(self.bodies, STEP_BUDGET, reason, **attrs))
        deck = self._deck_values(values, excitation, request)
        instants = Instants(times)
        if excitation.harmonic:
            period = excitation.as_harmonic.period
            instants = Instants(times, settle * period, period, request.periods, settle)
        if self._results is not None:
            around = Surroundings(
                self._options, self._ready(), self._results, self._modules, True, self._afresh, kept_as
            )
            return evaluated(around, deck, instants, attrs)
        with tempfile.TemporaryDirectory(prefix="calib-") as folder:
            around = Surroundings(self._options, self._ready(), Path(folder), None, False, True)
            return evaluated(around, deck, instants, attrs)

    def dry_run(self, values: Mapping[str, float], excitation: Excitation, request: Request) -> DryRun:
        """Run the program, which no cache answers, and say what was run and read.

        The run folder is kept as `runs/dry-run`, unless no folder is.
        """
        run = self.afresh()._evaluated(
            values, excitation, request, "" if self._options.keeping.keep == "none" else DRY_RUN
        )
        runs = None if self._results is None else self._results / RUNS
        return DryRun(run.record, (*facts_of(run, self._options, runs), *(("remark", text) for text in self.remarks)))

    def check(self, excitation: Excitation, request: Request) -> None:
        """Refuse an excitation or a request that the templates do not take.

        Raises
        ------
        CalibError : a place that is not among `drives`; a template that cannot be rendered with them
        """
        self._check_drive(excitation)
        try:
            self.check_values({p.name: p.nominal for p in self.parameters}, excitation, request)
        except TemplateFault as fault:
            if not fault.names or fault.names & {"excitation", "request"}:
                raise

    def check_values(self, values: Mapping[str, float], excitation: Excitation, request: Request) -> None:
        """Refuse values that the templates do not take.

        Raises
        ------
        CalibError : a template that cannot be rendered with them
        """
        self._ready().deck(self._deck_values(values, excitation, request))

    def _check_drive(self, excitation: Excitation) -> None:
        takes = self._options.reading.excitations
        if takes is not None and (excitation.quantity, excitation.place) not in takes:
            known = ", ".join(f"{quantity} at {place!r}" for quantity, place in sorted(takes))
            hint = nearest(excitation.place, [place for _, place in takes])
            raise CalibError(
                f"simulator 'command' is not driven by {excitation.quantity} at {excitation.place!r}; its `drives` "
                f"name {known}{hint}"
            )

    def _deck_values(self, values: Mapping[str, float], excitation: Excitation, request: Request) -> dict[str, object]:
        settle = self._settle(excitation, request)
        return deck_values(self.parameters, values, excitation, request, settle, self._options.program.cores)

    def _settle(self, excitation: Excitation, request: Request) -> int:
        """Periods that are dropped first."""
        if not excitation.harmonic:
            return 0
        return self._options.reading.settle if request.settle is None else request.settle

    def _attrs(self, excitation: Excitation) -> dict[str, Any]:
        attrs: dict[str, Any] = {"source": self.name, **excitation.attributes}
        if excitation.frequency is not None:
            attrs["frequency"] = excitation.frequency
        if self._options.reading.prescribed:
            attrs["prescribed"] = ",".join(self._options.reading.prescribed)
        return attrs


Command.__doc__ = inspect.cleandoc(Command.__doc__ or "").replace("{options}", described())
