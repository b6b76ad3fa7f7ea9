"""The commands of `calib` that ask what the parameters do, or how far they may vary; what they do lives behind them."""

import sys
from pathlib import Path
from typing import Any

import click

from calib.cli.options import EXIT_DONE, EXIT_NOTHING, FRESH, JOBS, JSON, OUT, POOL, STUDY, reporting_mistakes

# ruff: noqa: D301 - click reads the "\b" of a docstring as "do not wrap"
# Everything but click is imported inside the command that needs it: see `calib.cli.commands`.


@click.command(short_help="Which parameter moves which feature of the motion.")
@STUDY
@OUT
@click.option("--method", type=click.Choice(["morris", "sobol"]), default="morris", show_default=True,
              help="Screening by elementary effects, or variance-based indices.")  # fmt: skip
@click.option("--trajectories", type=int, metavar="N", help="Of Morris: N (parameters + 1) points. [default: 20]")
@click.option("--samples", type=int, metavar="N", help="Of Sobol, a power of two: N (parameters + 2) points. "
              "[default: 128]")  # fmt: skip
@click.option("--seed", type=click.IntRange(min=0), help="Of points and bootstrap. [default: the study's]")
@JOBS
@POOL
@FRESH
@click.option("--quiet", "-q", is_flag=True, help="No progress, no summary with its remarks; errors only.")
@JSON
@reporting_mistakes
def sensitivity(study: Path, **options: Any) -> None:
    """Say which parameter moves which feature of STUDY's motion inside its windows, and which decides its kind.

    Nothing has to be calibrated before. Motions of another kind than the measured one, and simulations that fail, have
    shares of the box and indices of their own; the other indices are of the motions of the measured kind alone. A log
    window is sampled in the logarithm. What was stopped or killed goes on with the same command; more --trajectories or
    --samples go on from fewer.

    \b
    Leaves in out/:  sensitivity.json   shares, indices with 95 % intervals
                     sensitivity.png    the same as a map of outputs and parameters
                     sensitivity/       every point, in a ledger for each method

    \b
    Example:  calib sensitivity studies/minimal --trajectories 30
    """
    from calib.cli.sensitivity import print_sensitivity  # see above

    sys.exit(EXIT_DONE if print_sensitivity(study, **options) else EXIT_NOTHING)


@click.command(short_help="Where the model behaves as was measured, and how far parameters may vary.")
@STUDY
@OUT
@click.option("--budget", type=click.IntRange(min=1), default=300, show_default=True, help="Points in all.")
@click.option("--tolerance", "-t", multiple=True, metavar="[TERM=]VALUE",
              help="Largest distance of an admissible point, of a term or of each. [default: 0.05, or the square root "
              "of 2 times the calibrated distance where that is more]")  # fmt: skip
@click.option("--exact", is_flag=True, help="Follow grazing, fold and flip curves over every slice, and say how far "
              "the emulated boundary is from them. Needs a simulator with a period map.")  # fmt: skip
@click.option("--seed", type=click.IntRange(min=0), help="Of points and draws. [default: the study's]")
@JOBS
@POOL
@FRESH
@click.option("--quiet", "-q", is_flag=True, help="No progress, no summary with its remarks; errors only.")
@JSON
@reporting_mistakes
def window(study: Path, **options: Any) -> None:
    """Draw the window of STUDY's parameters inside which the model behaves as was measured.

    STUDY has to be calibrated before. A point is admissible where the motion is of the measured kind in all records,
    and the distance of each term is within its tolerance. Every condition is emulated as a graded margin, and points
    are evaluated where they make the boundary most certain. What was stopped or killed goes on with the same command; a
    larger --budget goes on from a smaller one.

    \b
    Leaves in out/:  window.json   share of the box, what bounds the window where, tolerances, largest box and ellipsoid
                     window.nc     points, probabilities, slices
                     window.png    slices and projections
                     window/       every point, in a ledger

    \b
    Example:  calib window studies/minimal --tolerance 0.1
    """
    from calib.cli.window import print_window  # see above

    print_window(study, **options)
