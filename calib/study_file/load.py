"""From a study file to a study: the only room where names become things."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from numbers import Integral
from pathlib import Path
from typing import Any, NamedTuple

from calib import plugins
from calib.confidence.prior import Prior
from calib.diagnosis.laboratory import Laboratory
from calib.dynamics.setting import Setting
from calib.errors import CalibError, nearest
from calib.execution.pools.settings import PoolSettings
from calib.modelling.effect import Effect
from calib.modelling.model import Model
from calib.modelling.parameter import Parameter, Space, Window, values_for
from calib.modelling.simulator import Simulator
from calib.modelling.simulator_check import simulator_class
from calib.objective import Objective, Reference
from calib.store.plain import plain
from calib.store.record_files import Keep
from calib.study import CalibrationStudy, ModelSummary, check_searched, check_stated
from calib.study_file.candidates import Candidates, named_effect, read_candidates, registered_candidates
from calib.study_file.code import code_of, used_code
from calib.study_file.folder import results_folder
from calib.study_file.laboratory import read_laboratory
from calib.study_file.made import made
from calib.study_file.mistakes import Mistakes, PythonOrigin, located, read_study
from calib.study_file.optimiser import OptimiserMaker, costly_optimiser, no_search
from calib.study_file.pool import pool_settings
from calib.study_file.priors import read_priors
from calib.study_file.references import REQUEST_KEYS, digest, references
from calib.study_file.schema import DiagnosisTable, OptimiserTable, StudyToml, TermTable
from calib.study_file.stored_simulator import StoredSimulator
from calib.study_file.terms import read_terms
from calib.study_file.values_check import check_responses, check_values
from calib.units import to_si

CONTRACT_ARGUMENTS = ("dim", "seed", "budget", "batch")  # of an optimiser; the rest are options of the user


@dataclass(frozen=True)
class StudyFile:
    """A study with what its file says beyond it.

    Attributes
    ----------
    path : the study file
    study : the study, its objective over the records to calibrate on
    others : the references that are not calibrated on ("holdout", "name"), by name
    folder : where results go unless the command line says otherwise
    view, keep : of the store: the Optuna view ("journal" or a URL), the records kept
    candidates : effects that a diagnosis may name; None are all that are registered
    laboratory : what it can do in a next measurement
    priors : of searched parameters, by name
    """

    path: Path
    study: CalibrationStudy
    others: Mapping[str, Reference]
    folder: Path
    view: str
    keep: Keep
    candidates: Candidates | None
    laboratory: Laboratory
    priors: Mapping[str, Prior]

    def reference(self, record: str | None = None) -> Reference:
        """Record of the study by name, whatever its use; the first one where none is given.

        Raises
        ------
        CalibError : there is no such record
        """
        known = {**self.study.objective.references, **self.others}
        record = record or next(iter(known))
        if record not in known:
            raise CalibError(f"no record {record!r}{nearest(record, known)}; the study has {', '.join(known)}")
        return known[record]

    def suspects(self) -> list[Effect]:
        """Effects that a diagnosis may name; the numerical ones, by which it judges the solver, always.

        Raises
        ------
        CalibError : one of them does not load
        """
        folder, registered = self.path.parent, registered_candidates()
        asked = registered if self.candidates is None else self.candidates
        effects = [one.effect(folder) for one in asked]
        known = {effect.name for effect in effects}
        gates = [one.effect(folder) for one in registered if one.reference not in known] if asked else []
        return effects + [effect for effect in gates if effect.site == "numerical"]

    def candidate_code(self) -> dict[str, str]:
        """Code outside calib of the effects that a diagnosis may name; see `CalibrationStudy.code` for the model's.

        Raises
        ------
        CalibError : one of them does not load
        """
        return code_of([("calib.effects", name) for name in self.effect_references().values()], self.path.parent)

    def effect_references(self) -> dict[str, str]:
        """Name of each effect that a diagnosis may name, and the reference under which the study file knows it.

        A reference is the name of an entry point, or "package.module:Thing".

        Raises
        ------
        CalibError : one of them does not load
        """
        asked = registered_candidates() if self.candidates is None else self.candidates
        return {one.effect(self.path.parent).name: one.reference for one in asked}

    def setting(
        self, values: Mapping[str, float] | None = None, record: str | None = None, phase: float = 0.0
    ) -> Setting:
        """Return model and excitation for sweeps, branches and basins, at the study's fixed values.

        Parameters
        ----------
        values : SI; they come before the fixed ones, nominal ones after
        record : whose excitation it is; None for the first
        phase : where in the period the section is taken, in [0, 1)  [1, in periods]

        Raises
        ------
        CalibError : there is no such record
        """
        chosen = self.reference(record)
        held = values_for({**self.study.space.fixed, **(values or {})}, chosen.name)
        return Setting(self.study.model, chosen.excitation, held, phase)


def load(
    path: str | Path,
    budget: int | None = None,
    jobs: int | None = None,
    origin: PythonOrigin | None = None,
    out: str | Path | None = None,
    pool: Mapping[str, Any] | None = None,
    stored: ModelSummary | None = None,
) -> StudyFile:
    """Read a study file, or the `study.toml` of a folder.

    Parameters
    ----------
    budget, jobs : take the place of the file's
    origin : where the study was stated, if not in the file
    out : folder of the results; None: see `calib.study_file.results_folder`
    pool : keys of a [pool] table that takes the place of the file's
    stored : model of the result, for a study that is only shown: of what its file names the features alone are loaded

    Raises
    ------
    CalibError : every mistake of the file with its line and key, what was expected, and the nearest right name
    """
    budget, jobs = _counted("budget", budget), _counted("jobs", jobs)
    path = located(path)
    shape, mistakes = read_study(path, origin)
    folder = results_folder(path) if out is None else Path(out)
    model = _model(shape, mistakes, folder) if stored is None else Model(StoredSimulator(stored))
    known = references(shape, model if stored is None else None, mistakes)
    every = {name: reference for name, reference in known.items() if reference is not None}
    calibrated = {name: reference for name, reference in every.items() if reference.use == "calibrate"}
    space = _space(shape, model, known, mistakes) if model is not None else None
    complete = bool(calibrated) and len(every) == len(known)
    terms, elsewhere = read_terms(shape, every if complete else None, mistakes)
    optimiser = _optimiser(shape, mistakes) if stored is None else OptimiserMaker(no_search, {}, "[optimiser]")
    timeout = _seconds(shape, mistakes)
    settings = pool_settings(shape, mistakes, jobs, pool)
    diagnosis = shape.diagnosis if stored is None else DiagnosisTable()
    candidates = read_candidates(diagnosis.candidates, mistakes, "diagnosis", "candidates")
    _check_screen(shape, budget or shape.study.budget, mistakes)
    laboratory = read_laboratory(diagnosis.bench, every, model, mistakes) if complete and model else None
    priors = read_priors(shape.confidence.priors, space, model, mistakes) if space is not None and model else {}
    if model is not None and complete:
        _check_driven(model, every.values(), mistakes)
    if model is not None and space is not None and complete:
        check_values(model, space, every.values(), mistakes)
        if stored is None:
            check_responses(model, space, every, mistakes)
    mistakes.tell()
    with mistakes.at("term"):
        objective = Objective(calibrated, terms, elsewhere)
    mistakes.tell()
    if model is None or space is None or optimiser is None or laboratory is None:
        raise AssertionError("a part of the study is missing, and no mistake says why")
    study = _study(shape, mistakes, _Parts(model, space, objective, optimiser, timeout, settings), budget)
    others = {name: reference for name, reference in every.items() if reference.use != "calibrate"}
    return StudyFile(
        path=path, study=study, others=others, folder=folder, view=shape.store.view, keep=shape.store.keep,
        candidates=candidates, laboratory=laboratory, priors=priors,
    )  # fmt: skip


class _Parts(NamedTuple):
    """What a study is made of."""

    model: Model
    space: Space
    objective: Objective
    optimiser: OptimiserMaker
    timeout: float
    pool: PoolSettings


def _study(shape: StudyToml, mistakes: Mistakes, parts: _Parts, budget: int | None) -> CalibrationStudy:
    model, space = parts.model, parts.space
    jobs = parts.pool.jobs if parts.pool.kind == "local" else shape.study.jobs
    shown = isinstance(model.simulator, StoredSimulator)
    return CalibrationStudy(
        name=shape.study.name,
        model=model,
        space=space,
        objective=parts.objective,
        optimiser=parts.optimiser,
        budget=budget or shape.study.budget,
        seed=shape.study.seed,
        batch=shape.optimiser.batch,
        jobs=jobs or 1,
        pool=parts.pool,
        timeout=parts.timeout,
        screen=shape.study.screen,
        definition=_definition(shape, model, space, mistakes.path.parent),
        code={} if shown else used_code(shape, mistakes.modules, model.simulator),
        costly_optimiser=None if shown else _costly_optimiser(shape, mistakes),
    )


# --- the model -------------------------------------------------------------------------------------------------------


def _model(shape: StudyToml, mistakes: Mistakes, results: Path) -> Model | None:
    model: Model | None = None
    placed: Simulator | None = None
    if mistakes.within("model"):
        return None
    with mistakes.at("model", "simulator"):
        named = plugins.load("calib.simulators", shape.model.simulator, mistakes.modules)
        maker = simulator_class(named, shape.model.simulator)
        simulator = made(maker, shape.model.options, shape.model.simulator, mistakes, ("model", "options"))
        if simulator is not None:
            with mistakes.at("model", "options"):
                placed = _placed(simulator, mistakes, results)
            model = None if placed is None else Model(placed)
    for index, entry in enumerate(shape.model.effects):
        with mistakes.at("model", "effects", index):
            effect = named_effect(entry.name, entry.bodies, mistakes.modules)
            if model is not None:
                model = model.extended(effect)
    return model


def _check_driven(model: Model, references: Iterable[Reference], mistakes: Mistakes) -> None:
    """Note effects of the model that are absent from every record by what excites them: nothing shows their size."""
    excitations = [reference.excitation for reference in references]
    for index, effect in enumerate(model.effects):
        with mistakes.at("model", "effects", index):
            reason = effect.undriven(excitations)
            if reason:
                raise CalibError(f"effect {effect.name!r}: {reason}; drop the effect, or add such a record")


def _placed(simulator: Simulator, mistakes: Mistakes, results: Path) -> Simulator:
    """Return the simulator, told where its study and the results are, if it wants to know."""
    placed = getattr(simulator, "placed", None)
    return simulator if placed is None else placed(mistakes.modules or Path.cwd(), results, mistakes.modules)


# --- the search ------------------------------------------------------------------------------------------------------


def _space(shape: StudyToml, model: Model, known: Mapping[str, Reference | None], mistakes: Mistakes) -> Space:
    windows: dict[str, Window] = {}
    fixed: dict[str, float] = {}
    start: dict[str, float] = {}
    calibrated = [entry.name for entry in shape.record if entry.use == "calibrate"]
    references = {name: reference for name, reference in known.items() if reference is not None}
    for name, entry in shape.windows.items():
        with mistakes.at("windows", name):
            check_stated(name, model, references)
            check_searched(name, model, references)
            parameter = _parameter(name, model, calibrated)
            windows[name] = _inside(
                Window(to_si(entry.low, parameter.unit), to_si(entry.high, parameter.unit), entry.scale), parameter
            )
            if name in shape.model.fixed:
                raise CalibError("this parameter stands in [model] fixed too; keep one of them")
        if name in windows and entry.start is not None:
            with mistakes.at("windows", name, "start"):
                begin = to_si(entry.start, parameter.unit)
                windows[name].check(begin)
                start[name] = begin
    for name, value in shape.model.fixed.items():
        with mistakes.at("model", "fixed", name):
            check_stated(name, model, references)
            parameter = _parameter(name, model, [record.name for record in shape.record])
            fixed[name] = to_si(value, parameter.unit)
            if not parameter.admits(fixed[name]):
                raise CalibError(_outside(parameter, f"{fixed[name]:g}"))
    return Space(windows, {name: value for name, value in fixed.items() if name not in windows}, start)


def _parameter(name: str, model: Model, records: list[str]) -> Parameter:
    base, at, record = name.partition("@")
    parameter = model.parameter(base)
    if at and record not in records and all(records):  # "" is a record whose name could not be read
        known = ", ".join(records)
        raise CalibError(f"no record {record!r} to bind {base!r} to{nearest(record, records)}; known are {known}")
    return parameter


def _inside(window: Window, parameter: Parameter) -> Window:
    if not parameter.low <= window.low < window.high <= parameter.high:
        raise CalibError(_outside(parameter, f"[{window.low:g}, {window.high:g}]"))
    return window


def _outside(parameter: Parameter, came: str) -> str:
    return f"expected values of {parameter.name!r} in {parameter.interval} {parameter.unit}, got {came}"


def _optimiser(shape: StudyToml, mistakes: Mistakes) -> OptimiserMaker | None:
    if mistakes.within("optimiser"):
        return None
    with mistakes.at("optimiser", "name"):
        maker = plugins.load("calib.optimisers", shape.optimiser.name, mistakes.modules)
        made(maker, shape.optimiser.options, shape.optimiser.name, mistakes, ("optimiser",), given=CONTRACT_ARGUMENTS)
        return OptimiserMaker(maker, shape.optimiser.options, mistakes.place("optimiser"))
    return None


def _costly_optimiser(shape: StudyToml, mistakes: Mistakes) -> OptimiserMaker | None:
    """The optimiser of few, slow simulations, where the file names none and gives the default one no options."""
    if "name" in shape.optimiser.model_fields_set or shape.optimiser.options:
        return None
    return OptimiserMaker(costly_optimiser, {}, mistakes.place("optimiser"))


def _counted(name: str, number: int | None) -> int | None:
    """Refuse what is no whole number from 1 on; None is the study's own."""
    if number is not None and (not isinstance(number, Integral) or number < 1):
        raise CalibError(f"{name}: expected a whole number from 1 on, got {number!r}")
    return number


def _check_screen(shape: StudyToml, budget: int, mistakes: Mistakes) -> None:
    screen = shape.study.screen
    started = any(window.start is not None for window in shape.windows.values())
    if screen is not None and not mistakes.within("study", "budget") and screen + started >= budget:
        mistakes.add(("study", "screen"), f"the screen of {screen} leaves nothing of the {budget} trials")


def _seconds(shape: StudyToml, mistakes: Mistakes) -> float:
    seconds = 0.0
    with mistakes.at("study", "timeout"):
        seconds = to_si(shape.study.timeout, "s")
        if not seconds > 0.0:
            raise CalibError(f"expected a time above 0 s, got {shape.study.timeout!r}")
    return seconds


def _definition(shape: StudyToml, model: Model, space: Space, folder: Path) -> dict[str, Any]:
    """Everything that decides which trials are made and how they score, as JSON; units and defaults worked out."""
    head = shape.study
    fixed = {**model.nominal, **space.fixed}
    incidental: frozenset[str] = getattr(model.simulator, "incidental", frozenset())
    return {
        "name": head.name,
        "seed": head.seed,
        "screen": head.screen,
        "request": {key: getattr(head, key) for key in REQUEST_KEYS},
        "records": {
            entry.name: {
                **entry.model_dump(exclude={"name", "path", "origin", "sha256"}, exclude_none=True),
                "sha256": digest(entry, folder),
            }
            for entry in shape.record
        },
        "model": {
            "simulator": shape.model.simulator,
            "options": _sorted({k: value for k, value in shape.model.options.items() if k not in incidental}),
            "effects": [effect.model_dump(exclude_none=True) for effect in shape.model.effects],
            "fixed": plain({name: value for name, value in _sorted(fixed).items() if name not in space.windows}),
        },
        "windows": {
            name: {**asdict(window), "unit": model.parameters[name.partition("@")[0]].unit}
            for name, window in space.windows.items()  # their order is the order of the cube's axes
        },
        **({"start": dict(space.start)} if space.start else {}),
        "terms": [_stated(term) for term in shape.term],
        "optimiser": _stated(shape.optimiser),
    }


def _stated(table: TermTable | OptimiserTable) -> dict[str, Any]:
    return {**table.model_dump(exclude=set(table.options)), "options": _sorted(table.options)}


def _sorted(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the same in alphabetical order: where order means nothing, it is no change of the study."""
    return dict(sorted(options.items()))
