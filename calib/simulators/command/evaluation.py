"""One evaluation: a deck rendered, its command lines tried one after the other, and the output read."""

import os
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import xarray as xr

from calib.errors import CalibError
from calib.records import OK, failed
from calib.simulators.command.inputs import Deck, Inputs
from calib.simulators.command.options import CommandOptions, Reading
from calib.simulators.command.readers import Columns
from calib.simulators.command.reading import Instants, OutputFault, read_columns, record_of
from calib.simulators.command.run_folder import RunFolder, run_folder, sweep
from calib.simulators.command.rung import LOG, TIMEOUT, log_tail, run_rung

RUNS = "runs"  # folder of the run folders, below that of the results
NAME_DIGITS_OF_INPUTS = 12  # hexadecimal, of the digest of its inputs, in the name of a folder that is kept
NOT_RENDERED = "not rendered"  # status of values that a template does not take
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "NUMBA_NUM_THREADS")
_SWEPT: set[Path] = set()  # roots that this process has swept


@dataclass(frozen=True)
class TriedLine:
    """A command line that was run.

    Attributes
    ----------
    command : as a shell would take it
    seconds : wall-clock time  [s]
    status, reason : of a line that failed; both empty where its output was read
    tail : last lines of its log
    """

    command: str
    seconds: float
    status: str
    reason: str
    tail: str


@dataclass(frozen=True, eq=False)
class ProgramRun:
    """What became of an evaluation.

    Attributes
    ----------
    record : its answer
    files : name -> content of the rendered files
    tried : command lines, of which the last one has answered
    columns : what was read last; None where nothing could be
    """

    record: xr.Dataset
    files: Mapping[str, bytes] = field(default_factory=dict)
    tried: tuple[TriedLine, ...] = ()
    columns: Columns | None = None


def evaluated(
    inputs: Inputs,
    options: CommandOptions,
    reading: Reading,
    values: Mapping[str, object],
    instants: Instants,
    attrs: Mapping[str, Any],
    results: Path,
    modules: Path | None,
    afresh: bool,
) -> ProgramRun:
    """Run the program in a folder below `results`."""
    bodies = list(reading.channels)
    try:
        deck = inputs.deck(values)
    except CalibError as error:
        return ProgramRun(failed(bodies, NOT_RENDERED, str(error), **attrs))
    root = results / RUNS
    if root not in _SWEPT:
        sweep(root)
        _SWEPT.add(root)
    with run_folder(root) as folder:
        run = _climbed(folder, deck, options, reading, instants, attrs, modules)
        kept = _kept(options.keeping.keep, run.record, afresh)
        if kept:
            folder.moved(f"{kept}-{deck.digest[:NAME_DIGITS_OF_INPUTS]}")
    return run


def _kept(keep: str, record: xr.Dataset, afresh: bool) -> str:
    """Return the first part of the name under which a run folder is kept; empty where it is not."""
    if record.attrs["status"] != OK:
        return "failed" if keep in ("failed", "all") else ""
    if keep == "best" and afresh:
        return "best"
    return "ok" if keep == "all" else ""


def _climbed(
    folder: RunFolder,
    deck: Deck,
    options: CommandOptions,
    reading: Reading,
    instants: Instants,
    attrs: Mapping[str, Any],
    modules: Path | None,
) -> ProgramRun:
    """Try one command line after the other, each in the folder as it was, until one gives a record."""
    environment = {**os.environ, **dict.fromkeys(THREADS, str(options.program.cores)), **options.program.environment}
    keeping, tried = options.keeping, list[TriedLine]()
    columns: Columns | None = None
    for rung, words in enumerate(deck.lines, start=1):
        folder.emptied(tuple(f"{LOG}.{before}" for before in range(1, rung)))
        deck.write(folder.path)
        end = run_rung(words, folder, environment, keeping.patterns, keeping.inactivity_seconds)
        status, reason = end.status, end.reason
        if not status:
            try:
                columns = read_columns(folder.path, reading, modules)
                record = record_of(columns, reading, instants, {**attrs, **_said(rung, words, deck, tried)})
                tried.append(TriedLine(shlex.join(words), end.seconds, "", "", ""))
                return ProgramRun(record, deck.files, tuple(tried), columns)
            except OutputFault as fault:
                status, reason = fault.status, str(fault)
        tried.append(TriedLine(shlex.join(words), end.seconds, status, reason, log_tail(folder.path / LOG)))
        if status == TIMEOUT:
            break
        if rung < len(deck.lines):
            (folder.path / LOG).rename(folder.path / f"{LOG}.{rung}")
    reason = "; ".join(f"{one.command}: {one.reason}" for one in tried)
    if tried[-1].tail:
        reason += f"; its log ends: {tried[-1].tail}"
    record = failed(list(reading.channels), tried[-1].status, reason, **attrs)
    return ProgramRun(record, deck.files, tuple(tried), columns)


def _said(rung: int, words: tuple[str, ...], deck: Deck, tried: list[TriedLine]) -> dict[str, Any]:
    """Attributes of a record that say what made it."""
    said: dict[str, Any] = {"rung": rung, "command": shlex.join(words), "inputs": deck.digest}
    if tried:
        said["failed_rungs"] = "; ".join(f"{one.command}: {one.status}: {one.reason}" for one in tried)
    return said
