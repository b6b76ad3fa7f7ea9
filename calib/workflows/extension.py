"""The extended study: a study file with the causes of its misfit in its model, and windows for their sizes."""

import math
from collections.abc import Mapping, Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal
from pathlib import Path

import numpy as np
import tomlkit
from tomlkit.items import AbstractTable, InlineTable, Table

from calib.diagnosis.candidate import Candidate
from calib.diagnosis.fit import Fit
from calib.diagnosis.transfer import Transfer
from calib.execution.files import whole
from calib.modelling.parameter import Parameter, Space, Window
from calib.study_file import EXTENDED, StudyFile

# half width of the window in which the extended study searches a size; the largest of the three counts:
HALF_WIDTH_ERRORS = 4.0  # in standard errors of the size
HALF_WIDTH_INTERVALS = 2.0  # in half widths of its 95 % interval
HALF_WIDTH_DEPARTURES = 0.1  # in departures from null: the study's terms weigh records otherwise than the diagnosis
WINDOW_END_MARGIN = 0.1  # of a window: a value nearer to its end may be at its edge


def extended_study(
    file: StudyFile,
    final: Fit,
    causes: Sequence[Candidate],
    references: Mapping[str, str],
    transfers: Sequence[Transfer] = (),
    part: str = EXTENDED,
) -> Path:
    """Write the study with the causes of a misfit in its model; it starts where the fit with them ended.

    Parameters
    ----------
    final : the fit
    causes : at least one
    references : effect -> reference under which a study file knows it
    transfers : sizes that single records give to the parameters of the causes
    part : last part of its name, and of that of its file, which is written anew where it is there
    """
    document = tomlkit.parse(file.path.read_text(encoding="utf-8"))
    document["study"]["name"] = f"{document['study']['name']} {part}"
    _widened(document["windows"], file.study.space, file.study.model.parameters, final)
    _with_causes(document, references, final, causes, transfers)
    sizes = [name for cause in causes for name in cause.free]
    for name in (*file.study.space.names, *sizes):
        document["windows"][name]["start"] = final.value(name)
    path = file.path.with_name(f"{file.path.stem}.{part}.toml")
    with whole(path) as temporary:
        temporary.write_text(tomlkit.dumps(document), encoding="utf-8")
    return path


def _with_causes(
    document: tomlkit.TOMLDocument,
    references: Mapping[str, str],
    final: Fit,
    causes: Sequence[Candidate],
    transfers: Sequence[Transfer],
) -> None:
    """Add the causes to the model, and a window for each parameter that was fitted with them."""
    model = document["model"]
    effects = model.setdefault("effects", tomlkit.array())
    fixed = model.setdefault("fixed", tomlkit.inline_table())
    for cause in causes:
        effects.append(_entry(cause, references[cause.name]))
        for name, value in cause.held.items():
            fixed[name] = float(value)
        for name, window in _windows(cause, final, transfers).items():
            document["windows"][name] = tomlkit.inline_table()
            document["windows"][name].update({"low": window.low, "high": window.high})
            _remark(
                document["windows"],
                name,
                f"{HALF_WIDTH_ERRORS:g} joint standard errors on each side; sizes of the records",
            )


def _entry(cause: Candidate, reference: str) -> str | InlineTable:
    """Entry of [model] effects under which the effect loads that was found, on the same bodies."""
    bodies = cause.effect.bodies
    if bodies is None:
        return reference
    entry = tomlkit.inline_table()
    entry.update({"name": reference, "bodies": list(bodies)})
    return entry


def _windows(cause: Candidate, final: Fit, alone: Sequence[Transfer]) -> dict[str, Window]:
    """Window of each parameter of a cause, about its joint size and within the bounds of the parameter.

    It holds twice the 95 % interval and the sizes of the records that the diagnosis had, as far as they know more of it
    than that it is there, and is never narrower than a tenth of the size on each side.
    """
    windows = {}
    for p in cause.parameters:
        size, error = final.value(p.name), float(final.error([p.name])[0])
        interval = float(final.half_width([p.name])[0])  # wide where the error has few degrees of freedom
        departure = abs(size - (p.null if p.null is not None and np.isfinite(p.null) else 0.0))
        least = HALF_WIDTH_DEPARTURES * (departure or cause.scale[p.name])
        half = (
            max(HALF_WIDTH_ERRORS * error, HALF_WIDTH_INTERVALS * interval, least)
            if np.isfinite(interval)
            else max(departure, least)
        )
        own = [t.size for t in alone if t.parameter == p.name and not t.held and t.error <= departure]
        windows[p.name] = _rounded(min([size - half, *own]), max([size + half, *own]), half, p)
    return windows


def _rounded(low: float, high: float, half: float, parameter: Parameter) -> Window:
    """Window rounded outwards to a hundredth of its half width, as far as the parameter's bounds let it."""
    step = Decimal(1).scaleb(math.floor(math.log10(half)) - 2)
    low = float(Decimal(str(float(low))).quantize(step, ROUND_FLOOR))
    high = float(Decimal(str(float(high))).quantize(step, ROUND_CEILING))
    return Window(float(max(parameter.low, low)), float(min(parameter.high, high)))


def _widened(windows: AbstractTable, space: Space, parameters: Mapping[str, Parameter], final: Fit) -> None:
    """Widen the windows at whose edges the diagnosis ended, by half of their width on that side."""
    for name, window in space.windows.items():
        allowed = parameters[name.partition("@")[0]]
        ends = {"low": _widened_end(window, 0.0, allowed.low, final, name)}
        ends["high"] = _widened_end(window, 1.0, allowed.high, final, name)
        changed = {end: value for end, value in ends.items() if value != getattr(window, end)}
        if changed:
            windows[name].update(changed)
            _remark(windows, name, f"{' and '.join(changed)} widened: the diagnosis ended there")


def _remark(windows: AbstractTable, name: str, text: str) -> None:
    """Write a comment behind a window and what stands there already, where TOML has room for one."""
    if isinstance(windows, Table) and isinstance(windows[name], AbstractTable):
        known = windows[name].trivia.comment.removeprefix("#").strip()
        windows[name].comment("; ".join(filter(None, [known, text])))


def _widened_end(window: Window, end: float, bound: float, final: Fit, name: str) -> float:
    """End 0 (low) or 1 (high) of a window, where the fitted value is near it farther out, but not beyond the bound.

    Near is within `HALF_WIDTH_ERRORS` joint standard errors, and within a tenth of the window.
    """
    edge, value = window.value(end), final.value(name)
    near = (
        abs(value - edge) <= HALF_WIDTH_ERRORS * float(final.error([name])[0])
        and abs(window.position(value) - end) <= WINDOW_END_MARGIN
    )
    if not near:
        return edge
    factor = window.high / window.low if window.scale == "log" else 1.0
    step = 0.5 * (window.high - window.low)
    if end == 0.0:
        return max(bound, edge / math.sqrt(factor) if window.scale == "log" else edge - step)
    return min(bound, edge * math.sqrt(factor) if window.scale == "log" else edge + step)
