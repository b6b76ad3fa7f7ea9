"""A frequency response from the command line: its file, its pictures, and what is on it."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import click
import numpy as np

from calib.cli.given import bodies_drawn, map_at, quantity, setting, spare_other_files, windows
from calib.dynamics.orbit_kind import FAILED
from calib.dynamics.response import AMPLITUDE, FREQUENCY, FrequencyResponse, ResponseBranch, frequency_response
from calib.dynamics.response_dataset import response_dataset
from calib.dynamics.setting import Setting
from calib.errors import CalibError
from calib.execution.netcdf import write_dataset
from calib.report.plots.response import response_figure
from calib.report.plots.style import DPI
from calib.study_file import load
from calib.units import shown


def respond(
    study: Path,
    over: str,
    *,
    levels: str | None,
    harmonics: int,
    steps: int,
    most: int,
    isolas: bool,
    settings: Sequence[str],
    record: str | None,
    best: bool,
    bodies: str | None,
    out: Path | None,
    output: Path | None,
) -> bool:
    """Follow the periodic motions over the frequency at each level, write file and pictures, and say what is on them.

    Returns
    -------
    whether there is a periodic motion
    """
    file = load(study)
    held = setting(file, settings, record, best, out, 0.0)
    window = _window(over, held)
    drawn = bodies_drawn(bodies, file, record)
    amplitudes = _levels(levels, held)
    path = output or (out or file.folder) / "response.nc"
    spare_other_files(path, "branch_level", "calib response")
    response = frequency_response(
        held, window, amplitudes, harmonics=harmonics, steps=steps, most=most, isolas=isolas,
        on_level=lambda level, done: click.echo(
            f"level {done + 1} of {len(amplitudes)}: {shown(level, held.unit(AMPLITUDE))}", err=True
        ),
    )  # fmt: skip
    for line in described(response, drawn):
        click.echo(line)
    if not response.branches:
        low, high = (shown(end, "Hz") for end in window)
        click.echo(f"no periodic motion is followed from {low} to {high}: nothing is written")
        return False
    path.parent.mkdir(parents=True, exist_ok=True)
    dataset = response_dataset(response).assign_attrs(model=held.model.name)
    write_dataset(dataset, path)
    click.echo(f"response: {path}")
    for body in drawn:
        picture = path.with_name(f"{path.stem}_{body}.png")
        response_figure(dataset, body).savefig(picture, dpi=DPI)
        click.echo(f"picture: {picture}")
    return True


def _window(over: str, held: Setting) -> tuple[float, float]:
    """Read [excitation.]frequency=LOW:HIGH of --over [Hz]."""
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


def _levels(text: str | None, held: Setting) -> list[float]:
    """Read "A,B" of --levels into rising amplitudes (SI), each once; a percentage is of the record's."""
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


def described(response: FrequencyResponse, bodies: Sequence[str]) -> Iterator[str]:
    """Say, level by level, what the branches are, where they change, and the largest stable response."""
    for level in response.levels:
        own = response.at(level)
        yield f"level {shown(level, response.unit)}"
        for one in own:
            yield from _one(one)
        for body in bodies:
            yield from _largest(own, body, response.bodies.index(body))
    for met in response.irregular:
        why = f"{met.kind}: {met.evidence}" if met.kind == FAILED else met.kind
        yield f"not followed at level {shown(met.level, response.unit)}, {shown(met.frequency, 'Hz')}: {why}"


def _one(response: ResponseBranch) -> Iterator[str]:
    branch = response.branch
    low, high = shown(float(branch.parameter.min()), "Hz", 7), shown(float(branch.parameter.max()), "Hz", 7)
    stable = "stable" if branch.stable.all() else "unstable" if not branch.stable.any() else "stable in part"
    apart = ", apart from what a sweep comes to" if response.isolated else ""
    yield f"  period-{branch.periods}, {low} .. {high}, {stable}{apart}"
    for point in branch.points:
        yield f"    {point.kind} at {shown(point.parameter, 'Hz', 8)}"


def _largest(branches: Sequence[ResponseBranch], body: str, index: int) -> Iterator[str]:
    """Say where the first harmonic of a body is largest among the stable motions."""
    best: tuple[float, float] | None = None
    for one in branches:
        amplitude = np.where(one.branch.stable, np.abs(one.harmonics[index, 1]), 0.0)
        place = int(np.argmax(amplitude))
        if amplitude[place] > 0.0 and (best is None or amplitude[place] > best[0]):
            best = float(amplitude[place]), float(one.frequency[place])
    if best is not None:
        yield f"  largest stable first harmonic of {body}: {shown(best[0], 'm')} at {shown(best[1], 'Hz')}"
