"""`calib confidence`: the intervals of the profiles, printed."""

import json
import sys
from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from calib.cli.options import EXIT_STOPPED, pool_table
from calib.cli.status import folder_of
from calib.confidence.artifacts import CONFIDENCE
from calib.confidence.document import ComparisonResult, ConfidenceResult, PosteriorResult
from calib.confidence.profile import WINDOW_END
from calib.execution.progress import Count
from calib.report.formatting import distinguishing_digits
from calib.report.pages.confidence import comparison_remarks, prediction_remarks, sampling_remarks
from calib.units import count, plain_number, reading, shown
from calib.workflows.command_line import command_line
from calib.workflows.confidence import CONFIDENCE_PICTURE, confidence_study, pairs_of
from calib.workflows.posterior import POSTERIOR_FILES, damage_of_sample

MIN_DIGITS = 4  # significant ones of a printed value  [count]


def print_confidence(
    study: Path,
    out: Path | None,
    pairs: tuple[str, ...],
    only_posterior: bool,
    posterior: bool,
    sample_nuisances: bool,
    compare: tuple[Path, ...],
    jobs: int | None,
    pool: str | None,
    fresh: bool,
    quiet: bool,
    as_json: bool,
) -> None:
    """Profile the parameters, and print the intervals."""
    chosen = [pairs_of(text) for text in pairs]
    together = "all" if "all" in chosen else [pair for own in chosen if not isinstance(own, str) for pair in own]
    try:
        with Count("evaluations", quiet or as_json) as count:
            result = confidence_study(
                study,
                out,
                pairs=together,
                only_posterior=only_posterior,
                posterior=posterior,
                sample_nuisances=sample_nuisances,
                compare=compare,
                jobs=jobs,
                pool=pool_table(pool),
                fresh=fresh,
                on_progress=count,
            )
    except KeyboardInterrupt:
        given: list[tuple[str, object]] = [("--out", out), ("--jobs", jobs), ("--pool", pool)]
        given += [("--pairs", text) for text in pairs] + [("--compare", other) for other in compare]
        switches = {
            "--only-posterior": only_posterior,
            "--posterior": posterior,
            "--sample-nuisances": sample_nuisances,
        }
        flags = [name for name, on in switches.items() if on]
        stated = [str(part) for pair in given if pair[1] for part in pair]
        again = command_line("confidence", study, *flags, *stated)
        click.echo(f"\nstopped; every finished point is kept. Go on with:  {again}", err=True)
        sys.exit(EXIT_STOPPED)
    if as_json:
        click.echo(json.dumps(result.as_dict(), indent=2, allow_nan=False))
    elif not quiet:
        show(result, folder_of(study, out), Console(highlight=False))


def show(result: ConfidenceResult, folder: Path, console: Console) -> None:
    """Print the intervals beside the local ones, how they differ and why, remarks, and where the files are."""
    if result.profiles:
        console.print(_intervals(result))
    for profile in result.profiles:
        console.print(f"{escape(profile.name)}: {escape(profile.text)}", soft_wrap=True)
    for remark in result.remarks:
        console.print(f"[yellow]mind:[/] {escape(remark)}", soft_wrap=True)
    console.print(escape(result.noise), soft_wrap=True)
    console.print(count(result.evaluations, "evaluation"))
    names = [CONFIDENCE, *([CONFIDENCE_PICTURE] if result.profiles else []), "report.html"]
    if result.posterior is not None:
        own = result.posterior
        console.print(_marginals(result, own))
        priors = "; ".join(f"{one.name} {one.prior}" for one in own.parameters)
        console.print(f"priors: {escape(priors)}", soft_wrap=True)
        console.print(
            f"log evidence over the likelihood of the best point: {own.log_evidence:.2f} +- "
            f"{own.log_evidence_error:.2f}; effective sample size {own.effective_size:.0f}; "
            f"{count(own.evaluations, 'evaluation')}",
            soft_wrap=True,
        )
        for remark in sampling_remarks(own):
            console.print(f"[yellow]mind:[/] {escape(remark)}", soft_wrap=True)
        if own.confirmed is not None:
            console.print(f"confirming simulator: {escape(own.confirmed.text)}", soft_wrap=True)
        if own.predicted:
            console.print(_predictions(own))
        for remark in (text for record in own.predicted for text in prediction_remarks(record)):
            console.print(f"[yellow]mind:[/] {escape(remark)}", soft_wrap=True)
        names += [name for name in POSTERIOR_FILES if not damage_of_sample(folder, name)]
    if result.comparison is not None:
        _show_comparison(result.comparison, console)
    console.print(f"this run took {result.seconds:.1f} s")
    console.print(f"files:  {escape(str(folder))}/ ({', '.join(names)})", soft_wrap=True)


def _intervals(result: ConfidenceResult) -> Table:
    table = Table(title=f"{result.level:.1%} intervals of {escape(result.name)}", title_justify="left")
    table.add_column("parameter")
    for heading in ("value", "by the profile", "local"):
        table.add_column(heading, justify="right", no_wrap=True)
    for profile in result.profiles:
        digits = max(MIN_DIGITS, 1 + distinguishing_digits(profile.low.value, profile.high.value))

        def written(value: float, unit: str = profile.unit, digits: int = digits) -> str:
            return shown(value, unit, digits)

        ends = ("open" if end.cause == WINDOW_END else written(end.value) for end in (profile.low, profile.high))
        local = "-" if profile.local is None else " .. ".join(map(written, profile.local))
        table.add_row(escape(profile.name), written(profile.value), " .. ".join(ends), local)
    return table


def _marginals(result: ConfidenceResult, posterior: PosteriorResult) -> Table:
    table = Table(title=f"posterior distribution of {escape(result.name)}", title_justify="left")
    table.add_column("parameter")
    for heading in ("mean", "standard deviation", f"{result.level:.1%} interval"):
        table.add_column(heading, justify="right", no_wrap=True)
    for own in posterior.parameters:
        digits = max(MIN_DIGITS, 1 + distinguishing_digits(own.low, own.high))
        factor, unit = reading(own.unit, own.mean)
        interval = " .. ".join(shown(end, own.unit, digits) for end in (own.low, own.high))
        deviation = f"{plain_number(factor * own.standard_deviation, 2)} {unit}".rstrip()
        table.add_row(escape(own.name), shown(own.mean, own.unit, digits), deviation, interval)
    return table


def _predictions(posterior: PosteriorResult) -> Table:
    table = Table(title="samples inside the 95 % band that the posterior distribution predicts", title_justify="left")
    for heading in ("record", "body", "channel"):
        table.add_column(heading)
    for heading in ("inside", "noise"):
        table.add_column(heading, justify="right", no_wrap=True)
    for record in posterior.predicted:
        name = f"{record.name} (held out)" if record.held_out else record.name
        for own in record.channels:
            inside = "-" if own.inside is None else f"{own.inside:.1%}"
            table.add_row(*map(escape, (name, own.body, own.channel, inside, shown(own.noise, own.unit, 2))))
    return table


def _show_comparison(comparison: ComparisonResult, console: Console) -> None:
    table = Table(title="models by their evidence", title_justify="left")
    for heading in ("study", "effects"):
        table.add_column(heading, overflow="fold")
    for heading in ("best likelihood", "evidence", "Bayes factor"):
        table.add_column(f"ln {heading}", justify="right", no_wrap=True)
    for own in comparison.models:
        evidence = f"{own.log_evidence:.2f} +- {own.log_evidence_error:.2f}"
        factor = f"{own.factor:+.2f} +- {own.factor_error:.2f}" if own.text else "-"
        effects = ", ".join(own.effects) or "-"
        table.add_row(escape(own.name), escape(effects), f"{own.log_likelihood:.2f}", evidence, factor)
    console.print(table)
    for remark in comparison_remarks(comparison):
        console.print(escape(remark), soft_wrap=True)
