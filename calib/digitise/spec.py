"""The schema of a figure's description: its panels and curves."""

import re
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, PlainValidator, model_validator

from calib.errors import CalibError
from calib.study_file.mistakes import Mistakes, read_toml
from calib.study_file.schema import Quantity, TomlTable

Kind = Literal[
    "phase curve", "displacement over time", "velocity over time", "amplitude over frequency", "phase over frequency"
]
PERIOD_UNIT = "period"  # a unit of time axes: the period of the excitation
MIN_RECORD_SAMPLES = 16  # of a digitised record, per period


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
    """An entry of [[panel]] points: an axis point, a pixel of the picture with the numbers that the axes have there."""

    pixel: Pair
    """Column and row; the middle of the first pixel is (0, 0)."""
    x: Number | None = None
    """Number of the horizontal axis there."""
    y: Number | None = None
    """Number of the vertical axis there."""


class AxisTable(TomlTable):
    """[[panel]] x and y: an axis; the limits are those within which curves are looked for."""

    unit: str
    """Unit of its numbers; of a time axis also "period", that of the excitation; of amplitudes also "dB re 1 um"."""
    low: Number
    """Lower limit, just inside the frame."""
    high: Number
    """Upper limit, just inside the frame."""
    scale: Literal["linear", "log"] = "linear"
    """Scale of the axis: "linear" or "log"."""

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
    """Name by which curves refer to it."""
    x: AxisTable
    """Horizontal axis."""
    y: AxisTable
    """Vertical axis."""
    points: Annotated[list[PointTable], Field(min_length=3)]
    """Axis points: three or more, far apart and not on one line."""
    reading: Annotated[float, Field(gt=0.0, lt=100.0)] = 0.3
    """Standard uncertainty of an axis point, in pixels."""
    erase: list[Annotated[list[Number], Field(min_length=4, max_length=4)]] = []
    """Rectangles that are taken out, such as those of text: left, top, right, bottom, in pixels."""


class CurveTable(TomlTable):
    """[[curve]]: one curve, what it shows and of which body."""

    body: str
    """Body whose motion it shows."""
    kind: Kind
    """What it shows of it."""
    name: str | None = None
    """Name of the curve in an export of another tool."""
    columns: Annotated[list[str], Field(min_length=2, max_length=2)] | None = None
    """Columns of a plain table, across and up."""
    units: Annotated[list[str], Field(min_length=2, max_length=2)] | None = None
    """Units of an export or a table, across and up."""
    sigma: Annotated[list[Quantity], Field(min_length=2, max_length=2)] | None = None
    """Standard uncertainties, across and up, of an export or a table."""
    panel: str | None = None
    """Panel of the picture in which it is drawn."""
    colour: Annotated[str, AfterValidator(_colour)] | None = None
    """Colour of the line in a picture: "black", or "#0072B2" as a picture viewer picks it in its middle."""
    dashed: bool | None = None
    """Whether the line is dashed, where that distinguishes two of one colour."""
    through: list[Pair] = []
    """Points that this curve alone passes through, in the units of the axes."""
    level: Quantity | None = None
    """Over frequency, the amplitude of the excitation; without it that of [excitation]."""
    direction: Literal["up", "down"] = "up"
    """Over frequency, the direction of the sweep."""
    of: Literal["displacement", "velocity", "acceleration"] | None = None
    """Of a phase over frequency, the motion that it is the phase of; without it that of the amplitude."""


class PrintedExcitation(TomlTable):
    """[excitation]: how the bodies were driven, as the paper says."""

    place: str
    """Where it acts, in the words of the simulator."""
    quantity: str
    """Its quantity: "displacement", "base motion", "force", "free decay" or "servo reference"."""
    frequency: Quantity | None = None
    """Its frequency."""
    amplitude: Quantity | None = None
    """Its amplitude, of curves over frequency that state no level."""


class FigureToml(TomlTable):
    """The head of a description: where the figure comes from."""

    source: Annotated[str, Field(min_length=1)]
    """Who drew the figure, and where it is printed."""
    samples: Annotated[int, Field(ge=MIN_RECORD_SAMPLES, le=100_000)] = 400
    """Samples a period of the record that is made."""
    excitation: PrintedExcitation | None = None
    """How the bodies were driven."""
    panel: list[PanelTable] = []
    """Pairs of axes; none for exports of other tools."""
    curve: Annotated[list[CurveTable], Field(min_length=1)]
    """Curves that are read."""


def read_spec(path: Path) -> tuple[FigureToml, Mistakes]:
    """Read a figure's description.

    Raises
    ------
    CalibError : no such file, no TOML, unknown or missing keys, values of another kind; each with file, line and key
    """
    if not path.is_file():
        raise CalibError(f"{path}: no such file; expected the figure's description (.toml)")
    return read_toml(FigureToml, path)
