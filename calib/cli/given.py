"""Arguments of the command line, as values in SI and components of the study."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.dynamics.response import AMPLITUDE, FREQUENCY
from calib.dynamics.setting import Setting
from calib.errors import CalibError, nearest
from calib.execution.netcdf import read_dataset
from calib.modelling.orbit import PeriodMap
from calib.modelling.parameter import Parameter, Scale, Window
from calib.records import STATE, prescribed
from calib.study_file import StudyFile
from calib.units import shown, to_si
from calib.workflows.calibrated import calibrated_values

GRID = "LOW:HIGH:COUNT, LOW:HIGH:COUNT:log or A,B,C"


@contextmanager
def at(option: str) -> Iterator[None]:
    """Name the option in the message of a mistake."""
    try:
        yield
    except CalibError as error:
        raise CalibError(f"{option}: {error}") from error


def map_at(option: str, held: Setting, varied: Mapping[str, float] | None = None) -> PeriodMap:
    """Period map with other values (SI) of the parameters named.

    Raises
    ------
    CalibError : there is none, or these values, which `option` has given, let nothing move
    """
    try:
        return held.map(varied)
    except ValueError as error:
        raise CalibError(f"{option}: {error}") from error


def settings(texts: Sequence[str], parameters: Mapping[str, Parameter]) -> dict[str, float]:
    """Read NAME=VALUE texts of --set into SI values.

    Raises
    ------
    CalibError : no such parameter, a unit that does not fit, a value that makes no sense
    """
    values: dict[str, float] = {}
    for text in texts:
        name, value = _pair("--set", text, "NAME=VALUE")
        if name not in parameters:
            raise CalibError(
                f"--set: unknown parameter {name!r}{nearest(name, parameters)}; the model has {', '.join(parameters)}"
            )
        values[name] = quantity(f"--set {name}", value, parameters[name].unit)
        low, high, unit = (getattr(parameters[name], key) for key in ("low", "high", "unit"))
        if not low <= values[name] <= high:
            raise CalibError(f"--set {name}: expected a value in [{low:g}, {high:g}] {unit}, got {value}")
    return values


def setting(
    file: StudyFile, texts: Sequence[str], record: str | None, best: bool, out: Path | None, phase: float
) -> Setting:
    """Model and excitation at the fixed values, with `best` at those that the study has found, and --set over both.

    Raises
    ------
    CalibError : the study has found none yet, or those in the folder are of another study; or as `settings`
    """
    values: Mapping[str, float] = {}
    if best:
        folder = file.folder if out is None else out
        with at("--best"):
            values = calibrated_values(file, folder)
    held = file.setting(values, record, phase)
    # after the record's own values have taken the place of general ones: what the user says comes before both
    return replace(held, values={**held.values, **settings(texts, file.study.model.parameters)})


def grid(texts: Sequence[str], held: Setting) -> dict[str, np.ndarray]:
    """Read NAME=LOW:HIGH:COUNT (with ":log" behind it in equal ratios) and NAME=A,B,C of --over into SI values.

    Raises
    ------
    CalibError : it is neither; no such parameter, or a unit that does not fit
    """
    values: dict[str, np.ndarray] = {}
    for text in texts:
        name, given = _varied(text, f"NAME={GRID}", values)
        with at("--over"):
            unit = held.unit(name)
        values[name] = _values(f"--over {name}", given, unit)
        with at("--over"):
            held.check(name, values[name].tolist())
    return values


def spaced(option: str, text: str, units: Mapping[str, str]) -> tuple[str, np.ndarray]:
    """Read NAME=LOW:HIGH:COUNT (or as of --over) of a component of the state, in `units`, into its name and SI values.

    Raises
    ------
    CalibError : it is no such text; no such component, or a unit that does not fit
    """
    name, given = _pair(option, text, f"NAME={GRID}")
    unit = _component(option, name, units)
    return name, _values(f"{option} {name}", given, unit)


def _values(where: str, text: str, unit: str) -> np.ndarray:
    if ":" not in text:
        return np.array([quantity(where, part.strip(), unit) for part in text.split(",")])
    parts = [part.strip() for part in text.split(":")]
    if len(parts) not in (3, 4) or not parts[2].isdecimal() or int(parts[2]) < 2 or parts[3:] not in ([], ["log"]):
        raise CalibError(f"{where}: expected {GRID}, with a COUNT of 2 or more, got {text!r}")
    window = _window(where, parts[0], parts[1], unit, "log" if parts[3:] else "linear")
    return np.array([window.value(u) for u in np.linspace(0.0, 1.0, int(parts[2])).tolist()])


def windows(texts: Sequence[str], held: Setting, option: str = "--over") -> dict[str, Window]:
    """Read NAME=LOW:HIGH (with ":log" behind it for equal ratios) of an option into windows in SI.

    Raises
    ------
    CalibError : as `grid`
    """
    expected = "NAME=LOW:HIGH or NAME=LOW:HIGH:log"
    ranges: dict[str, Window] = {}
    for text in texts:
        name, given = _varied(text, expected, ranges, option)
        parts = [part.strip() for part in given.split(":")]
        if len(parts) not in (2, 3) or parts[2:] not in ([], ["log"]):
            raise CalibError(f"{option}: expected {expected}, without a COUNT, got {text!r}")
        with at(option):
            unit = held.unit(name)
        ranges[name] = window = _window(f"{option} {name}", parts[0], parts[1], unit, "log" if parts[2:] else "linear")
        with at(option):
            held.check(name, [window.low, window.high])
    return ranges


def state(text: str, units: Mapping[str, str]) -> dict[str, float]:
    """Read a state, "NAME=VALUE, NAME=VALUE" over components such as q3.displacement, into SI values by component.

    Parameters
    ----------
    units : of the components there are

    Raises
    ------
    CalibError : no such component, or a unit that does not fit
    """
    values: dict[str, float] = {}
    for part in filter(str.strip, text.split(",")):
        name, value = _pair("--start", part, "NAME=VALUE, NAME=VALUE")
        unit = _component("--start", name, units)
        values[name] = quantity(f"--start {name}", value, unit)
    return values


def _component(option: str, name: str, units: Mapping[str, str]) -> str:
    """Unit of a component of the state."""
    if name not in units:
        raise CalibError(f"{option}: no component {name!r}{nearest(name, units)}; the state has {', '.join(units)}")
    return units[name]


def bodies_drawn(text: str | None, file: StudyFile, record: str | None) -> list[str]:
    """Read "A,B" of --bodies; where nothing is given those of the record that are not the excitation's own.

    Raises
    ------
    CalibError : the simulator has no such body
    """
    known = file.study.model.bodies
    if text is None:
        measured = file.reference(record).record
        every = [str(body) for body in measured.body.values]
        return [body for body in every if not all((body, c) in prescribed(measured) for c in STATE)] or every
    named = [body.strip() for body in text.split(",")]
    for body in named:
        if body not in known:
            raise CalibError(f"--bodies: there is no body {body!r}{nearest(body, known)}; there are {', '.join(known)}")
    return named


def _pair(option: str, text: str, expected: str) -> tuple[str, str]:
    name, equals, value = (part.strip() for part in text.partition("="))
    if not (name and equals and value):
        raise CalibError(f"{option}: expected {expected}, got {text!r}")
    return name, value


def _varied(text: str, expected: str, known: Mapping[str, object], option: str = "--over") -> tuple[str, str]:
    name, value = _pair(option, text, expected)
    if name in known:
        raise CalibError(f"{option} {name} is given twice")
    return name, value


def _window(where: str, low: str, high: str, unit: str, scale: Scale) -> Window:
    ends = quantity(where, low, unit), quantity(where, high, unit)
    with at(where):
        return Window(*ends, scale)


def spare_other_files(path: Path, variable: str, command: str) -> None:
    """Pass where a result may be written to `path`: there is nothing, or a result of the same command.

    Raises
    ------
    CalibError : a file without the `variable` that marks results of `command`, or one that cannot be read
    """
    if not path.exists():
        return
    try:
        own = variable in read_dataset(path)
    except CalibError as error:
        raise CalibError(
            f"{error}; `{command}` writes over results of its own only: remove it or choose another name"
        ) from error
    if not own:
        raise CalibError(f"{path} is not a file of `{command}`; choose another name")


def quantity(where: str, text: str, unit: str) -> float:
    """Read a number in SI or with its unit.

    Raises
    ------
    CalibError : neither; `where` is the option that it stands at
    """
    with at(where):
        return to_si(_number(text), unit)


def _number(text: str) -> float | str:
    """Take a bare number as one in SI."""
    try:
        return float(text)
    except ValueError:
        return text


def response_window(over: str, held: Setting) -> tuple[float, float]:
    """Read [excitation.]frequency=LOW:HIGH of --over [Hz].

    Raises
    ------
    CalibError : another parameter, a logarithmic window, or no motion at an end of it
    """
    name, equals, given = over.partition("=")
    if name.strip() not in ("frequency", FREQUENCY) or not equals:
        raise CalibError(
            f"--over: a response is over the frequency of the excitation: expected frequency=LOW:HIGH, got {over!r}; "
            "`calib branch` follows a motion over other parameters"
        )
    [(_, window)] = windows([f"{FREQUENCY}={given}"], held).items()
    if window.scale == "log":
        raise CalibError('--over: a response is followed on a linear scale; drop ":log"')
    for end in (window.low, window.high):
        map_at(f"--over: frequency = {shown(end, 'Hz')}", held, {FREQUENCY: end})
    return window.low, window.high


def response_levels(text: str | None, held: Setting) -> list[float]:
    """Read "A,B" of --levels into rising amplitudes (SI), each once; a percentage is of the record's.

    Raises
    ------
    CalibError : no amplitude, or one that is not finite and positive
    """
    own = held.value(AMPLITUDE)
    if text is None:
        return [own]
    levels = []
    for part in (part.strip() for part in text.split(",")):
        if part.endswith("%"):
            levels.append(0.01 * quantity("--levels", part[:-1], "1") * own)
        else:
            levels.append(quantity("--levels", part, held.unit(AMPLITUDE)))
        if not (levels[-1] > 0.0 and np.isfinite(levels[-1])):
            raise CalibError(f"--levels: expected finite positive amplitudes of the excitation, got {part!r}")
    return sorted(set(levels))
