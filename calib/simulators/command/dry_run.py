"""What a dry run of a program says beside its record."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from calib.simulators.command.evaluation import ProgramRun
from calib.simulators.command.options import CommandOptions

DRY_RUN = "dry-run"  # folder of the last dry run, below that of the runs
MAX_SHOWN_COLUMNS = 12  # of an output


def facts_of(run: ProgramRun, options: CommandOptions, runs: Path | None) -> Iterator[tuple[str, str]]:
    """Yield what was rendered, run and read, each with its name.

    runs : folder of the run folders, where they are kept
    """
    folder = None if runs is None or options.keeping.keep == "none" else runs / DRY_RUN
    for name, content in run.files.items():
        place = "" if folder is None or not run.tried else f" ({folder / name})"
        yield "rendered", f"{name}: {content.count(10)} lines, {len(content)} bytes{place}"
    for rung, line in enumerate(run.tried, start=1):
        yield f"rung {rung}", f"{line.command}: {line.reason or 'its output was read'} ({line.seconds:.3g} s)"
        if line.tail:
            yield "log ends", line.tail
    if run.columns is not None:
        yield from _columns(run, options)
    if run.tried and folder is not None:
        yield "run folder", str(folder)


def _columns(run: ProgramRun, options: CommandOptions) -> Iterator[tuple[str, str]]:
    if run.columns is None:
        return
    time, reading = np.asarray(run.columns.time, dtype=float), options.reading.reading
    if time.size > 1:
        step = float(np.median(np.diff(time)))
        yield "time", f"{time.size} instants from {time[0]:.6g} to {time[-1]:.6g}, {step:.4g} apart, as in the file"
    used = {one.column: f"{one.name} of {body} [{one.unit}]" for body, own in reading.channels.items() for one in own}
    names = sorted(run.columns.values, key=lambda name: name not in used)
    for name in names[:MAX_SHOWN_COLUMNS]:
        values = np.asarray(run.columns.values[name], dtype=float)
        low, high = (float(np.nanmin(values)), float(np.nanmax(values))) if values.size else (math.nan, math.nan)
        yield f"column {name}", f"{low:.6g} to {high:.6g}; {used.get(name, 'not used')}"
    if len(names) > MAX_SHOWN_COLUMNS:
        yield "more columns", ", ".join(names[MAX_SHOWN_COLUMNS : 3 * MAX_SHOWN_COLUMNS])
    if "resampled" in run.record.attrs:
        yield "resampled", str(run.record.attrs["resampled"])
