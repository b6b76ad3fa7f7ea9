"""What a dry run shows: `calib run --dry-run`."""

from pathlib import Path

import click
import numpy as np
import xarray as xr
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from calib.records import channels, mean_interval, stated_period
from calib.records.cycles import kind_of_motion
from calib.units import shown
from calib.workflows.amplitudes import MAX_AMPLITUDE_RATIO
from calib.workflows.dry_run import StudyDryRun, dry_run_study

PICTURE_WIDTH, PICTURE_HEIGHT = 72, 9  # characters
MAX_PICTURES = 4  # of (body, channel) pairs


def show_dry_run(study: Path, out: Path | None) -> bool:
    """Make a dry run, print what it has shown, and say whether its record can be compared."""
    dry = dry_run_study(study, out)
    console = Console(highlight=False)
    table = Table(title=f"dry run of record {escape(dry.record)}", title_justify="left", show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    units = ", ".join(f"{name} = {value:.6g}" for name, value in dry.values.items())
    for name, text in [("values [SI]", units), *dry.run.facts, *_of_record(dry)]:
        table.add_row(escape(name), escape(text))
    console.print(table)
    for text in _pictures(dry):
        click.echo(text)
    return dry.succeeded


def _of_record(dry: StudyDryRun) -> list[tuple[str, str]]:
    """What there is to say of the record."""
    record = dry.run.record
    status = [("status", str(record.attrs["status"]))]
    if not dry.succeeded:
        return [*status, ("reason", str(record.attrs.get("reason", "")))]
    interval, period = mean_interval(record), stated_period(record)
    rate = f"{record.sizes['time']} samples, {interval:.4g} s apart ({1.0 / interval:.6g} Hz)"
    if period is not None:
        rate += f", {record.sizes['time'] * interval / period:.4g} periods of {period:.6g} s"
    rows = [*status, ("samples", rate)]
    for channel in channels(record):
        for body in record.body.values:
            unit, half = record[channel].attrs["units"], _amplitude(record, channel, body)
            text = f"amplitude {shown(half, unit)}{_beside_measured(half, dry.measured, channel, body, unit)}"
            rows.append((f"{channel} of {body}", text))
    if any(channel in record for channel in ("displacement", "velocity")):
        motion = kind_of_motion(record)
        rows.append(("kind of motion", f"{motion.kind} ({motion.evidence})"))
    return rows


def _amplitude(record: xr.Dataset, channel: str, body: str) -> float:
    """Half of the range of a channel."""
    return 0.5 * float(np.ptp(record[channel].sel(body=body).values))


def _beside_measured(simulated: float, measured: xr.Dataset, channel: str, body: str, unit: str) -> str:
    """Say how a simulated amplitude compares with the measured one; nothing where it was not measured."""
    if channel not in measured or body not in measured.body.values:
        return ""
    amplitude = _amplitude(measured, channel, body)
    text = f"; measured {shown(amplitude, unit)}"
    if not (amplitude > 0.0 and simulated > 0.0):
        return text
    factor = simulated / amplitude
    check = "" if 1.0 / MAX_AMPLITUDE_RATIO <= factor <= MAX_AMPLITUDE_RATIO else ": check the units of both"
    return f"{text}, a factor of {factor:.3g}{check}"


def _pictures(dry: StudyDryRun) -> list[str]:
    """Draw the first channels over time, in characters."""
    if not dry.succeeded:
        return []
    record = dry.run.record
    pairs = [(str(body), channel) for channel in channels(record) for body in record.body.values][:MAX_PICTURES]
    return [
        f"{channel} of {body} over time\n{_drawn(record[channel].sel(body=body).values)}" for body, channel in pairs
    ]


def _drawn(values: np.ndarray) -> str:
    """Draw values (n,) as columns from the least to the largest of each share of the time."""
    low, high = float(values.min()), float(values.max())
    scale = (PICTURE_HEIGHT - 1) / ((high - low) or 1.0)
    rows = [[" "] * min(PICTURE_WIDTH, values.size) for _ in range(PICTURE_HEIGHT)]
    for column, part in enumerate(np.array_split(values, len(rows[0]))):
        top, bottom = (round((high - float(edge)) * scale) for edge in (part.max(), part.min()))
        for row in range(top, bottom + 1):
            rows[row][column] = "*"
    return "\n".join("  |" + "".join(row).rstrip() for row in rows)
