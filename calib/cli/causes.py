"""The commands of `calib` that look for the cause of a misfit; what they do lives behind them."""

from pathlib import Path
from typing import Any

import click

from calib.cli.options import (
    FRESH,
    JOBS,
    OUT,
    POOL,
    STUDY,
    CauseSearch,
    reporting_mistakes,
    searching_for_a_cause,
)

# ruff: noqa: D301 - click reads the "\b" of a docstring as "do not wrap"
# Everything but click is imported inside the command that needs it: see `calib.cli.commands`.


@click.command(short_help="What the simulation gets wrong, which effect is missing, what it would bring.")
@searching_for_a_cause(
    apply="Write study.extended.toml with the causes in the model.", budget="within which the search ends"
)
@reporting_mistakes
def diagnose(study: Path, **options: Any) -> None:
    """Say what the calibrated STUDY gets wrong, name the cause, and measure the gain, or say why no cause can be named.

    Needs what `calib run` has found. Records of use "name" take part in the search for the cause, records of use
    "holdout" only in the measurement of the gain. A diagnosis that was stopped or killed, or whose budget was spent,
    goes on with the same command.

    \b
    Leaves in out/:  diagnosis.json   verdict, suspects, gain, next measurement
                     diagnosis.nc     measured and simulated motions that it is about
                     report.html      the same as a page with pictures

    \b
    Example:  calib diagnose studies/minimal --apply && calib run studies/minimal/study.extended.toml
    """
    from calib.cli.diagnose import print_diagnosis  # see above

    print_diagnosis(study, CauseSearch(**options))


@click.command(short_help="The force that is missing: where it acts, as a function of what, and its formula.")
@searching_for_a_cause(
    apply="Write the force as an effect file, and study.found.toml with it.", budget="after which no further fit begins"
)
@reporting_mistakes
def discover(study: Path, **options: Any) -> None:
    """Find the force that the calibrated STUDY misses, as a free function of displacement, velocity or both.

    For laws that are in no library: the function is fitted inside the simulator, on each body in turn, and of what it
    is a function is decided by the prediction of records, or levels of a frequency response, that are left out.
    Formulas of at most four terms are then fitted inside the simulator too. Of frequency responses its describing
    function is told: equivalent stiffness and damping over the amplitude. Needs what `calib run` has found. A search
    that was stopped or killed, or whose budget was spent, goes on with the same command.

    \b
    Leaves in out/:  discovery.json   verdict, force with its errors over the visited region, formulas, models compared
                     discovery.png    the force with its 95 % band and its formula, where one was found
    With --apply:    effects/found_NAME.py and study.found.toml beside the study file

    \b
    Example:  calib discover studies/minimal --apply && calib run studies/minimal/study.found.toml
    """
    from calib.cli.discover import print_discovery  # see above

    print_discovery(study, CauseSearch(**options))


@click.command(short_help="What the experiment could show: each effect hidden and sought.")
@STUDY
@OUT
@click.option("--seeds", type=click.IntRange(min=1), default=3, show_default=True, help="Cases of each size.")
@click.option("--strengths", default="5,10,20,40", show_default=True, help="Sizes, by their predicted z.")
@JOBS
@POOL
@FRESH
@click.option("--quiet", "-q", is_flag=True, help="No progress, no summary with its remarks; errors only.")
@reporting_mistakes
def rehearse(study: Path, **options: Any) -> None:
    """Hide each candidate in data of STUDY's own model, noise and records, and seek it.

    Says which effects this experiment can detect, from which size on, and which it cannot distinguish. Needs what
    `calib run` has found. A rehearsal that was stopped or killed goes on with the same command.

    \b
    Example:  calib rehearse studies/minimal --seeds 5
    """
    from calib.cli.rehearse import print_rehearsal  # see above

    print_rehearsal(study, **options)
