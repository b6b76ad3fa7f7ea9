"""The shape of a study file: which keys there are and what stands in them."""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, PlainValidator

from calib.confidence.prior import PriorKind
from calib.diagnosis.laboratory import MAX_SIMULATIONS
from calib.execution.pools.local import MAX_JOBS
from calib.execution.pools.settings import PoolKind
from calib.modelling.parameter import Scale
from calib.objective.terms import Use
from calib.records.order_tracking import CYCLES
from calib.records.response import HIGHEST_ORDER
from calib.store.record_files import Keep


def _number_or_text(value: object) -> float | str:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError("expected a number in SI or a text with a unit, such as '1.5 mm'")
    return value


def _with_unit(value: object) -> str:
    if not isinstance(value, str):
        raise ValueError("expected a text with a unit, such as '20 Hz' or '0.2 mm'")
    return value


def _column(value: object) -> float | str:
    if isinstance(value, bool) or not isinstance(value, int | str):
        raise ValueError("expected the name of a column, or its number counted from 1")
    return value


def _effect(value: object) -> object:
    return {"name": value} if isinstance(value, str) else value


def _candidates(value: object) -> object:
    return None if value == "all" else value


def _record_name(value: str) -> str:
    if not value or set(value) & set("@/\\"):
        raise ValueError("expected a name without '@', '/' and '\\'")
    return value


def _digest(value: str) -> str:
    if len(value) != 64 or not set(value.lower()) <= set("0123456789abcdef"):
        raise ValueError("expected the 64 hexadecimal digits of a SHA-256 sum")
    return value.lower()


def _view(value: str) -> str:
    if value != "journal" and "://" not in value:
        raise ValueError("expected 'journal' or the URL of an Optuna storage, such as 'sqlite:////home/me/view.db'")
    return value


Quantity = Annotated[float | str, PlainValidator(_number_or_text, json_schema_input_type=float | str)]
Column = Annotated[int | str, PlainValidator(_column, json_schema_input_type=int | str)]
WithUnit = Annotated[str, PlainValidator(_with_unit, json_schema_input_type=str)]
Bounds = Annotated[list[WithUnit], Field(min_length=2, max_length=2)]  # low, high
Count = Annotated[int, Field(ge=1)]


class TomlTable(BaseModel):
    """A table in which nothing stands but what is known, and of the kind that is expected."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, use_attribute_docstrings=True)


class _Open(TomlTable):
    """A table whose further keys are the options of what it names."""

    model_config = ConfigDict(extra="allow")

    @property
    def options(self) -> dict[str, Any]:
        """Keys that are not of the table itself."""
        return dict(self.model_extra or {})


class RequestTable(TomlTable):
    """What is computed of every record."""

    periods: Count = 6
    """Periods of the stationary motion that are kept."""
    samples: Annotated[int, Field(ge=8)] = 400
    """Samples a period."""
    settle: Annotated[int, Field(ge=0)] | None = None
    """Periods that are dropped first; without it the simulator judges when its motion has settled."""
    step_budget: Count = 50_000_000
    """Steps of the solver after which a simulation ends with the status "step budget" and without a score."""


class StudyTable(RequestTable):
    """[study]: name, seed and extent of the search."""

    name: str
    """Name of the study, in the report."""
    seed: Annotated[int, Field(ge=0)]
    """Seed of every random number."""
    budget: Count
    """Trials of the search; each simulates all records of use "calibrate" once."""
    jobs: Annotated[Count, Field(le=MAX_JOBS)] | None = None
    """Child processes of this machine, 1 without it: the short form of [pool] jobs where its kind is "local"."""
    timeout: Quantity = "60 s"
    """Wall-clock limit of one trial."""
    screen: Annotated[int, Field(ge=0)] | None = None
    """Trials that are spread over the windows before the optimiser begins; without it the study chooses."""


class PoolTable(TomlTable):
    """[pool]: where trials, and all other evaluations, are made; no part of the study, so it may change at any time."""

    kind: PoolKind = "local"
    """Kind: "local" (child processes of this machine), "dask" (workers of a Dask scheduler) or "executor"."""
    jobs: Count | None = None
    """Evaluations side by side, at most; with `cluster` the number of workers that are asked for. Without it 1 where
    the kind is "local", else as many as the workers take."""
    memory: Quantity | None = None
    """Memory that one evaluation may hold, its process and the programs that it starts together, such as "2 GB"."""
    scheduler: str | None = None
    """Address of a Dask scheduler that runs, such as "tcp://host:8786", of kind "dask"; this or `cluster`."""
    cluster: str | None = None
    """Dask cluster that is started, as "module:Class", such as "dask_jobqueue:SLURMCluster", of kind "dask"."""
    executor: str | None = None
    """Executor of the shape of concurrent.futures that is started, as "module:Class", of kind "executor"."""
    options: dict[str, Any] = {}
    """Options of the class that `cluster` or `executor` names."""


class ChannelTable(TomlTable):
    """An entry of [record.table] channels: one column of a table file."""

    column: Column
    """Name of the column in the header, or its number counted from 1."""
    body: str
    """Body that it belongs to."""
    channel: str
    """What was measured: "displacement", "velocity", "force", or a name of your own; over frequency "amplitude" and
    "phase", or "in-phase" and "quadrature"."""
    unit: str
    """Unit of the numbers in the file; of an amplitude, of a displacement, velocity or acceleration, such as "g"."""
    scale: Quantity = 1.0
    """Factor on them, a number or a sensitivity such as "1 m/V"."""
    sigma: Quantity | None = None
    """Standard uncertainty of a sample, in the unit of the channel or with its own; over frequency of either part."""
    of: Literal["displacement", "velocity", "acceleration"] | None = None
    """Of a phase, the motion that it is the phase of, before the excitation; without it that of the amplitude."""
    harmonic: Annotated[int, Field(ge=1, le=HIGHEST_ORDER)] = 1
    """Over frequency, the order of the harmonic; the phase of a higher one is before so many times the excitation's.

    Both are counted from a crest; where the instrument's reference is a sine, add (order - 1) times 90 degrees.
    """


class ClockTable(TomlTable):
    """[record.table] time: the column that is time."""

    column: Column
    """Name of the column in the header, or its number counted from 1."""
    unit: str
    """Unit of the numbers in the file."""


class FrequencyTable(ClockTable):
    """[record.table] frequency: the column that is the frequency of the excitation."""

    sigma: Quantity | None = None
    """Standard uncertainty of a frequency."""


class TrackingTable(TomlTable):
    """[record.table] tracking: how a record over time of a sine that is stepped or swept becomes a response."""

    sine: Literal["stepped", "swept"]
    """Whether the frequency of the excitation is stepped or swept."""
    cycles: Annotated[int, Field(ge=8)] = CYCLES
    """Cycles of the excitation in a window, of which each is a point: more have less noise, and less resolution."""
    harmonics: Annotated[int, Field(ge=1, le=HIGHEST_ORDER)] = 1
    """Highest harmonic of the motion that is tracked."""


class TableTable(TomlTable):
    """[record.table]: how a table file (delimited text, JSON, MATLAB) becomes a record."""

    channels: Annotated[list[ChannelTable], Field(min_length=1)]
    """Columns that are measured channels."""
    time: ClockTable | None = None
    """Column that is time; this, `rate` or `frequency`."""
    rate: Quantity | None = None
    """Sampling rate; this, `time` or `frequency`."""
    frequency: FrequencyTable | None = None
    """Column of frequencies that makes the record a frequency response."""
    tracking: TrackingTable | None = None
    """Of a record over time, that it is made a frequency response by tracking its excitation."""
    sweep: Column | None = None
    """Of a response, the column that numbers its sweeps."""
    direction: Column | None = None
    """Of a response, the column that says "up" or "down"."""
    elements: Annotated[list[Count], Field(min_length=1)] | None = None
    """Of a response, the numbers of cells or structures that `*` in the names of columns stands for; without it all."""
    first: Annotated[int, Field(ge=0)] = 0
    """First row that is taken, counted from 0."""
    last: int | None = None
    """Row before which the record ends; without it all rows are taken."""
    margin: Annotated[int, Field(ge=0)] = 0
    """Rows beyond either end that the excitation and the low-pass see, as far as the file has them."""
    cutoff: Quantity | None = None
    """Frequency of a zero-phase low-pass on all channels."""
    decimate: Count = 1
    """Every so many-th sample of the channels is kept; the excitation keeps all of its own."""
    separator: Annotated[str, Field(pattern=r'^[^"\r\n]$')] | None = None
    """Of delimited text, one character; without it semicolon, tab, comma or blanks, as found in the first row."""
    decimal: Literal[".", ","] | None = None
    """Of delimited text, the decimal sign: "." without it, or ","."""
    comment: str | list[str] | None = None
    """Of delimited text, characters, each of which at the beginning of a line makes it a comment, "#" without it; or a
    list of texts with which comments begin behind any blanks, as in ["LOG:"], of which "/.../" is a regular expression
    that is looked for in the whole line."""
    skip: Annotated[int, Field(ge=0)] | None = None
    """Of delimited text, lines at the beginning that are not looked at, such as a title."""
    header: Annotated[int, Field(ge=0)] | None = None
    """Of delimited text, lines before the first row of numbers, of which the first names the columns: 2 where a row of
    units follows the names; without it one where it holds anything but numbers, refused where it holds both."""
    names: list[str] | None = None
    """Of delimited text, names of all columns, in the place of the header's."""
    encoding: str | None = None
    """Of delimited text, such as "latin-1"; without it "utf-8"."""


class ExcitationTable(TomlTable):
    """[record.excitation]: how the bodies were driven, where the record does not say it."""

    place: str | None = None
    """Where it acts, such as "end" or "mass", in the words of the simulator."""
    quantity: str
    """One of "displacement", "base motion", "force", "free decay", "servo reference"."""
    frequency: Quantity | None = None
    """Frequency of a harmonic excitation, or of one that is recorded and periodic."""
    amplitude: Quantity | None = None
    """Amplitude of a harmonic excitation."""
    phase: Quantity = 0.0
    """Phase of a harmonic excitation at time 0."""
    column: Column | None = None
    """Column of the table that is a recorded excitation."""
    unit: str | None = None
    """Unit of that column, or of a bare amplitude."""
    scale: Quantity = 1.0
    """Factor on that column."""
    held: str | None = None
    """Body of a frequency response whose amplitude a controller held, so that the level of the excitation followed."""
    cutoff: Quantity | None = None
    """Frequency of the zero-phase low-pass by which a simulator takes derivatives of a recorded motion."""


class RecordTable(TomlTable):
    """[[record]]: one measurement."""

    name: Annotated[str, AfterValidator(_record_name)]
    """Name of the record in the study."""
    path: str
    """File, relative to the study file; `${CALIB_DATA}` and other variables of the environment are expanded."""
    origin: str = ""
    """Where a user gets the file, told where it is absent."""
    sha256: Annotated[str, AfterValidator(_digest)] | None = None
    """SHA-256 sum that the file has to have."""
    use: Use = "calibrate"
    """Use: "calibrate" (it is fitted), "name" (it helps a diagnosis to find the cause), "holdout" (it is predicted)."""
    bodies: dict[str, str] | None = None
    """Body of the record = body of the simulator; without it both have the same names."""
    nuisance: list[str] | None = None
    """What else is unknown of this measurement; without it what the record itself states, of a digitised figure."""
    table: TableTable | None = None
    """How a table file becomes a record; without it the file is a record (netCDF)."""
    excitation: ExcitationTable | None = None
    """How the bodies were driven; without it as the record says."""
    periods: Count | None = None
    """In the place of [study] periods."""
    samples: Annotated[int, Field(ge=8)] | None = None
    """In the place of [study] samples."""
    settle: Annotated[int, Field(ge=0)] | None = None
    """In the place of [study] settle."""
    step_budget: Count | None = None
    """In the place of [study] step_budget."""


class EffectTable(TomlTable):
    """An entry of [model] effects: an effect that acts on some bodies only."""

    name: str
    """Registered name (`calib list`), or "module:THING" as for a simulator."""
    bodies: list[str] | None = None
    """Bodies that it acts on; without it all that it can act on."""


class ModelTable(TomlTable):
    """[model]: what is simulated."""

    simulator: str
    """Registered name (`calib list`), or "module:Thing" of a module that lies beside the study file or is installed."""
    effects: list[Annotated[EffectTable, BeforeValidator(_effect, json_schema_input_type=str | EffectTable)]] = []
    """Effects by which the simulator is extended, by name or as { name, bodies }."""
    options: dict[str, Any] = {}
    """Options of the simulator."""
    fixed: dict[str, Quantity] = {}
    """Parameter = value that is not searched; of the others the nominal value is taken."""


class WindowTable(TomlTable):
    """[windows] parameter: the window of one parameter; at least one parameter has one."""

    low: Quantity
    """Least value."""
    high: Quantity
    """Greatest value."""
    scale: Scale = "linear"
    """Scale on which the window is searched: "linear" or "log"."""
    start: Quantity | None = None
    """Value at which the first trial is made."""


class TermTable(_Open):
    """[[term]]: one feature that is compared; further keys are options of the feature (`calib list phase_curve`)."""

    feature: str
    """Registered name (`calib list`), or "module:Thing" as for a simulator."""
    bodies: list[str] | None = None
    """Bodies of the simulator that are compared; without it all that were measured."""
    records: list[str] | None = None
    """Records that are compared; without it all that are calibrated on. A term of records held out says how these are
    judged: they need one where they are of another kind, such as a free decay beside frequency responses."""
    weight: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] = 1.0
    """Weight of the squared distance against that of the other terms."""


class OptimiserTable(_Open):
    """[optimiser]: how the windows are searched; further keys are options of the optimiser (`calib list cma`)."""

    name: str = "multistart"
    """Registered name (`calib list`), or "module:Thing" as for a simulator; without it and without options `surrogate`
    searches where the budget is at most 150 and the median trial of the screen takes 10 s or more."""
    batch: Count = 1
    """Points that are asked for at a time; part of the study, unlike `jobs`."""


class StoreTable(TomlTable):
    """[store]: what is kept of the trials."""

    view: Annotated[str, AfterValidator(_view)] = "journal"
    """What the dashboard reads: "journal", a file, or the URL of a database that studies may share, such as
    "postgresql+psycopg://me@server/calib"; its password belongs into ~/.pgpass."""
    keep: Keep = "improving"
    """Trials whose simulated records are kept: "best", "improving" (each that was the best so far) or "all"."""


class BenchTable(TomlTable):
    """[diagnosis.bench]: what the laboratory can do in a next measurement; every bound has a unit."""

    frequency: Bounds | None = None
    """Lowest and highest frequency; without it 0.5 to 2 times those of the records."""
    amplitude: Bounds | None = None
    """Least and greatest amplitude, in a unit of the excitation; without it 0.1 to 1.5 times those of the records."""
    release: Bounds | None = None
    """Least and greatest displacement from which a free decay begins."""
    tests: Annotated[list[str], Field(min_length=1)] | None = None
    """Kinds of test; without it all that apply."""
    channels: list[str] | None = None
    """Channels that could be measured too, as "body.channel"; without it displacement and velocity of every body."""
    simulations: Count = MAX_SIMULATIONS
    """Simulations that the search for the next measurement takes at most."""


class DiagnosisTable(TomlTable):
    """[diagnosis]: what `calib diagnose` and `calib rehearse` look for."""

    candidates: Annotated[
        list[Annotated[EffectTable, BeforeValidator(_effect, json_schema_input_type=str | EffectTable)]] | None,
        BeforeValidator(_candidates, json_schema_input_type=Literal["all"] | list[str | EffectTable]),
    ] = None
    """Effects that may be the cause, by name or as { name, bodies }; "all", alone or among them: all installed ones.

    Those that require an apparatus, such as `delayed_feedback` a controller, are suspected only where they are named.
    """
    bench: BenchTable = BenchTable()
    """What the laboratory can do in a next measurement."""


class PriorTable(TomlTable):
    """[confidence.priors] parameter: what is known of it before the measurement; it is cut at the window."""

    kind: PriorKind
    """Distribution: "normal" or "lognormal"."""
    mean: Quantity | None = None
    """Of a normal distribution."""
    median: Quantity | None = None
    """Of a lognormal distribution."""
    standard_deviation: Quantity
    """Of a normal distribution in the unit of the parameter, of a lognormal one that of the natural logarithm."""


class ConfidenceTable(TomlTable):
    """[confidence]: what `calib confidence` takes into account."""

    priors: dict[str, PriorTable] = {}
    """Parameter -> prior of `--posterior`; without one every value in the window is equally likely, on its scale."""


class StudyToml(TomlTable):
    """A whole study file."""

    study: StudyTable
    pool: PoolTable = PoolTable()
    record: Annotated[list[RecordTable], Field(min_length=1)]
    model: ModelTable
    windows: Annotated[dict[str, WindowTable], Field(min_length=1)]
    term: Annotated[list[TermTable], Field(min_length=1)]
    optimiser: OptimiserTable = OptimiserTable()
    store: StoreTable = StoreTable()
    diagnosis: DiagnosisTable = DiagnosisTable()
    confidence: ConfidenceTable = ConfidenceTable()
