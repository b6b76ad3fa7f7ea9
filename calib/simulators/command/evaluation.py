"""One evaluation: a deck rendered, its command lines tried one after the other, and the output read."""

import os
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import xarray as xr

from calib.errors import CalibError
from calib.records import DETAILS, OK, failed
from calib.simulators.command.cache import cache_key, cached, remember, shrink
from calib.simulators.command.inputs import Deck, Inputs
from calib.simulators.command.options import CommandOptions
from calib.simulators.command.readers import Columns
from calib.simulators.command.reading import Instants, OutputFault, read_columns, record_of
from calib.simulators.command.run_folder import RunFolder, drop_oldest, run_folder, sweep
from calib.simulators.command.rung import LOG, TIMEOUT, log_tail, run_rung

RUNS = "runs"  # folder of the run folders, below that of the results
MAX_KEPT_FAILED = 50  # folders of failed runs, unless all are kept
KEPT_NAME_DIGITS = 12  # hexadecimal, of the digest of its inputs, in the name of a folder that is kept
NOT_RENDERED = "not rendered"  # status of values that a template does not take
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "NUMBA_NUM_THREADS")
_TIDY: set[Path] = set()  # folders of results that this process has swept


@dataclass(frozen=True)
class Surroundings:
    """Where and how a program is run.

    Attributes
    ----------
    options : of the simulator
    inputs : files and command lines
    results : folder below which runs and cache are kept
    modules : folder of modules beside those on Python's path, for a reader
    lasting : whether `results` is there for other processes too, and later
    afresh : whether nothing that is remembered is the answer
    kept_as : name of the run folder once it has been used; empty where `options` say whether it is kept
    """

    options: CommandOptions
    inputs: Inputs
    results: Path
    modules: Path | None
    lasting: bool
    afresh: bool
    kept_as: str = ""

    @property
    def caching(self) -> bool:
        """Whether records are remembered below `results`."""
        return self.lasting and self.options.keeping.cache

    @property
    def environment(self) -> dict[str, str]:
        """Variables of the environment that are not those of `calib`."""
        program = self.options.program
        return {**dict.fromkeys(THREADS, str(program.cores)), **program.environment}

    def names(self, deck: Deck, instants: Instants, attrs: Mapping[str, Any]) -> dict[str, str]:
        """Names of the folders of a run that is "ok" and of one that has "failed"; empty for one that is not kept.

        The best run of a record takes the place of the one before, whatever its values.
        """
        keep, digest = self.options.keeping.keep, deck.digest[:KEPT_NAME_DIGITS]
        if self.kept_as:
            return {"ok": self.kept_as, "failed": self.kept_as}
        best = keep == "best" and self.afresh
        return {
            "ok": f"best-{_record_digest(instants, attrs)}" if best else f"ok-{digest}" if keep == "all" else "",
            "failed": f"failed-{digest}" if keep in ("failed", "all") else "",
        }

    def key(self, deck: Deck, instants: Instants, attrs: Mapping[str, Any]) -> str:
        """Name of a record in the cache."""
        keeping = self.options.keeping
        return cache_key(
            {
                "deck": deck.digest,
                "code": self.inputs.code,
                "environment": self.environment,
                "read": dict(self.options.reading.read),
                "times": instants.times.tobytes().hex(),
                "section": [instants.period, instants.periods, instants.settle],
                "limits": [keeping.fail_if, keeping.inactivity],
                "attrs": dict(attrs),
            }
        )


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
    tried : command lines, of which the last one has answered; none of an answer from the cache
    columns : what was read last; None where nothing was
    """

    record: xr.Dataset
    files: Mapping[str, bytes] = field(default_factory=dict)
    tried: tuple[TriedLine, ...] = ()
    columns: Columns | None = None


def evaluated(
    around: Surroundings, values: Mapping[str, object], instants: Instants, attrs: Mapping[str, Any]
) -> ProgramRun:
    """Answer from the cache, or run the program in a folder of its own.

    What decides the record is compared before and after with what it was when the study was read, so that no answer of
    another program is taken for one of this, and none is remembered.

    Parameters
    ----------
    values : what templates may name
    instants : at which the motion is recorded
    attrs : of the record

    Raises
    ------
    CodeChanged : a file, the program or the reader has changed since the study was read
    """
    around.inputs.check()
    try:
        deck = around.inputs.deck(values)
    except CalibError as error:
        return ProgramRun(failed(_bodies(around), NOT_RENDERED, str(error), **attrs))
    key = around.key(deck, instants, attrs) if around.caching else ""
    known = cached(around.results, key) if around.caching and not around.afresh else None
    if known is not None:
        return ProgramRun(known, deck.files)
    root = around.results / RUNS
    if around.lasting and around.results not in _TIDY:
        sweep(root)
        shrink(around.results)
        _TIDY.add(around.results)
    with run_folder(root) as folder:
        names = around.names(deck, instants, attrs)
        run = _climbed(folder, deck, around, instants, attrs, names["failed"])
        around.inputs.check()
        if name := names["ok" if run.record.attrs["status"] == OK else "failed"]:
            folder.moved(name)
            if name.startswith("failed-") and around.options.keeping.keep == "failed":
                drop_oldest(root, "failed-", MAX_KEPT_FAILED)
    if around.caching and run.record.attrs["status"] == OK:
        remember(around.results, key, run.record)
    return run


def _record_digest(instants: Instants, attrs: Mapping[str, Any]) -> str:
    return cache_key({"times": instants.times.tobytes().hex(), "attrs": dict(attrs)})[:KEPT_NAME_DIGITS]


def _bodies(around: Surroundings) -> list[str]:
    return list(around.options.reading.reading.channels)


def _climbed(
    folder: RunFolder, deck: Deck, around: Surroundings, instants: Instants, attrs: Mapping[str, Any], name: str
) -> ProgramRun:
    """Try one command line after the other, each in the folder as it was, until one gives a record.

    name : of the folder of a run that fails, once it is kept
    """
    keeping, reading = around.options.keeping, around.options.reading.reading
    environment, tried = {**os.environ, **around.environment}, list[TriedLine]()
    columns: Columns | None = None
    for rung, words in enumerate(deck.lines, start=1):
        folder.emptied(tuple(f"{LOG}.{before}" for before in range(1, rung)))
        deck.write(folder.path)
        end = run_rung(words, folder, environment, keeping.patterns, keeping.inactivity_seconds)
        status, reason = end.status, end.reason
        if not status:
            try:
                own = reading.of_rung(rung)
                columns = read_columns(folder.path, own, around.modules)
                record = record_of(columns, own, instants, {**attrs, **_said(rung, words, deck, tried)})
                tried.append(TriedLine(shlex.join(words), end.seconds, "", "", ""))
                return ProgramRun(record, deck.files, tuple(tried), columns)
            except OutputFault as fault:
                status, reason = fault.status, str(fault)
        tried.append(TriedLine(shlex.join(words), end.seconds, status, reason, log_tail(folder.path / LOG)))
        if status == TIMEOUT:
            break
        if rung < len(deck.lines):
            (folder.path / LOG).rename(folder.path / f"{LOG}.{rung}")
    place = f"{around.results.name}/{RUNS}/{name}" if name else ""
    record = failed(_bodies(around), tried[-1].status, _reason(tried, place), **attrs)
    return ProgramRun(record, deck.files, tuple(tried), columns)


def _reason(tried: list[TriedLine], place: str) -> str:
    """Return why all command lines failed, how the log of the last one ends, and where the run is kept."""
    reason = "; ".join(f"{one.command}: {one.reason}" for one in tried)
    details = [f"its log ends: {tried[-1].tail}"] if tried[-1].tail else []
    details += [f"kept in {place}"] if place else []
    return f"{reason}{DETAILS}{'; '.join(details)}" if details else reason


def _said(rung: int, words: tuple[str, ...], deck: Deck, tried: list[TriedLine]) -> dict[str, Any]:
    """Attributes of a record that say what made it."""
    said: dict[str, Any] = {"rung": rung, "command": shlex.join(words), "inputs": deck.digest}
    if tried:
        said["failed_rungs"] = "; ".join(f"{one.command}: {one.status}: {one.reason}" for one in tried)
    return said
