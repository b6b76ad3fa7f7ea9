"""The commands of `calib`; what they do lives behind them."""

import json
import shlex
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from calib.cli.causes import diagnose, discover, rehearse
from calib.cli.motions import backbone, basins, branch, response, sweep
from calib.cli.options import (
    EXIT_DONE,
    EXIT_NOTHING,
    EXIT_STOPPED,
    FRESH,
    JOBS,
    JSON,
    OUT,
    POOL,
    RECORD,
    SET,
    STUDY,
    Commands,
    output_option,
    pool_table,
    reporting_mistakes,
)
from calib.cli.parameters import sensitivity, window
from calib.errors import WorkersLost
from calib.workflows.command_line import command_line

# ruff: noqa: D301 - click reads the "\b" of a docstring as "do not wrap"
# Everything but click is imported inside the command that needs it: numba, xarray and optuna take seconds, and
# `calib --help` has to answer at once.


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="calib")
def main() -> None:
    """Calibrate simulators of vibro-impacting structures against measured phase curves.

    A study file (study.toml) says what was measured, which simulator imitates it, and which parameters are searched in
    which windows. `calib run STUDY` does the rest, and leaves its results in out/ beside the study file.

    STUDY is a study file, or a folder with a study.toml in it.
    """


@main.command(short_help="Calibrate: search, judge, report; or go on where it stopped.")
@STUDY
@OUT
@click.option("--jobs", "-j", type=click.IntRange(min=1), help="Trials side by side. [default: the study's]")
@POOL
@click.option("--budget", type=click.IntRange(min=1), help="Trials of the whole study. [default: the study's]")
@click.option("--fresh", is_flag=True, help="Forget the trials made so far (needed when the study was changed).")
@click.option("--dry-run", "dry", is_flag=True, help="One run at the starting or nominal values; show what it gives.")
@click.option("--quiet", "-q", is_flag=True, help="No progress, no summary with its remarks; errors only.")
@JSON
@reporting_mistakes
def run(
    study: Path,
    out: Path | None,
    jobs: int | None,
    pool: str | None,
    budget: int | None,
    fresh: bool,
    dry: bool,
    quiet: bool,
    as_json: bool,
) -> None:
    """Search the parameters of STUDY that fit its records best; go on where an earlier run was stopped.

    Every trial is kept as it ends: a run that was stopped or killed goes on with the same command, and finds what it
    would have found uninterrupted.

    \b
    Leaves in out/:  result.json   values, intervals, score, kind of motion
                     report.html   the same as a page with pictures
                     best.nc       the best record
                     trials.jsonl  every trial

    Exit code: 0 done, 1 a mistake in the study, 3 stopped by you or for want of workers, 4 nothing was simulated.
    """
    from calib.cli.status import folder_of
    from calib.cli.tables import show_result
    from calib.records import OK
    from calib.workflows.calibrate import calibrate  # see above

    if dry:
        from calib.cli.dry_run import show_dry_run

        sys.exit(EXIT_DONE if show_dry_run(study, out) else EXIT_NOTHING)
    try:
        result = calibrate(study, out, budget=budget, jobs=jobs, fresh=fresh, quiet=quiet, pool=pool_table(pool))
    except (KeyboardInterrupt, WorkersLost) as stop:
        given = [("--out", out), ("--budget", budget), ("--jobs", jobs), ("--pool", pool)]
        again = command_line("run", study, *(str(x) for pair in given if pair[1] for x in pair))
        why = "stopped" if isinstance(stop, KeyboardInterrupt) else f"calib: {stop}"
        click.echo(f"\n{why}; every finished trial is kept. Go on with:  {again}", err=True)
        sys.exit(EXIT_STOPPED)
    if as_json:
        click.echo(json.dumps(result.as_dict(), indent=2, allow_nan=False))
    elif not quiet:
        show_result(result, folder_of(study, out))
    sys.exit(EXIT_DONE if result.status == OK else EXIT_NOTHING)


@main.command(short_help="How sure the calibrated values are: profiles of the likelihood.")
@STUDY
@OUT
@click.option("--pairs", multiple=True, metavar="A,B", help="Two parameters to profile together, or all; repeatable.")
@click.option("--posterior", is_flag=True, help="Sample the posterior distribution too; needs calib[confidence].")
@click.option("--only-posterior", is_flag=True, help="Sample the posterior distribution, without profiles.")
@click.option(
    "--sample-nuisances", is_flag=True, help="Of the posterior distribution: sample scale, shear and offset too."
)
@click.option("--compare", multiple=True, metavar="STUDY", type=click.Path(path_type=Path),
              help="Compare the evidence with that of another model of the same records; repeatable.")  # fmt: skip
@JOBS
@POOL
@FRESH
@click.option("--quiet", "-q", is_flag=True, help="No progress, no summary with its remarks; errors only.")
@JSON
@reporting_mistakes
def confidence(study: Path, **options: Any) -> None:
    """Say how sure the calibrated values of STUDY are, by the profile of the likelihood over each parameter.

    Each parameter is moved away from its best value, all others are searched again, and its interval ends where the
    likelihood-ratio statistic reaches its quantile: bounds that the curvature at the best point does not show. Needs
    what `calib run` has found. Goes on where it was stopped or killed.

    \b
    Leaves in out/:  confidence.json   intervals, profiles, contours of pairs, remarks
                     confidence.png    the same as a picture
    With --posterior:    posterior.nc, posterior.png, predictive.nc, predictive.png, ensemble.csv

    \b
    Example:  calib confidence studies/minimal --pairs restitution,damping
              calib confidence studies/minimal --compare studies/minimal/study.extended.toml
    """
    from calib.cli.confidence import print_confidence  # see above

    print_confidence(study, **options)


@main.command(short_help="How far a study is.")
@STUDY
@OUT
@JSON
@reporting_mistakes
def status(study: Path, out: Path | None, as_json: bool) -> None:
    """Say how far STUDY is: running, finished, stopped or killed."""
    from calib.cli.status import study_status  # see above
    from calib.cli.tables import show_status

    status = study_status(study, out)
    if as_json:
        click.echo(json.dumps(status.as_dict(), indent=2, allow_nan=False))
    else:
        show_status(status)


@main.command(short_help="One run at values given by hand: record and picture.")
@STUDY
@SET
@RECORD
@output_option("The record to write (.nc).", required=True)
@reporting_mistakes
def simulate(study: Path, settings: tuple[str, ...], record: str | None, output: Path) -> None:
    """Run the simulator of STUDY once and write its record, with a picture (.png) beside it.

    Parameters that are not set take the value that [model] fixed gives, else the model's nominal one.

    \b
    Example:  calib simulate studies/minimal --set restitution=0.2 --set gap='0.8 mm' -o loop.nc
    """
    from calib.cli.simulate import simulate_once  # see above

    sys.exit(EXIT_DONE if simulate_once(study, settings, record, output) else EXIT_NOTHING)


for command in (sweep, branch, response, backbone, basins, sensitivity, window, diagnose, discover, rehearse):
    main.add_command(command)


@main.command(short_help="A printed figure, or another tool's export of one, as a record.")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--spec", type=click.Path(path_type=Path), metavar="TOML", help="What the figure shows: axes and curves.")
@click.option("--list", "listed", is_flag=True, help="Name the curves of FILE, and do no more.")
@click.option("--body", "bodies", multiple=True, metavar="NAME", help="Only this body. [default: all of the spec]")
@output_option("The record to write (.nc).")
@reporting_mistakes
def digitise(file: Path, spec: Path | None, listed: bool, bodies: tuple[str, ...], output: Path | None) -> None:
    """Make a record of FILE, with its uncertainty and where it comes from.

    FILE is a picture of a figure (.png, .jpg, .tif), a project of WebPlotDigitizer (.json, .tar), a document of Engauge
    (.dig), or a table (.csv, .txt, .dat, .tsv). The spec says what its curves are; a table may begin with one, in
    comments. The time along a phase curve is recovered from dq = v dt. Beside the record of a picture an overlay
    (.overlay.png) shows what was traced.

    \b
    Example:  calib digitise figure2.png --spec figure2.toml -o clapping.nc
              calib digitise project.tar --list
    """
    from calib.cli.digitise import digitise_figure, list_curves  # see above

    if listed:
        list_curves(file, spec)
    elif output is None:
        raise click.UsageError("Missing option '-o' / '--output': the record to write.")
    else:
        digitise_figure(file, spec, output, bodies)


@main.group(short_help="What a reference record holds.")
def reference() -> None:
    """Look at reference records: those that simulations are compared with.

    \b
    Example:  calib reference show experiments_ref/clapping_beam/clapping.nc
    """


@reference.command(short_help="Draw a record, and say what it holds.")
@click.argument("record", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    help="The picture. [default: .png beside RECORD; of a study one for each record]",
)
@reporting_mistakes
def show(record: Path, output: Path | None) -> None:
    """Draw RECORD with its units and bands of two standard uncertainties, and say what it holds.

    RECORD is a record (.nc), or a study file, whose records are shown as the study reads them, tables too.

    Printed are its source, its kind of motion, the energy over its cycle, and warnings: a velocity that is not
    the derivative of the displacement, a loop that does not close, an impact that the samples do not resolve.

    \b
    Example:  calib reference show experiments_ref/clapping_beam/clapping.nc -o clapping.png
    """
    from calib.cli.digitise import show_reference  # see above

    show_reference(record, output)


@main.command(short_help="Write report.html anew.")
@STUDY
@OUT
@reporting_mistakes
def report(study: Path, out: Path | None) -> None:
    """Write report.html of STUDY anew from the trials made so far."""
    from calib.workflows.calibrate import rebuild  # see above

    click.echo(str(rebuild(study, out)))


@main.command(short_help="Watch the trials in a browser.")
@STUDY
@OUT
@click.option("--port", type=click.IntRange(0, 65535), default=8080, show_default=True, help="Port on this machine.")
@reporting_mistakes
def dashboard(study: Path, out: Path | None, port: int) -> None:
    """Show the trials of STUDY in a browser, running or not; read-only, on this machine only.

    Stop it with Ctrl-C.
    """
    from calib.cli.dashboard import plain_command, serve
    from calib.cli.status import view_of  # see above

    view = view_of(study, out)
    plain = f"the same without calib: {plain_command(*view)}"
    serve(*view, port=port, on_ready=lambda url: click.echo(f"{url}  (Ctrl-C ends it)\n{plain}"))


@main.command(name="list", short_help="Simulators, effects, features and optimisers there are.")
@click.argument("name", required=False)
@click.option("--schema", is_flag=True, help="Print the JSON schema of a study file, for editors.")
@JSON
@reporting_mistakes
def list_(name: str | None, schema: bool, as_json: bool) -> None:
    """List the simulators, effects, features and optimisers there are; with NAME, say more about one.

    NAME may be "module:Thing" too, of a module in the current folder or on Python's path.

    \b
    Example:  calib list four_dof
    """
    from calib.cli import catalogue, tables  # see above
    from calib.store.plain import plain

    if schema:
        click.echo(catalogue.schema())
    elif name is None:
        if as_json:
            click.echo(json.dumps(catalogue.catalogue(), indent=2))
        else:
            tables.show_catalogue(catalogue.sections())
    else:
        thing = catalogue.thing(name)
        facts, parameters = dict(catalogue.facts(thing)), catalogue.parameters(thing)
        if as_json:
            listed = [plain(asdict(parameter)) for parameter in parameters]
            click.echo(json.dumps({**facts, "parameters": listed}, indent=2, allow_nan=False))
        else:
            tables.show_thing(facts.items(), parameters)


@main.command(short_help="Begin a simulator, an effect or a study from a skeleton that works.")
@click.argument("kind", type=click.Choice(["simulator", "effect", "study"]))
@click.argument("name")
@click.option(
    "--folder", type=click.Path(path_type=Path, file_okay=False), default=Path(), help="Where. [default: here]"
)
@click.option("--program", is_flag=True, help="Of a study: its simulator is an external program, with its deck.")
@reporting_mistakes
def new(kind: str, name: str, folder: Path, program: bool) -> None:
    """Write a small working simulator, effect or study called NAME, with the test that it has to pass.

    \b
    Example:  calib new simulator pendulum && pytest test_pendulum.py
    """
    from calib.workflows.new import new as write_new  # see above
    from calib.workflows.new import thing_of

    files = write_new(kind, name, folder, program)
    click.echo("\n".join(map(str, files)))
    if kind == "study":
        click.echo(f"next: {command_line('run', folder / name)}")
    else:
        tested = shlex.join(["pytest", str(files[-1])])
        click.echo(f"next: {tested}; a study beside it knows it as {name}:{thing_of(kind, name)}")
