"""The schema of a figure's description: its panels and curves."""

import re
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, PlainValidator, model_validator

from calib.errors import CalibError
from calib.study_file.mistakes import Mistakes, read_toml
from calib.study_file.schema import Quantity, TomlTable

Kind = Literal["phase curve", "displacement over time", "velocity over time"]
PERIOD_UNIT = "period"  # a unit of time axes: the period of the excitation
MIN_SAMPLES = 16


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e300:
        raise ValueError("expected a finite number")
    return float(value)


def _colour(value: str) -> str:
    if value != "black" and not re.fullmatch("#[0-9a-fA-F]{6}", value):
        raise ValueError("expected 'black' or a colour such as '#0072B2'")
    return value


Number = Annotated[float, PlainValidator(_number, json_schema_input_type=float)]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]


class PointTable(TomlTable):
    """One axis point: a pixel of the picture and the numbers that the axes have there."""

    pixel: Pair  # column and row, the middle of the first pixel is (0, 0)
    x: Number | None = None
    y: Number | None = None


class AxisTable(TomlTable):
    """One axis of a panel; the limits are those within which curves are looked for."""

    unit: str
    low: Number
    high: Number
    scale: Literal["linear", "log"] = "linear"

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.low < self.high:
            raise ValueError(f"expected low below high, got {self.low:g} and {self.high:g}")
        if self.scale == "log" and self.low <= 0.0:
            raise ValueError(f"a logarithmic axis begins above 0, got low = {self.low:g}")
        return self


class PanelTable(TomlTable):
    """[[panel]]: a pair of axes in a picture."""

    name: str
    x: AxisTable
    y: AxisTable
    points: Annotated[list[PointTable], Field(min_length=3)]
    reading: Annotated[float, Field(gt=0.0, lt=100.0)] = 0.3  # pixels, standard uncertainty of an axis point
    erase: list[Annotated[list[Number], Field(min_length=4, max_length=4)]] = []  # left, top, right, bottom [pixels]


class CurveTable(TomlTable):
    """[[curve]]: one curve, what it shows and of which body."""

    body: str
    kind: Kind
    name: str | None = None  # in an export
    columns: Annotated[list[str], Field(min_length=2, max_length=2)] | None = None  # of a plain table
    units: Annotated[list[str], Field(min_length=2, max_length=2)] | None = None  # of an export
    sigma: Annotated[list[Quantity], Field(min_length=2, max_length=2)] | None = None  # standard uncertainty across, up
    panel: str | None = None  # of a picture
    colour: Annotated[str, AfterValidator(_colour)] | None = None
    dashed: bool | None = None
    through: list[Pair] = []  # points that this curve alone passes through, in the units of the axes


class PrintedExcitation(TomlTable):
    """[excitation]: how the bodies were driven, as the paper says."""

    place: str
    quantity: str
    frequency: Quantity | None = None
    amplitude: Quantity | None = None


class FigureToml(TomlTable):
    """A whole description."""

    source: Annotated[str, Field(min_length=1)]  # who drew the figure, and where it is printed
    samples: Annotated[int, Field(ge=MIN_SAMPLES, le=100_000)] = 400  # a period of the record
    excitation: PrintedExcitation | None = None
    panel: list[PanelTable] = []
    curve: Annotated[list[CurveTable], Field(min_length=1)]


def read_spec(path: Path) -> tuple[FigureToml, Mistakes]:
    """Read a figure's description.

    Raises
    ------
    CalibError : no such file, no TOML, unknown or missing keys, values of another kind; each with file, line and key
    """
    if not path.is_file():
        raise CalibError(f"{path}: no such file; expected the figure's description (.toml)")
    return read_toml(FigureToml, path)
