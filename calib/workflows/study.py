"""Studies from Python: stated in keywords, run, and their results."""

import copy
import html
import shutil
import tempfile
import tomllib
import warnings
import weakref
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from functools import cached_property
from pathlib import Path
from typing import Any

import tomlkit
import xarray as xr

from calib.errors import CalibError, nearest
from calib.execution.progress import Count
from calib.modelling.effect import Effect
from calib.records import read
from calib.report.plots.motion import motions_of_records
from calib.report.plots.records import aligned_simulation
from calib.store.record_files import file_of
from calib.study import result
from calib.study_file import PythonOrigin, StudyFile, load
from calib.study_file.references import expanded
from calib.sweep.sensitivity.design import MORRIS, Method
from calib.units import count
from calib.workflows.calibrate import UNFINISHED, calibrate_file, rebuild, summary_so_far
from calib.workflows.confidence import confidence_study
from calib.workflows.diagnose import diagnose_study
from calib.workflows.diagnosed import Diagnosed
from calib.workflows.discover import discover_study
from calib.workflows.discovered import Discovered
from calib.workflows.document import (
    MAIN,
    default_terms,
    for_toml,
    local_jobs,
    record_file,
    reference_of,
    references_in,
    table_of,
    window_table,
    with_folder,
)
from calib.workflows.plot import Plot
from calib.workflows.profiled import Profiled
from calib.workflows.record import Record, listed
from calib.workflows.saved import save_study
from calib.workflows.sensitive import Sensitivity
from calib.workflows.sensitivity import sensitivity_study
from calib.workflows.texts import calibration_html, calibration_text, study_text
from calib.workflows.window import DEFAULT_BUDGET, window_study
from calib.workflows.windowed import AdmissibleWindow

FILE = "study.toml"
FURTHER_TABLES = ("store", "diagnosis", "confidence")  # of a study file, which `Study` takes as they are


class Study:
    """A study: records, a model with windows of its parameters, and what is compared; see the keys of a study file.

    Numbers are in SI, texts have a unit ("1 mm"). Everything is checked when the study is made.

    Parameters
    ----------
    simulator : name of a registered one, "package.module:Thing", or the class
    records : at least one of use "calibrate"
    windows : parameter -> (low, high), (low, high, "log") or a mapping with low, high, scale and start
    fixed : parameter -> value
    options : of the simulator
    effects : of the model, by name, "package.module:THING" or as `calib.Effect`
    terms : features that are compared, by name or as mappings with options; None: phase curves where all records
        have a period, displacement and velocity, else time histories
    optimiser : name, or a mapping with its options; None: "multistart", or "surrogate" for few and slow simulations
    budget : simulations of the search
    seed : of every random number
    jobs : processes of this machine; None: one for each core
    pool : where simulations run, as keys of the table `pool`, {"kind": "dask", "scheduler": ...}; None: in `jobs`
    timeout : wall-clock limit of one simulation  [s]
    name : of the study
    more : further tables of a study file: `study` (screen, periods, samples, settle, step_budget), `store`,
        `diagnosis`, `confidence`

    Raises
    ------
    CalibError : every mistake with its key, what was expected, and the nearest right name
    """

    _document: dict[str, Any]
    _records: dict[str, Record]
    _folder: Path | None  # in which modules of the study lie

    def __init__(
        self,
        simulator: str | type,
        records: Sequence[Record],
        windows: Mapping[str, Any],
        *,
        fixed: Mapping[str, float | str] | None = None,
        options: Mapping[str, Any] | None = None,
        effects: Sequence[str | Mapping[str, Any] | Effect] = (),
        terms: Sequence[str | Mapping[str, Any]] | None = None,
        optimiser: str | Mapping[str, Any] | None = None,
        budget: int = 200,
        seed: int = 0,
        jobs: int | None = None,
        pool: Mapping[str, Any] | None = None,
        timeout: float | str = "60 s",
        name: str = "study",
        **more: Mapping[str, Any],
    ):
        unknown = [key for key in more if key not in ("study", *FURTHER_TABLES)]
        if unknown:
            raise CalibError(f"unknown keyword {unknown[0]!r}; further tables are study, {', '.join(FURTHER_TABLES)}")
        if not isinstance(windows, Mapping) or not windows:
            raise CalibError(
                "windows: expected a mapping with at least one parameter, such as {'gain': (0.5, 2.0)}, "
                f"got {windows!r:.60}"
            )
        records = listed(records)
        for record in records:
            if not isinstance(record, Record):
                raise CalibError(f"records: expected calib.Record, got {type(record).__name__}; see Record.from_arrays")
        head = {
            "name": name,
            "seed": seed,
            "budget": budget,
            "jobs": local_jobs(jobs, pool),
            "timeout": timeout,
        }
        model = {
            "simulator": reference_of(simulator, "calib.simulators"),
            "effects": [reference_of(effect, "calib.effects") for effect in listed(effects)],
            "options": with_folder(dict(options or {}), simulator, Path.cwd()),
            "fixed": dict(fixed or {}),
        }
        self._records = {record.name: record for record in records}
        if len(self._records) < len(records):
            raise CalibError("records: two have one name; give each its own")
        terms = default_terms(records) if terms is None else listed(terms)
        document: dict[str, Any] = {
            "study": {**head, **more.get("study", {})},
            "record": [record.entry(record_file(record.name)) for record in records],
            "model": model,
            "windows": {parameter: window_table(parameter, window) for parameter, window in windows.items()},
            "term": [table_of(term, "feature") for term in terms],
            **({} if optimiser is None else {"optimiser": table_of(optimiser, "name")}),
            **({} if pool is None else {"pool": pool}),
            **{key: more[key] for key in FURTHER_TABLES if key in more},
        }
        self._document, self._folder = for_toml(document), None
        self.check()

    @classmethod
    def read(cls, path: str | Path) -> "Study":
        """Read a study file, or the `study.toml` of a folder.

        Raises
        ------
        CalibError : every mistake of the file with its line and key
        """
        path = load(path).path.resolve()
        study = cls.__new__(cls)
        study._document, study._records = tomllib.loads(path.read_text(encoding="utf-8")), {}
        study._folder = path.parent
        model = study._document["model"]
        if "options" in model:
            model["options"] = with_folder(model["options"], model["simulator"], path.parent)
        for entry in study._document["record"]:
            if entry["path"] == record_file(entry["name"]) and "table" not in entry:  # as `save` has left it
                study._records[entry["name"]] = Record(read(path.parent / entry["path"]), entry["name"])
            else:
                entry["path"] = str((path.parent / expanded(entry["path"], path.parent)).resolve())
        return study

    @property
    def document(self) -> dict[str, Any]:
        """What the study file of this study says."""
        return copy.deepcopy(self._document)

    def save(self, path: str | Path, overwrite: bool = False) -> Path:
        """Write the study file; beside it records that were made in Python, and modules that lay beside it before.

        Parameters
        ----------
        path : of a .toml file, or of a folder, in which it is called study.toml
        overwrite : whether what is there is replaced, where it says something else

        Returns
        -------
        path of the study file

        Raises
        ------
        CalibError : there is another study, record or module of that name; the folder cannot be written
        """
        path = self._save(Path(path), overwrite)
        for reference in references_in(self._document):
            module, _, name = reference.partition(":")
            if module == MAIN:
                warnings.warn(
                    f"{path} refers to {name!r} of this script or notebook, which `calib run` cannot import: move it "
                    "into a module beside the study file, and import it from there",
                    stacklevel=2,
                )
        return path

    def _save(self, path: Path, overwrite: bool) -> Path:
        path = path if path.suffix == ".toml" else path / FILE
        save_study(path, self._document, self._records, self._folder, overwrite)
        return path

    def check(self) -> None:
        """Check the study as a study file is checked.

        Raises
        ------
        CalibError : every mistake with its key
        """
        with tempfile.TemporaryDirectory(prefix="calib-") as folder:
            load(self._save(Path(folder), overwrite=False), origin=PythonOrigin(self._folder))

    def run(
        self,
        out: str | Path | None = None,
        *,
        budget: int | None = None,
        jobs: int | None = None,
        pool: Mapping[str, Any] | None = None,
        fresh: bool = False,
        quiet: bool = False,
    ) -> "Calibration":
        """Calibrate: `calib run` on the file of this study.

        Ctrl-C ends the search; what was found until then is returned.

        Parameters
        ----------
        out : folder of study file and results, gone on with if there are any; None: a temporary one, which goes when
            the result does
        budget, jobs, pool : take the place of the study's
        fresh : replace what is in the folder, and forget the trials made there
        quiet : no progress on stderr

        Raises
        ------
        CalibError : a mistake in the study, or the folder holds another one or cannot be written
        KeyboardInterrupt : stopped before any simulation ended
        """
        with ExitStack() as undo:
            folder = Path(tempfile.mkdtemp(prefix="calib-") if out is None else out)
            if out is None:
                undo.callback(shutil.rmtree, folder, ignore_errors=True)
            path = (self._save if out is None else self.save)(folder, overwrite=fresh)
            file = load(path, budget, jobs, PythonOrigin(path.parent), pool=pool)
            try:
                calibrate_file(file, file.folder, fresh=fresh, quiet=quiet)
            except KeyboardInterrupt:
                try:
                    rebuild(path, jobs=jobs, pool=pool)
                except CalibError:
                    raise KeyboardInterrupt from None
            calibration = Calibration(path, passing=out is None)
            undo.pop_all()
        failures = calibration.summary.failures
        if failures and not calibration.values:
            trials, first = count(calibration.summary.trials, "trial"), failures[0]
            warnings.warn(f"none of {trials} ended ok ({first.status}): {first.reason}", stacklevel=2)
        return calibration

    def sensitivity(
        self, out: str | Path | None = None, *, method: Method = MORRIS, trajectories: int | None = None,
        samples: int | None = None, seed: int | None = None, jobs: int | None = None,
        fresh: bool = False, quiet: bool = False,
    ) -> Sensitivity:  # fmt: skip
        """Say which parameter moves which feature of the motion inside the windows: `calib sensitivity`.

        `out` and `fresh` as in `run`, the others as in `calib.workflows.sensitivity.sensitivity_study`.
        """
        with tempfile.TemporaryDirectory(prefix="calib-") as passing, Count("points", quiet) as count:
            path = self._save(Path(passing), False) if out is None else self.save(out, overwrite=fresh)
            return Sensitivity(
                sensitivity_study(
                    path, method=method, trajectories=trajectories, samples=samples, seed=seed, jobs=jobs,
                    fresh=fresh, on_point=count,
                )
            )  # fmt: skip

    def __repr__(self) -> str:
        return study_text(self._document)

    def _repr_html_(self) -> str:
        name, text = html.escape(self._document["study"]["name"]), html.escape(tomlkit.dumps(self._document))
        return f"<details><summary><b>{name}</b>, as a study file</summary><pre>{text}</pre></details>"


class Calibration:
    """The result of a study.

    Attributes
    ----------
    path, folder : of the study file, and of its results
    summary : the `CalibrationResult` of result.json; of a search that was stopped, what the trials so far say

    Parameters
    ----------
    passing : whether the study's folder goes when this object does
    """

    def __init__(self, path: Path, passing: bool = False):
        self.path = path
        self.folder = self._file.folder
        self.summary = result.read(self.folder) or summary_so_far(path)
        if passing:
            weakref.finalize(self, shutil.rmtree, path.parent, ignore_errors=True)

    @cached_property
    def _file(self) -> StudyFile:
        return load(self.path)

    @property
    def values(self) -> Mapping[str, float]:
        """Parameter -> value [SI]; empty where no trial ended well."""
        return self.summary.values

    @property
    def intervals(self) -> Mapping[str, tuple[float, float]]:
        """Parameter -> (low, high) of its 95 % interval [SI], of those that have one."""
        return self.summary.intervals

    @property
    def kind(self) -> str | None:
        """Kind of the calibrated motion, such as "period-1"."""
        return self.summary.motion.kind

    def simulated(self, record: str | None = None) -> xr.Dataset:
        """Return the calibrated motion for a record, the first one where none is named.

        Raises
        ------
        CalibError : there is no such record, or no trial ended well
        """
        if not self.values:
            raise CalibError("no trial ended well: there is no motion to show")
        names = list(self._file.study.objective.references)
        record = record or names[0]
        if record not in names:
            raise CalibError(f"no record {record!r} was calibrated on{nearest(record, names)}; those are {names}")
        return read(self.folder / file_of("best", record, record == names[0]))

    def plot(self, record: str | None = None) -> Plot:
        """Measured and simulated phase curves of a record, of all where none is named; time histories without them.

        Raises
        ------
        CalibError : there is no such record, or no trial ended well
        """
        objective = self._file.study.objective
        motions = {}
        for name in [record] if record else objective.references:
            simulated = self.simulated(name)
            motions[name] = objective.references[name].record, aligned_simulation(objective, name, simulated)
        return Plot(motions_of_records(motions))

    def report(self, path: str | Path) -> Path:
        """Write the page of the study, which needs no other file."""
        try:
            Path(path).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(self.folder / "report.html", path)
        except OSError as error:
            raise CalibError(f"{path} cannot be written: {error.strerror or error}") from error
        return Path(path)

    def diagnose(
        self, *, candidates: str | Sequence[str | Mapping[str, Any] | Effect] | None = None, jobs: int | None = None,
        pool: Mapping[str, Any] | None = None, budget: int | str | None = None, seed: int | None = None,
        quiet: bool = False,
    ) -> Diagnosed:  # fmt: skip
        """Search for effects that are missing in the model: `calib diagnose`.

        Parameters
        ----------
        candidates : effects that may be the cause, in the place of the study's `diagnosis` candidates: "all", or by
            name ("all" among them), as {"name": ..., "bodies": [...]}, "package.module:THING" or `calib.Effect`
        budget : a number of simulations, or a time such as "10 min", within which the diagnosis ends
        seed : of the noise that is drawn; None: the study's
        jobs, pool, quiet : as in `Study.run`

        Raises
        ------
        CalibError : there are no calibrated values, or a mistake in the candidates or the budget
        """
        if not self.values or self.summary.stopped == UNFINISHED:
            raise CalibError("the search has not ended with values: run the study to its end, then diagnose it")
        stated = None if candidates is None else [reference_of(one, "calib.effects") for one in listed(candidates)]
        with Count("simulations", quiet) as count:
            summary, extended = diagnose_study(
                self.path, jobs=jobs, pool=pool, budget=None if budget is None else str(budget), seed=seed, apply=True,
                on_progress=count, candidates="all" if candidates == "all" else stated,
            )  # fmt: skip
        return Diagnosed(summary, None if extended is None else Study.read(extended), self)

    def discover(
        self, *, apply: bool = False, jobs: int | None = None, seed: int | None = None, quiet: bool = False,
        budget: str | None = None,
    ) -> Discovered:  # fmt: skip
        """Search for the force that the model misses, `calib discover`; `apply` writes the study that has it too."""
        with Count("simulations", quiet) as count:
            summary, extended = discover_study(
                self.path, jobs=jobs, seed=seed, apply=apply, budget=budget, on_progress=count
            )
        return Discovered(summary, self.summary.name, None if extended is None else Study.read(extended))

    def confidence(
        self, *, pairs: Sequence[tuple[str, str]] | str = (), posterior: bool = False,
        sample_nuisances: bool = False, compare: Sequence[str | Path] = (), jobs: int | None = None,
        pool: Mapping[str, Any] | None = None, fresh: bool = False, quiet: bool = False,
    ) -> Profiled:  # fmt: skip
        """Intervals of the values by profiles of the likelihood, and their posterior distribution: `calib confidence`.

        The arguments are those of `calib.workflows.confidence.confidence_study`.
        """
        with Count("evaluations", quiet) as count:
            return Profiled(confidence_study(
                self.path, pairs=pairs, posterior=posterior, sample_nuisances=sample_nuisances, compare=compare,
                jobs=jobs, pool=pool, fresh=fresh, on_progress=count,
            ))  # fmt: skip

    def window(
        self, *, budget: int = DEFAULT_BUDGET, tolerance: Mapping[str, float] | None = None, seed: int | None = None,
        jobs: int | None = None, fresh: bool = False, exact: bool = False, quiet: bool = False,
    ) -> AdmissibleWindow:  # fmt: skip
        """Where the model behaves as was measured: `calib window`, with its arguments."""
        with Count("points", quiet) as count, Count("slices continued", quiet) as slices:
            summary = window_study(self.path, budget=budget, tolerance=tolerance, seed=seed, jobs=jobs, fresh=fresh,
                                   exact=exact, on_point=count, on_slice=slices)  # fmt: skip
        return AdmissibleWindow(summary, self.folder)

    def __repr__(self) -> str:
        return calibration_text(self.summary)

    def _repr_html_(self) -> str:
        picture = self.plot()._repr_png_() if self.values else b""
        return calibration_html(self.summary, self.summary.stopped == UNFINISHED, picture)
