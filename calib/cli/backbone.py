"""Backbones from the command line: their file, their picture, and what is on them."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import click
import numpy as np

from calib.cli.given import quantity, response_levels, response_window, setting, spare_other_files
from calib.dynamics.backbone import backbones, constant_responses
from calib.dynamics.backbone_dataset import backbone_dataset
from calib.dynamics.held_curve import HeldBranch
from calib.dynamics.response import AMPLITUDE
from calib.errors import CalibError
from calib.execution.netcdf import write_dataset
from calib.report.plots.backbone import backbone_figure
from calib.report.plots.style import DPI
from calib.study_file import load
from calib.units import shown
from calib.workflows.command_line import command_line

LOWEST_LEVEL = 0.01  # at which a backbone begins, over the highest level, where one level is given  [1]
WELL_BALANCED = 1e-2  # velocity of the harmonics left out, above which more are advised  [1]


def draw_backbones(
    study: Path,
    over: str,
    body: str,
    *,
    levels: str | None,
    hold: str | None,
    harmonics: int,
    most: int,
    settings: Sequence[str],
    record: str | None,
    best: bool,
    out: Path | None,
    output: Path | None,
) -> None:
    """Follow motions in phase resonance, and at held amplitudes; write file and picture, and say what is on them."""
    file = load(study)
    held = setting(file, settings, record, best, out, 0.0)
    if not held.excitation.harmonic:
        raise CalibError(
            f"{study}: expected a record with a harmonic excitation, got {held.excitation.quantity}; choose one with "
            "--record, or draw frequency and damping of a measured decay over its amplitude with "
            f"`{command_line('reference', 'show', study)}`"
        )
    window = response_window(over, held)
    amplitudes = [quantity("--hold", part, "m") for part in hold.split(",")] if hold else []
    given = response_levels(levels, held)
    span = (given[0] if len(given) > 1 else LOWEST_LEVEL * given[0]), given[-1]
    path = output or (out or file.folder) / "backbone.nc"
    spare_other_files(path, "curve_of_point", "calib backbone")
    resonant = backbones(held, body, window, span, harmonics=harmonics, most=most)
    constant = constant_responses(held, body, amplitudes, window, harmonics=harmonics, most=most)
    unit = held.unit(AMPLITUDE)
    for line in said(resonant, constant, unit):
        click.echo(line)
    path.parent.mkdir(parents=True, exist_ok=True)
    dataset = backbone_dataset(resonant, constant, unit).assign_attrs(model=held.model.name)
    write_dataset(dataset, path)
    click.echo(f"backbone: {path}")
    picture = path.with_name(f"{path.stem}_{body}.png")
    backbone_figure(dataset).savefig(picture, dpi=DPI)
    click.echo(f"picture: {picture}")


def said(resonant: Sequence[HeldBranch], constant: Sequence[HeldBranch], unit: str) -> Iterator[str]:
    """Say where each curve runs, and what its harmonics leave out."""
    for one in resonant:
        (lowest, highest), (low, high), (small, large) = (
            tuple(shown(float(values[place]), of) for place in (0, -1))
            for values, of in ((one.level, unit), (one.frequency, "Hz"), (one.amplitude, "m"))
        )
        yield f"phase resonance of {one.body}: {low} at {lowest} ({small}) .. {high} at {highest} ({large}); {one.end}"
        yield from _too_few(one)
    for one in constant:
        least, most = (shown(float(value), unit) for value in (one.level.min(), one.level.max()))
        stable = "stable" if one.stable.all() else "stable in part" if one.stable.any() else "unstable"
        yield (
            f"{one.body} held at {shown(float(one.amplitude[0]), 'm')}: level {least} .. {most}, least at "
            f"{shown(float(one.frequency[np.argmin(one.level)]), 'Hz')}; {stable} at constant level; {one.end}"
        )
        yield from _too_few(one)


def _too_few(one: HeldBranch) -> Iterator[str]:
    largest = float(one.left_out.max())
    if largest > WELL_BALANCED:
        yield f"  the harmonics left out have {largest:.2g} of the velocity: take more --harmonics"
