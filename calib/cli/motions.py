"""The commands of `calib` on the motions of a simulator, its dynamics; what they do lives behind them."""

import sys
from pathlib import Path
from typing import Any

import click

from calib.cli.options import (
    BEST,
    BODIES,
    EXIT_DONE,
    EXIT_NOTHING,
    FRESH,
    JOBS,
    OUT,
    PHASE,
    POOL,
    RECORD,
    SET,
    SETTLE,
    STUDY,
    output_option,
    reporting_mistakes,
)

# ruff: noqa: D301 - click reads the "\b" of a docstring as "do not wrap"
# Everything but click is imported inside the command that needs it: see `calib.cli.commands`.


@click.command(short_help="Motions over one or two parameters: file and bifurcation diagram.")
@STUDY
@click.option("--over", multiple=True, required=True, metavar="NAME=LOW:HIGH:COUNT", help="Once or twice.")
@click.option("--carry", type=click.Choice(["none", "forward", "backward", "both"]), default="none", show_default=True,
              help="Start each value from the motion at the one before it.")  # fmt: skip
@click.option("--start", "starts", multiple=True, metavar="STATE",
              help="A state to start from, such as 'q3.displacement=1 mm'; several give several branches.")  # fmt: skip
@click.option("--latin", type=click.IntRange(min=2), metavar="N", help="N points of a Latin hypercube, not a grid.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the Latin hypercube.")
@PHASE
@SETTLE
@click.option("--cycles", type=click.IntRange(min=96), default=100, show_default=True, help="Periods kept.")
@SET
@RECORD
@BEST
@BODIES
@JOBS
@POOL
@OUT
@output_option("[default: sweep.nc in out/]")
@FRESH
@click.option("--quiet", "-q", is_flag=True, help="No progress, no summary with its remarks; errors only.")
@reporting_mistakes
def sweep(study: Path, over: tuple[str, ...], **options: Any) -> None:
    """Find the motion of STUDY's simulator over one or two parameters, and draw its bifurcation diagram.

    Each value's transient is dropped, its stroboscopic section kept, and its kind of motion identified by the largest
    Lyapunov exponent. Up to six values are drawn as sections in the phase plane, two parameters as a map of the kinds
    of motion. A sweep that was stopped or killed goes on with the same command.

    --over takes NAME=LOW:HIGH:COUNT (":log" behind it for equal ratios) or a list NAME=A,B,C, with units if wanted
    ("0.5 mm:1.5 mm:101"). NAME is a parameter of the model, excitation.frequency or excitation.amplitude. Two of them
    make a plane; with --latin it is NAME=LOW:HIGH.

    \b
    Example:  calib sweep studies/minimal --over restitution=0:0.6:241 --carry both
    """
    from calib.cli.sweep import sweep_study  # see above

    sys.exit(EXIT_DONE if sweep_study(study, over, **options) else EXIT_NOTHING)


@click.command(short_help="Follow a periodic motion over a parameter, stable or not.")
@STUDY
@click.option("--over", required=True, metavar="NAME=LOW:HIGH", help="The parameter and its window.")
@click.option("--at", required=True, metavar="VALUE", help="Where the motion is sought that is followed.")
@click.option("--start", metavar="STATE", help="A state to start from, such as 'q3.displacement=1 mm'.")
@PHASE
@click.option("--most", type=click.IntRange(min=1), default=400, show_default=True, help="Points each way.")
@click.option("--curve", metavar="NAME=LOW:HIGH", help="A second parameter, over which special points are continued.")
@SET
@RECORD
@BEST
@BODIES
@OUT
@output_option("[default: branch.nc in out/]")
@reporting_mistakes
def branch(study: Path, over: str, **options: Any) -> None:
    """Follow the periodic motion of STUDY's simulator over one parameter, through folds and where it is unstable.

    Marked are folds, flips (period doublings), Neimark-Sacker points, crossings with another branch, and grazing, where
    an impact appears or vanishes and the branch ends. Multipliers are Floquet's, from the exact derivative of the map
    where the simulator knows it.

    With --curve each fold, flip and grazing is continued as a curve over the plane of both parameters: what bounds the
    window of this motion. Points of codimension two are marked on it.

    \b
    Example:  calib branch studies/minimal --over restitution=0:0.8 --at 0.05
              calib branch studies/minimal --over restitution=0:0.8 --at 0.05 --curve gap=0.5mm:2mm
    """
    from calib.cli.branch import follow_branch  # see above

    sys.exit(EXIT_DONE if follow_branch(study, over, **options) else EXIT_NOTHING)


@click.command(short_help="Amplitude and phase over the frequency of the excitation, at one level or more.")
@STUDY
@click.option("--over", required=True, metavar="frequency=LOW:HIGH", help="The window of frequencies.")
@click.option("--levels", metavar="A,B", help="Amplitudes of the excitation, such as '0.5 mm,1 mm', "
              "or '50%,100%' of the record's. [default: the record's]")  # fmt: skip
@click.option("--method", type=click.Choice(["shooting", "harmonic-balance"]), default="shooting", show_default=True,
              help="Harmonic balance is fast, and out of contact or with a compliant one.")  # fmt: skip
@click.option("--harmonics", type=click.IntRange(min=1), help="The highest that is kept [3], or balanced [7].")
@click.option("--steps", type=click.IntRange(min=2), default=17, show_default=True,
              help="Frequencies of the sweep that the branches begin at.")  # fmt: skip
@click.option("--most", type=click.IntRange(min=1), default=400, show_default=True, help="Points each way of a branch.")
@click.option("--isolas", is_flag=True, help="Seek curves apart from the others by continuation in the level.")
@SET
@RECORD
@BEST
@BODIES
@OUT
@output_option("[default: response.nc in out/]")
@reporting_mistakes
def response(study: Path, over: str, **options: Any) -> None:
    """Draw the frequency response of STUDY's simulator: amplitude and phase of its periodic motions, stable or not.

    At each level of the excitation a stepped sweep up and down finds the motions that are followed over the frequency,
    through folds and where they are unstable; what comes beyond a grazing is followed, too. Marked are folds, flips
    (period doublings), Neimark-Sacker points, grazing, and frequencies at which the motion does not return.

    With --method harmonic-balance the motions are Fourier series, where forces are functions of displacement and
    velocity: many times faster, up to where a rigid stop is touched. What its harmonics leave out is measured by
    shooting, and said.

    Levels that are done are kept until all are: after a run that was stopped or killed, the same command goes on.

    \b
    Example:  calib response studies/minimal --over frequency=20:32 --levels 50%,100%,200%
              calib response studies/minimal --over frequency=20:32 --levels 5% --method harmonic-balance
    """
    from calib.cli.response import respond  # see above

    sys.exit(EXIT_DONE if respond(study, over, **options) else EXIT_NOTHING)


@click.command(short_help="Backbones of a body, and the level that holds its amplitude.")
@STUDY
@click.option("--over", required=True, metavar="frequency=LOW:HIGH", help="The window of frequencies.")
@click.option("--body", required=True, help="Whose first harmonic is in phase resonance, or held.")
@click.option("--levels", metavar="LOW,HIGH", help="Amplitudes of the excitation between which backbones are followed; "
              "one: from a hundredth of it. [default: the record's]")  # fmt: skip
@click.option("--hold", metavar="A,B", help="Amplitudes that are held over the frequency, such as '1 mm,2 mm'.")
@click.option("--harmonics", type=click.IntRange(min=1), default=7, show_default=True, help="The highest balanced.")
@click.option("--most", type=click.IntRange(min=1), default=400, show_default=True, help="Points of a curve.")
@SET
@RECORD
@BEST
@OUT
@output_option("[default: backbone.nc in out/]")
@reporting_mistakes
def backbone(study: Path, over: str, body: str, **options: Any) -> None:
    """Draw how the resonance of a body of STUDY's simulator moves with its amplitude, by harmonic balance.

    A backbone is followed directly, through motions whose first harmonic lags the excitation by a quarter of a period.
    With --hold also the level that holds an amplitude, over the frequency: a test under amplitude control.

    \b
    Example:  calib backbone studies/minimal --over frequency=40:60 --body q2 --levels 0.0001%,0.01%
    """
    from calib.cli.backbone import draw_backbones  # see above

    draw_backbones(study, over, body, **options)


@click.command(short_help="Which states lead to which motion: basins of attraction.")
@STUDY
@click.option("--x", required=True, metavar="NAME=LOW:HIGH:COUNT", help="A component of the state.")
@click.option("--y", required=True, metavar="NAME=LOW:HIGH:COUNT", help="Another one.")
@click.option("--start", metavar="STATE", help="The other components, such as 'q3.displacement=1 mm'.")
@PHASE
@SETTLE
@SET
@RECORD
@BEST
@JOBS
@POOL
@OUT
@output_option("[default: basins.nc in out/]")
@FRESH
@click.option("--quiet", "-q", is_flag=True, help="No progress, no summary with its remarks; errors only.")
@reporting_mistakes
def basins(study: Path, x: str, y: str, **options: Any) -> None:
    """Find the motion that each state of a plane leads STUDY's simulator to, and draw the plane coloured by it.

    Components of the state are the displacements and velocities of the bodies that are free to move, at the section's
    phase. Goes on where it was stopped or killed.

    \b
    Example:  calib basins studies/minimal --x q3.displacement=-2mm:6mm:80 --y q3.velocity=-1:1:80
    """
    from calib.cli.basins import map_basins  # see above

    sys.exit(EXIT_DONE if map_basins(study, x, y, **options) else EXIT_NOTHING)
