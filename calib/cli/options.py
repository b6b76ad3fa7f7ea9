"""Arguments and options that the commands share, and how a command ends."""

import functools
import gc
import sys
import tomllib
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from calib.errors import CalibError, FirstRunFailed, FirstTrialsFailed, WorkersLost, nearest
from calib.execution.interrupt import ended_like_ctrl_c

POOL_KEYS = ("jobs", "memory")  # of a [pool] table; other options are those of the class that it names
ALLOCATIONS_PER_COLLECTION = 100_000  # of cyclic garbage; Python's 700 take a fifth of the time of imports and ledgers
EXIT_DONE, EXIT_MISTAKE, EXIT_STOPPED, EXIT_NOTHING = 0, 1, 3, 4  # exit codes; 2 is click's: wrong usage

STUDY = click.argument("study", type=click.Path(path_type=Path))
OUT = click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Where the results are. [default: out/ beside the study]",
)
SET = click.option("--set", "settings", multiple=True, metavar="NAME=VALUE", help="A parameter, such as gap='1.2 mm'.")
RECORD = click.option("--record", metavar="NAME", help="Whose excitation to take. [default: the first record]")
BEST = click.option("--best", is_flag=True, help="Take the values that `calib run` has found.")
PHASE = click.option(
    "--phase",
    type=click.FloatRange(0.0, 1.0, max_open=True),
    default=0.0,
    show_default=True,
    help="Of the section, in periods.",
)
BODIES = click.option("--bodies", metavar="A,B", help="In the picture. [default: those of the record]")
SETTLE = click.option(
    "--settle",
    type=click.IntRange(min=0),
    default=1000,
    show_default=True,
    help="Periods dropped before the first verdict; the undecided get 5 times as many more.",
)
JOBS = click.option("--jobs", "-j", type=click.IntRange(min=1), help="Child processes. [default: the study's]")
POOL = click.option(
    "--pool",
    metavar="KIND[:PLACE]",
    help="Where evaluations run: local, dask:tcp://HOST:8786, dask:module:Cluster or executor:module:Class, with "
    "options behind commas, such as executor:executorlib:SingleNodeExecutor,max_workers=4. [default: the study's]",
)
FRESH = click.option("--fresh", is_flag=True, help="Replace what the file holds, and forget what was done so far.")
JSON = click.option("--json", "as_json", is_flag=True, help="Print JSON to stdout, for scripts.")


@dataclass(frozen=True)
class CauseSearch:
    """Options of the commands that search a calibrated study for the cause of its misfit.

    Attributes
    ----------
    out : folder of the results; None: the study's
    apply : whether the extended study is written
    jobs, pool, seed, budget : as `calib.workflows.diagnose.diagnose_study` has them; the pool as --pool states it
    quiet : whether errors alone are told
    as_json : whether the result is printed as JSON
    """

    out: Path | None
    apply: bool
    jobs: int | None
    pool: str | None
    seed: int | None
    budget: str | None
    quiet: bool
    as_json: bool

    @property
    def silent(self) -> bool:
        """Whether no progress is shown."""
        return self.quiet or self.as_json

    @property
    def keywords(self) -> dict[str, Any]:
        """Keywords of the workflow."""
        return {
            "out": self.out,
            "seed": self.seed,
            "jobs": self.jobs,
            "apply": self.apply,
            "budget": self.budget,
            "pool": pool_table(self.pool),
        }


def searching_for_a_cause(apply: str, budget: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return the argument and the options of a command that takes a `CauseSearch`.

    apply : what --apply writes
    budget : what --budget bounds, as the end of a sentence
    """
    options = (
        STUDY,
        OUT,
        click.option("--apply", is_flag=True, help=apply),
        JOBS,
        POOL,
        click.option("--seed", type=click.IntRange(min=0), help="Of the noise that is drawn. [default: the study's]"),
        click.option("--budget", help=f"Simulations, or a time such as '10 min', {budget}."),
        click.option("--quiet", "-q", is_flag=True, help="No progress, no summary with its remarks; errors only."),
        JSON,
    )

    def decorated(command: Callable[..., Any]) -> Callable[..., Any]:
        return functools.reduce(lambda inner, option: option(inner), reversed(options), command)

    return decorated


def pool_table(text: str | None) -> dict[str, Any] | None:
    """Read KIND[:PLACE][,NAME=VALUE ...] of --pool into the keys of a [pool] table; values are TOML, or texts.

    Raises
    ------
    CalibError : a part that is no NAME=VALUE
    """
    if text is None:
        return None
    head, *options = text.split(",")
    kind, _, place = head.partition(":")
    table: dict[str, Any] = {"kind": kind}
    if place:
        table["scheduler" if kind == "dask" and "://" in place else {"dask": "cluster"}.get(kind, kind)] = place
    for option in options:
        name, equals, value = (part.strip() for part in option.partition("="))
        if not (name and equals and value):
            raise CalibError(f"--pool: expected NAME=VALUE behind a comma, got {option!r}")
        try:
            stated = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            stated = value
        (table if name in POOL_KEYS else table.setdefault("options", {}))[name] = stated
    return table


def data_file(context: click.Context, parameter: click.Parameter, path: Path | None) -> Path | None:
    """Refuse the name of a picture: the picture beside the file would take its place."""
    if path is not None and path.suffix.lower() == ".png":
        raise click.BadParameter(f"{path} is the name of a picture, which is written beside the data; end it in .nc")
    return path


def output_option(help: str, **more: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return the option `-o` of a command that writes a data file."""
    return click.option(
        "-o", "--output", type=click.Path(path_type=Path, dir_okay=False), callback=data_file, help=help, **more
    )


def reporting_mistakes(command: Callable[..., Any]) -> Callable[..., Any]:
    """Turn mistakes of the user into a message on stderr and exit code 1, and Ctrl-C into exit code 3."""

    @functools.wraps(command)
    def safe(*args: Any, **options: Any) -> Any:
        gc.set_threshold(ALLOCATIONS_PER_COLLECTION, 20, 100)
        with warnings.catch_warnings():
            warnings.showwarning = _note
            try:
                with ended_like_ctrl_c():
                    return command(*args, **options)
            except KeyboardInterrupt:
                click.echo("\nstopped", err=True)
                sys.exit(EXIT_STOPPED)
            except WorkersLost as error:
                click.echo(f"calib: {error}; what was finished is kept, and the same command goes on", err=True)
                sys.exit(EXIT_STOPPED)
            except (FirstRunFailed, FirstTrialsFailed) as error:
                click.echo(f"calib: {error}", err=True)
                sys.exit(EXIT_NOTHING)
            except CalibError as error:
                click.echo(f"calib: {error}", err=True)
            except OSError as error:
                at = f" ({error.filename})" if error.filename else ""
                click.echo(f"calib: {error.strerror or error}{at}; what was written before is kept", err=True)
            sys.exit(EXIT_MISTAKE)

    return safe


def _note(message: Warning | str, *_: object, **__: object) -> None:
    click.echo(f"calib: note: {message}", err=True)


class Commands(click.Group):
    """Commands; a misspelt one is answered with the nearest."""

    def resolve_command(
        self, context: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command that is asked for."""
        if args and args[0] not in self.commands and not args[0].startswith("-"):
            known = list(self.commands)
            context.fail(f"there is no command {args[0]!r}{nearest(args[0], known)}; there are {', '.join(known)}")
        return super().resolve_command(context, args)
