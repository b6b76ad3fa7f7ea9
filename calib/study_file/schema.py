"""The shape of a study file: which keys there are and what stands in them."""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, PlainValidator

from calib.diagnosis.laboratory import MAX_SIMULATIONS
from calib.modelling.parameter import Scale
from calib.objective.terms import Use
from calib.store.kept import Keep


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

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class _Open(TomlTable):
    """A table whose further keys are the options of what it names."""

    model_config = ConfigDict(extra="allow")

    @property
    def options(self) -> dict[str, Any]:
        """Keys that are not of the table itself."""
        return dict(self.model_extra or {})


class RequestTable(TomlTable):
    """What is computed of every record."""

    periods: Count = 6  # kept of a periodic motion
    samples: Annotated[int, Field(ge=8)] = 400  # a period
    settle: Annotated[int, Field(ge=0)] | None = None  # periods dropped first; not given: the simulator's own judgement
    step_budget: Count = 50_000_000


class StudyTable(RequestTable):
    """[study]."""

    name: str
    seed: Annotated[int, Field(ge=0)]
    budget: Count  # trials
    jobs: Count = 1  # child processes
    timeout: Quantity = "60 s"  # of one trial
    screen: Annotated[int, Field(ge=0)] | None = None  # trials; not given: the study's own choice


class ChannelTable(TomlTable):
    """One column of a table file."""

    column: Column
    body: str
    channel: str
    unit: str
    scale: Quantity = 1.0
    sigma: Quantity | None = None


class ClockTable(TomlTable):
    """The column that is time."""

    column: Column
    unit: str


class TableTable(TomlTable):
    """[record.table]: how a table file becomes a record."""

    channels: Annotated[list[ChannelTable], Field(min_length=1)]
    time: ClockTable | None = None
    rate: Quantity | None = None
    first: Annotated[int, Field(ge=0)] = 0
    last: int | None = None
    margin: Annotated[int, Field(ge=0)] = 0
    cutoff: Quantity | None = None
    decimate: Count = 1


class ExcitationTable(TomlTable):
    """[record.excitation]: how the bodies were driven."""

    place: str | None = None
    quantity: str
    frequency: Quantity | None = None
    amplitude: Quantity | None = None
    phase: Quantity = 0.0
    column: Column | None = None
    unit: str | None = None
    scale: Quantity = 1.0
    cutoff: Quantity | None = None


class RecordTable(TomlTable):
    """[[record]]."""

    name: Annotated[str, AfterValidator(_record_name)]
    path: str
    origin: str = ""  # where a user gets the file
    sha256: Annotated[str, AfterValidator(_digest)] | None = None
    use: Use = "calibrate"
    bodies: dict[str, str] | None = None  # record body = simulator body
    nuisance: list[str] | None = None  # not given: those that the record itself states, of a digitised figure
    table: TableTable | None = None
    excitation: ExcitationTable | None = None
    periods: Count | None = None
    samples: Annotated[int, Field(ge=8)] | None = None
    settle: Annotated[int, Field(ge=0)] | None = None
    step_budget: Count | None = None


class EffectTable(TomlTable):
    """An effect that acts on some bodies only."""

    name: str
    bodies: list[str] | None = None


class ModelTable(TomlTable):
    """[model]."""

    simulator: str
    effects: list[Annotated[EffectTable, BeforeValidator(_effect, json_schema_input_type=str | EffectTable)]] = []
    options: dict[str, Any] = {}
    fixed: dict[str, Quantity] = {}


class WindowTable(TomlTable):
    """The window of one parameter."""

    low: Quantity
    high: Quantity
    scale: Scale = "linear"
    start: Quantity | None = None  # the first trial is made there


class TermTable(_Open):
    """[[term]]."""

    feature: str
    bodies: list[str] | None = None
    records: list[str] | None = None
    weight: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] = 1.0


class OptimiserTable(_Open):
    """[optimiser]."""

    name: str = "multistart"
    batch: Count = 1  # points asked for at a time


class StoreTable(TomlTable):
    """[store]."""

    view: Annotated[str, AfterValidator(_view)] = "journal"
    keep: Keep = "improving"


class BenchTable(TomlTable):
    """[diagnosis.bench]: what the laboratory can do in a next measurement."""

    frequency: Bounds | None = None  # lowest and highest of a harmonic excitation
    amplitude: Bounds | None = None  # least and greatest, in a unit of the excitation's quantity
    release: Bounds | None = None  # least and greatest displacement from which a free decay begins
    tests: Annotated[list[str], Field(min_length=1)] | None = None  # kinds of test; not given: all that apply
    channels: list[str] | None = None  # "body.channel" that could be measured too; not given: all of the simulator
    simulations: Count = MAX_SIMULATIONS


class DiagnosisTable(TomlTable):
    """[diagnosis]."""

    candidates: Annotated[
        list[Annotated[EffectTable, BeforeValidator(_effect, json_schema_input_type=str | EffectTable)]] | None,
        BeforeValidator(_candidates, json_schema_input_type=Literal["all"] | list[str | EffectTable]),
    ] = None  # effects; None: all
    bench: BenchTable = BenchTable()


class StudyToml(TomlTable):
    """A whole study file."""

    study: StudyTable
    record: Annotated[list[RecordTable], Field(min_length=1)]
    model: ModelTable
    windows: Annotated[dict[str, WindowTable], Field(min_length=1)]
    term: Annotated[list[TermTable], Field(min_length=1)]
    optimiser: OptimiserTable = OptimiserTable()
    store: StoreTable = StoreTable()
    diagnosis: DiagnosisTable = DiagnosisTable()
