"""Frequency responses from delimited text, whose header says what each column is, and in which unit."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from calib.errors import CalibError, nearest
from calib.records.delimited import TextLayout, read_text
from calib.records.response import check_response, level_factor, make_response, numbered
from calib.records.sheet import Sheet
from calib.units import to_si

SUFFIXES = (".csv", ".txt", ".dat", ".tsv")
HEADING = re.compile(r"^\s*(?P<what>[^\[\]]+?)\s*(?:\[(?P<unit>[^\[\]]+)\])?\s*$")
ATTRIBUTE = re.compile(r"^#\s*(?P<key>place|quantity|source)\s*[:=]\s*(?P<value>.+?)\s*$")
COMMON = {"frequency": "Hz", "frequency sigma": "Hz", "level": "", "sweep": None, "direction": None}  # and their units
OF_BODY = {"amplitude": "m", "phase": "rad", "in-phase": "m", "quadrature": "m", "sigma": "m"}
DIRECTIONS = {"up": 1.0, "1": 1.0, "+1": 1.0, "down": -1.0, "-1": -1.0}
FORM = (
    "a frequency response has the columns 'frequency [Hz]' and, of each body, 'BODY amplitude [mm]' and "
    "'BODY phase [deg]', or 'BODY in-phase [mm]' and 'BODY quadrature [mm]'; further ones may be 'level [N]', "
    "'direction' (up or down), 'sweep', 'BODY sigma [mm]' and 'frequency sigma [Hz]'"
)


@dataclass(frozen=True)
class _Columns:
    """Columns of a file: position and unit of each by its name; those of a body by (body, name)."""

    common: Mapping[str, tuple[int, str]]
    of_body: Mapping[tuple[str, str], tuple[int, str]]

    @property
    def bodies(self) -> list[str]:
        return list(dict.fromkeys(body for body, _ in self.of_body))


def read_response(path: str | Path, level: tuple[float, str] | None = None) -> xr.Dataset:
    """Read a frequency response from delimited text.

    The first line that is no comment is the header, such as

        # place: mass
        # quantity: force
        frequency [Hz], level [N], direction, mass amplitude [mm], mass phase [deg], mass sigma [um]

    The phase is that of the displacement before the excitation, so that a response that lags has a negative one. Rows
    are in the order measured. A sweep ends where the level or the direction changes; where the level was measured point
    by point, a column `sweep` numbers them. Without a direction it is that from the first to the last frequency.

    Parameters
    ----------
    level : amplitude of the excitation and its unit, where the file has no column of it

    Raises
    ------
    CalibError : no such file, a column or unit that is missing or not known, a cell that is no number, with its line
    """
    path = Path(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise CalibError(f"{path} cannot be read: {error.strerror or error}") from error
    sheet = read_text(path, content, TextLayout(header=1))
    size = len(sheet.lines or ())
    if not size:
        raise CalibError(f"{path}: there are no rows below the header; {FORM}")
    columns = _columns(sheet)
    frequency = _numbers(sheet, columns.common["frequency"], "Hz", size)
    bodies = columns.bodies
    amplitude = np.array([_amplitude(sheet, columns, body, size) for body in bodies])
    levels, unit = _levels(sheet, columns, level, size)
    sweep, direction = _sweeps(sheet, columns, frequency, levels)
    sigmas = [columns.of_body.get((body, "sigma")) for body in bodies]
    stated = [_numbers(sheet, sigma, "m", size) for sigma in sigmas if sigma is not None]
    if 0 < len(stated) < len(bodies):
        lacking = bodies[sigmas.index(None)]
        raise CalibError(
            f"{path}: {lacking!r} has no column 'sigma', which another body has; give it to all or to none"
        )
    own = columns.common.get("frequency sigma")
    record = make_response(
        frequency, bodies, amplitude, levels, unit, sweep, direction, sigma=np.array(stated) if stated else None,
        frequency_sigma=None if own is None else _numbers(sheet, own, "Hz", size), **_attributes(content, path),
    )  # fmt: skip
    return check_response(record, str(path))


def has_frequencies(path: Path) -> bool:
    """Whether the header of a delimited text names a column of frequencies, as a response has it."""
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            header = next((line for line in file if line.strip() and not line.startswith("#")), "")
    except OSError:
        return False
    return bool(re.search(r"(^|[,;\t\"])\s*frequency\s*\[", header))


def _columns(sheet: Sheet) -> _Columns:
    names = [name for name in sheet.columns if isinstance(name, str)]
    common: dict[str, tuple[int, str]] = {}
    of_body: dict[tuple[str, str], tuple[int, str]] = {}
    for name in names:
        position = next(i for i in sheet.columns if isinstance(i, int) and sheet.columns[i] is sheet.columns[name])
        match = HEADING.match(name)
        what, unit = (match["what"], match["unit"] or "") if match else (name, "")
        body, _, of = what.rpartition(" ")
        if what in COMMON:
            known = common[what] = position, unit
            needs_unit = COMMON[what] is not None
        elif body and of in OF_BODY:
            known = of_body[body, of] = position, unit
            needs_unit = True
        else:
            hint = nearest(what, [*COMMON, *(f"{body} {one}" for one in OF_BODY if body)])
            raise CalibError(f"{sheet.path}: column {name!r} is not known{hint}; {FORM}")
        if needs_unit and not known[1]:
            raise CalibError(f"{sheet.path}: column {name!r} states no unit; write it in brackets, as in '{what} [mm]'")
    if "frequency" not in common or not of_body:
        raise CalibError(f"{sheet.path}: the columns are {names}; {FORM}")
    return _Columns(common, of_body)


def _numbers(sheet: Sheet, column: tuple[int, str], si: str, size: int) -> np.ndarray:
    position, unit = column
    try:
        factor = to_si(f"1 {unit}", si)
    except CalibError as error:
        raise CalibError(f"{sheet.path}: column {position}: {error}") from error
    return factor * sheet.numbers(position, 0, size)


def _amplitude(sheet: Sheet, columns: _Columns, body: str, size: int) -> np.ndarray:
    """Complex amplitude (point,) of a body  [m]."""
    own = {what: column for (its, what), column in columns.of_body.items() if its == body}
    for first, second in (("amplitude", "phase"), ("in-phase", "quadrature")):
        if first in own and second in own:
            one, other = (_numbers(sheet, own[what], OF_BODY[what], size) for what in (first, second))
            return one * np.exp(1j * other) if first == "amplitude" else one + 1j * other
    raise CalibError(f"{sheet.path}: of body {body!r} there are {sorted(own)}; {FORM}")


def _levels(sheet: Sheet, columns: _Columns, level: tuple[float, str] | None, size: int) -> tuple[np.ndarray, str]:
    """Levels (point,) and their SI unit."""
    if "level" in columns.common:
        position, unit = columns.common["level"]
        si, factor = level_factor(unit, f"{sheet.path}: column {position}")
        return factor * sheet.numbers(position, 0, size), si
    if level is None:
        raise CalibError(
            f"{sheet.path}: there is no column 'level [N]', the amplitude of the excitation; add it, or state the "
            "amplitude in [record.excitation]"
        )
    return np.full(size, level[0]), level[1]


def _sweeps(sheet: Sheet, columns: _Columns, frequency: np.ndarray, level: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Number of the sweep (point,) and direction (point,)."""
    size, stated = frequency.size, None
    if "direction" in columns.common:
        cells = sheet.columns[columns.common["direction"][0]]
        words = [str(cell).strip().lower() for cell in cells]
        for word, line in zip(words, sheet.lines or (), strict=True):
            if word not in DIRECTIONS:
                raise CalibError(f"{sheet.path}, line {line}: expected a direction 'up' or 'down', got {word!r}")
        stated = np.array([DIRECTIONS[word] for word in words])
    if "sweep" in columns.common:
        number = sheet.numbers(columns.common["sweep"][0], 0, size)
    else:
        number = numbered(level, stated)
    if stated is not None:
        return number, stated
    direction = np.empty(size)
    for one in np.unique(number):
        points = np.flatnonzero(number == one)
        steps = np.diff(frequency[points])
        if (steps > 0.0).any() and (steps < 0.0).any():
            line = (sheet.lines or range(1, size + 1))[points[0]]
            raise CalibError(
                f"{sheet.path}: the frequencies of the sweep from line {line} on rise and fall; add a column "
                "'direction' with up or down, or a column 'sweep' that numbers the sweeps"
            )
        direction[points] = -1.0 if (steps < 0.0).any() else 1.0
    return number, direction


def _attributes(content: bytes, path: Path) -> dict[str, str]:
    """Place, quantity and source that comments state."""
    found = {"source": path.name}
    for line in content.decode("utf-8", errors="replace").splitlines():
        match = ATTRIBUTE.match(line)
        if match:
            found[match["key"]] = match["value"]
    return found
