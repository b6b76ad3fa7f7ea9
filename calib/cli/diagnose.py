"""`calib diagnose`: the four answers, printed."""

import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bars
from rich.table import Table

from calib.cli.options import CauseSearch
from calib.cli.status import folder_of
from calib.diagnosis.document import DiagnosisResult, SuspectResult
from calib.diagnosis.verdict import NAMED, NONE, ONE_OF, UNEXPLAINED, explained
from calib.execution.pool import REFUSED
from calib.execution.progress import LINE_INTERVAL
from calib.report.formatting import distinguishing_digits, quantity
from calib.report.pages.diagnosis.conclusion import REFITTED, left_out, proposal, remedy
from calib.report.pages.diagnosis.levels import level_trends
from calib.report.pages.diagnosis.sizes import (
    disagreements,
    is_absorbed,
    is_untested,
    moved_sizes,
    moved_values,
    size_alone,
    sizes,
)
from calib.report.pages.diagnosis.suspects import explained_share, outcome
from calib.report.plots.suspects import SuspectOutcome
from calib.units import count
from calib.workflows.command_line import command_line
from calib.workflows.diagnose import diagnose_study

MAX_PRINTED_SUSPECTS = 12  # suspects that are printed
FULL_TABLE_COLUMNS = 110  # columns of a terminal in which all that is known of them fits
COLOURS = {NAMED: "green", ONE_OF: "yellow", NONE: "green"}


def print_diagnosis(study: Path, options: CauseSearch) -> None:
    """Diagnose, and print what was found."""
    with DiagnosisProgress(options.silent) as progress:
        diagnosis, extended = diagnose_study(
            study, on_stage=progress.stage, on_progress=progress.simulated, **options.keywords
        )
    if options.as_json:
        click.echo(json.dumps(diagnosis.as_dict(), indent=2, allow_nan=False))
    elif not options.quiet:
        show(diagnosis, folder_of(study, options.out), extended)
        if options.apply and extended is None:
            click.echo("no extended study is written: no effect was named")


class DiagnosisProgress:
    """What a diagnosis is doing, on stderr: a bar over its simulations, or a line now and then without a terminal."""

    def __init__(self, quiet: bool, console: Console | None = None, clock: Callable[[], float] = time.monotonic):
        self._console, self._quiet = console or Console(stderr=True, highlight=False), quiet
        self._clock, self._begin, self._stage, self._told = clock, clock(), "starting", -np.inf
        self._bar: Bars | None = None

    def __enter__(self) -> "DiagnosisProgress":
        if self._console.is_terminal and not self._quiet:
            columns = TextColumn("{task.fields[stage]:<18}"), BarColumn(bar_width=30), TextColumn("{task.fields[text]}")
            self._bar = Bars(SpinnerColumn(), *columns, TimeElapsedColumn(), console=self._console, transient=True)
            self._task = self._bar.add_task("diagnosis", total=None, stage=self._stage, text="")
            self._bar.start()
        return self

    def __exit__(self, *exception: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def stage(self, stage: str) -> None:
        """Say what begins."""
        self._stage, self._told = stage, -np.inf
        if self._bar is not None:
            self._bar.update(self._task, stage=stage)
        else:
            self._line("")

    def simulated(self, done: int, foreseen: int) -> None:
        """Take in how many simulations are done, and how many are foreseen in all."""
        text = f"{done} of about {foreseen} simulations" if done < foreseen else count(done, "simulation")
        if self._bar is not None:
            self._bar.update(self._task, completed=done, total=max(done, foreseen), text=text)
        elif self._clock() - self._told > LINE_INTERVAL:
            self._line(text)

    def _line(self, text: str) -> None:
        if not self._quiet:
            self._told = self._clock()
            self._console.print(f"{self._told - self._begin:6.1f} s  {self._stage}{text and f': {text}'}")


def show(diagnosis: DiagnosisResult, folder: Path, extended: Path | None, console: Console | None = None) -> None:
    """Print a diagnosis, where its files are, and the path of the extended study where there is one."""
    console = console or Console(highlight=False)
    colour = COLOURS.get(diagnosis.verdict, "yellow")
    console.print(f"[bold {colour}]{diagnosis.verdict}[/]: {escape(diagnosis.full_summary)}", soft_wrap=True)
    for gate in diagnosis.gates:
        if not gate.passed:
            console.print(f"[red]gate {gate.name}[/]: {escape(gate.summary)}", soft_wrap=True)
            console.print(f"what to do: {escape(remedy(gate))}", soft_wrap=True)
    if len(diagnosis.joint_sizes) > 1:
        joint = (", ".join((name, *sizes(size))) for name, size in diagnosis.joint_sizes.items())
        console.print(f"sizes of causes fitted together: {escape('; '.join(joint))}", soft_wrap=True)
    if diagnosis.suspects:
        console.print(_suspects(diagnosis, console.width))
    for line in _refused(diagnosis.suspects):
        console.print(escape(line), soft_wrap=True)
    for line in level_trends(diagnosis):
        console.print(escape(line), soft_wrap=True)
    for line in (*left_out(diagnosis), *_gain(diagnosis), *disagreements(diagnosis), *moved_sizes(diagnosis)):
        console.print(line, soft_wrap=True)
    if diagnosis.verdict == ONE_OF and diagnosis.design is not None:
        console.print(escape(proposal(diagnosis.measurements)), soft_wrap=True)
        for line in _design(diagnosis):
            console.print(escape(line), soft_wrap=True)
    if diagnosis.verdict == UNEXPLAINED:
        hint = "calib discover looks for a force that no effect has, as a free function"
        console.print(hint, soft_wrap=True)
    console.print(f"{count(diagnosis.simulations, 'simulation')} in {diagnosis.seconds:.1f} s")
    console.print(f"files:  {escape(str(folder))}/ (diagnosis.json, diagnosis.nc, report.html)", soft_wrap=True)
    if extended is not None:
        told = f"extended study:  {extended}   ({command_line('run', extended)})"
        console.print(escape(told), soft_wrap=True)


def _suspects(diagnosis: DiagnosisResult, width: int) -> Table:
    threshold = "" if diagnosis.threshold is None else f" (threshold |z| = {diagnosis.threshold:.2f})"
    table = Table(title=f"suspects, each alone in the model{threshold}", title_justify="left")
    wide, estimated = width >= FULL_TABLE_COLUMNS, False
    table.add_column("effect", no_wrap=True)
    for heading in ("z", "explains", "size, 95 % interval", *(("detectable", "absorbed") if wide else ())):
        table.add_column(heading, justify="right", no_wrap=not heading.startswith("size"))
    for suspect in sorted(diagnosis.suspects, key=is_absorbed)[:MAX_PRINTED_SUSPECTS]:
        first, absorbed = next(iter(suspect.size)), is_absorbed(suspect)
        scored = suspect.z is not None and not absorbed and not is_untested(suspect)
        row = (
            escape(suspect.effect),
            f"{suspect.z:.1f}" if scored else "-",
            _explains(suspect, diagnosis),
            "-" if absorbed else ", ".join(sizes(size_alone(suspect, diagnosis))),
        )
        least = None if absorbed else suspect.detectable[first]
        further = quantity(least, suspect.units[first], 2), f"{suspect.absorbed:.0%}"
        table.add_row(*row, *(further if wide else ()))
        estimated |= row[2].endswith("*")
    if estimated:
        table.caption = "*: estimate without a new fit"
    return table


def _refused(suspects: Sequence[SuspectResult]) -> list[str]:
    """Suspects with which the simulator runs nothing, a line for each reason."""
    names: dict[str, list[str]] = {}
    for suspect in suspects:
        status, _, reason = suspect.reason.partition(": ")
        if status == REFUSED:
            names.setdefault(reason, []).append(suspect.effect)
    return [f"not tested: {', '.join(own)}; {reason}" for reason, own in names.items()]


def _explains(suspect: SuspectResult, diagnosis: DiagnosisResult) -> str:
    judged = outcome(suspect, diagnosis)
    if judged == SuspectOutcome.WRONG_SIGN:
        return "wrong sign"
    share = explained_share(suspect, judged, diagnosis)
    return "-" if share is None else explained(share) + ("" if suspect.refitted else "*")


def _gain(diagnosis: DiagnosisResult) -> list[str]:
    gain = diagnosis.gain
    if gain is None or gain.before is None:
        return []
    low, high = gain.interval
    if low is None or high is None:
        change = "of unknown significance"
    elif high < 0.0:
        digits = distinguishing_digits(low, high)
        change = f"more by {-high:.{digits}g} to {-low:.{digits}g} [yellow]- what was held out refutes it[/]"
    else:
        digits = distinguishing_digits(low, high)
        change = f"less by {low:.{digits}g} to {high:.{digits}g}"
        change += "" if gain.proven else " [yellow]- no gain: the interval includes zero[/]"
    lines = [
        f"gain on {gain.kind} ({', '.join(gain.records)}): misfit {gain.before:.3g} -> {gain.after:.3g}, {change}",
        f"misfit: {gain.metric}; {REFITTED}",
    ]
    if moved_values(gain):
        lines.append(f"calibrated values move by more than two standard errors: {'; '.join(moved_values(gain))}")
    return lines


def _design(diagnosis: DiagnosisResult) -> list[str]:
    """Best separation of each kind of test, and what the search for it took."""
    design = diagnosis.design
    if design is None:
        return []
    best: dict[str, str] = {}
    for measurement in diagnosis.measurements:
        if not measurement.channel:
            doubt = "" if measurement.confirmed else " (not confirmed)"
            best.setdefault(measurement.kind, f"{measurement.kind} {measurement.z:.3g}{doubt}")
    kinds = ", ".join(best.values())
    return [f"best z of each kind of test: {kinds} ({count(design.simulations, 'simulation')})"] if best else []
