"""A frequency response from the command line: its file, its pictures, and what is on it."""

import hashlib
import pickle
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

import click
import numpy as np

from calib.cli.given import bodies_drawn, response_levels, response_window, setting, spare_other_files
from calib.dynamics.arclength import CLOSED, EDGE_OF_WINDOW, POINTS_ARE_MADE
from calib.dynamics.branch import Branch
from calib.dynamics.harmonic_response import TOUCHING, balanced_response
from calib.dynamics.orbit_kind import FAILED
from calib.dynamics.response import (
    AMPLITUDE,
    FrequencyResponse,
    Irregular,
    LevelKeeper,
    ResponseBranch,
    Truncation,
    frequency_response,
)
from calib.dynamics.response_dataset import response_dataset
from calib.dynamics.setting import Setting
from calib.errors import CalibError
from calib.execution.netcdf import write_dataset
from calib.report.plots.response import response_figure
from calib.report.plots.style import DPI
from calib.store.environment import environment
from calib.store.kept_results import KeptResults
from calib.study_file import load
from calib.units import count, shown

T = TypeVar("T")
LEVELS_FORMAT_VERSION = 1  # of the levels that are kept: those of another are followed anew
SHOOTING = "shooting"  # the method that is no harmonic balance
SHOT_HARMONICS, BALANCED_HARMONICS = 3, 7  # the highest that is kept of a motion, and of a series, without --harmonics


def respond(
    study: Path,
    over: str,
    *,
    levels: str | None,
    method: str,
    harmonics: int | None,
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
    window = response_window(over, held)
    drawn = bodies_drawn(bodies, file, record)
    amplitudes = response_levels(levels, held)
    path = output or (out or file.folder) / "response.nc"
    spare_other_files(path, "branch_level", "calib response")
    path.parent.mkdir(parents=True, exist_ok=True)
    highest = harmonics or (SHOT_HARMONICS if method == SHOOTING else BALANCED_HARMONICS)
    identity = [
        LEVELS_FORMAT_VERSION, held.definition(), file.study.code, environment(), window, method, highest, steps, most,
        isolas, None if method == SHOOTING else max(amplitudes),
    ]  # fmt: skip
    with KeptResults(path.with_name(f"{path.name}.levels"), identity) as kept:
        if kept.known:
            click.echo(f"going on with {count(kept.known, 'level')} of a run that did not end", err=True)
        response = _followed(held, window, amplitudes, method, highest, steps, most, isolas, partial(_kept, kept))
        for line in described(response, drawn):
            click.echo(line)
        dataset = response_dataset(response).assign_attrs(model=held.model.name) if response.branches else None
        if dataset is not None:
            write_dataset(dataset, path)
        kept.remove()
    if dataset is None:
        low, high = (shown(end, "Hz") for end in window)
        click.echo(f"no periodic motion is followed from {low} to {high}: nothing is written")
        return False
    click.echo(f"response: {path}")
    for body in drawn:
        picture = path.with_name(f"{path.stem}_{body}.png")
        response_figure(dataset, body).savefig(picture, dpi=DPI)
        click.echo(f"picture: {picture}")
    return True


def _followed(
    held: Setting,
    window: tuple[float, float],
    levels: Sequence[float],
    method: str,
    harmonics: int,
    steps: int,
    most: int,
    isolas: bool,
    keep: LevelKeeper,
) -> FrequencyResponse:
    """Follow the motions by shooting or by harmonic balance, and say on standard error what is being worked on."""
    unit = held.unit(AMPLITUDE)

    def on_level(level: float, done: int) -> None:
        click.echo(f"level {done + 1} of {len(levels)}: {shown(level, unit)}", err=True)

    if method == SHOOTING:
        return frequency_response(
            held, window, levels, harmonics=harmonics, steps=steps, most=most, isolas=isolas, on_level=on_level,
            keep=keep,
        )  # fmt: skip
    if isolas:
        raise CalibError("--isolas: curves apart from the others are sought by shooting; drop --method or --isolas")
    return balanced_response(
        held, window, levels, harmonics=harmonics, steps=steps, most=most, on_level=on_level, keep=keep
    )


def _kept(kept: KeptResults, level: float, follow: Callable[[], T]) -> T:
    """What is followed at a level, from the file of an earlier run where it is there."""
    key = hashlib.sha256(repr(float(level)).encode()).digest()
    if key in kept:
        found: T = pickle.loads(kept.get(key))
        return found
    followed = follow()
    kept.add(key, pickle.dumps(followed))
    return followed


def described(response: FrequencyResponse, bodies: Sequence[str]) -> Iterator[str]:
    """Say, level by level, what the branches are, where they change, and the largest stable response."""
    for level in response.levels:
        own = response.at(level)
        yield f"level {shown(level, response.unit)}"
        for one in own:
            yield from _one(one)
        for body in bodies:
            yield from _largest(own, body, response.bodies.index(body))
    if response.truncation is not None and response.branches:
        yield _left_out(response.truncation, response.unit)
    for level, why, alike in _alike(response.irregular):
        low, high = shown(alike[0], "Hz"), shown(alike[-1], "Hz")
        at = low if len(alike) == 1 else f"{low} .. {high} ({len(alike)} frequencies)"
        yield f"not followed at level {shown(level, response.unit)}, {at}: {why}"


def _alike(irregular: Sequence[Irregular]) -> Iterator[tuple[float, str, list[float]]]:
    """Group motions that are not followed for one reason: its level, the reason, and the frequencies, rising."""
    groups: dict[tuple[float, str], list[float]] = {}
    for met in irregular:
        why = f"{met.kind}: {met.evidence}" if met.kind in (FAILED, TOUCHING) else met.kind
        groups.setdefault((met.level, why), []).append(met.frequency)
    for (level, why), frequencies in groups.items():
        yield level, why, sorted(frequencies)


def _left_out(truncation: Truncation, unit: str) -> str:
    where = f"level {shown(truncation.level, unit)}, {shown(truncation.frequency, 'Hz')}"
    if not np.isfinite(truncation.largest):
        return (
            f"harmonic balance, {truncation.harmonics} harmonics: shooting finds no such motion at {where}: take more"
        )
    return (
        f"harmonic balance, {truncation.harmonics} harmonics: where shooting went on from its motions it changed their "
        f"state by at most {truncation.largest:.2g} of their size ({where})"
    )


def _one(response: ResponseBranch) -> Iterator[str]:
    branch = response.branch
    low, high = shown(float(branch.parameter.min()), "Hz", 7), shown(float(branch.parameter.max()), "Hz", 7)
    stable = "stable" if branch.stable.all() else "unstable" if not branch.stable.any() else "stable in part"
    apart = ", apart from what a sweep comes to" if response.isolated else ""
    yield f"  period-{branch.periods}, {low} .. {high}, {stable}{apart}"
    for point in branch.points:
        yield f"    {point.kind} at {shown(point.parameter, 'Hz', 8)}"
    for end, reason in _open_ends(branch):
        more = "; take more with --most" if reason.endswith(POINTS_ARE_MADE) else ""
        yield f"    not followed beyond {shown(float(branch.parameter[end]), 'Hz', 7)}: {reason}{more}"


def _open_ends(branch: Branch) -> list[tuple[int, str]]:
    """Indices of the ends at which a curve was left although it goes on, and why."""
    special = {point.index for point in branch.points}
    ends = zip((0, branch.parameter.size - 1), branch.ends, strict=True)
    return [
        (at, reason) for at, reason in ends
        if at not in special and reason != CLOSED and not reason.startswith(EDGE_OF_WINDOW)
    ]  # fmt: skip


def _largest(branches: Sequence[ResponseBranch], body: str, index: int) -> Iterator[str]:
    """Say where the first harmonic of a body is largest among the stable motions."""
    best: tuple[float, float] | None = None
    for one in branches:
        amplitude = np.where(one.branch.stable, np.abs(one.harmonics[index, 1]), 0.0)
        place = int(np.argmax(amplitude))
        if amplitude[place] > 0.0 and (best is None or amplitude[place] > best[0]):
            best = float(amplitude[place]), float(one.frequency[place])
    if best is not None:
        followed = ", of what was followed" if any(_open_ends(one.branch) for one in branches) else ""
        yield f"  largest stable first harmonic of {body}{followed}: {shown(best[0], 'm')} at {shown(best[1], 'Hz')}"
