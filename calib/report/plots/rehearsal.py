"""Figure of a rehearsal: the diagnosis of each hidden effect, and the share named over its strength."""

import math
from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calib.diagnosis.rehearse import NOTHING, Rehearsed, confusion, rates
from calib.report.plots.style import LINE, STYLE

CELL_SIZE = 0.22  # inch
WORDS = {"class": "one of several"}  # of an answer that needs them


def rehearsal(played: Sequence[Rehearsed]) -> Figure:
    """Confusion matrix of hidden and diagnosed effects; beside it the share of correct diagnoses over the strength.

    played : cases of a rehearsal, one or more
    """
    hidden, answers, shares = confusion(played)
    shown = [k for k in range(len(answers)) if shares[:, k].any() or answers[k] in hidden]
    answers, shares = [answers[k] for k in shown], shares[:, shown]
    table = rates(played)
    known = {row.hidden.strength for row in table if row.hidden.effect != NOTHING}
    strengths = sorted(strength for strength in known if not math.isnan(strength))
    with mpl.rc_context(STYLE):
        width, height = 2.4 + CELL_SIZE * len(answers), 1.9 + CELL_SIZE * len(hidden)
        figure = Figure(figsize=(width + 1.2 + 0.5 * max(1, len(strengths)), height), layout="constrained")
        ratios = len(answers), 1.5 + 2.0 * max(1, len(strengths))
        left, right = figure.subplots(1, 2, width_ratios=ratios, sharey=True)
        _cells(left, shares)
        left.set_xticks(range(len(answers)), [WORDS.get(answer, answer) for answer in answers], rotation=90)
        left.set_yticks(range(len(hidden)), hidden)
        left.set(xlabel="diagnosed effect [%]", ylabel=f"hidden effect\n({len(played)} cases)")
        named = np.full((len(hidden), len(strengths)), np.nan)
        for row in table:
            if row.hidden.strength in strengths and row.hidden.effect in hidden:
                named[hidden.index(row.hidden.effect), strengths.index(row.hidden.strength)] = row.named
        _cells(right, named)
        right.set_xticks(range(len(strengths)), [f"{z:.3g}" for z in strengths])
        right.set(xlabel="predicted z\nof the size [1]", title="Named [%]")
    return figure


def _cells(axes: Axes, shares: np.ndarray) -> None:
    """Draw shares (row, column) in [0, 1] as cells with their values in per cent; NaN stays empty."""
    axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    axes.grid(False)
    for (row, column), share in np.ndenumerate(shares):
        if share > 0.0:
            colour = "white" if share > 0.6 else LINE
            axes.text(column, row, f"{100.0 * share:.0f}", ha="center", va="center", fontsize=6, color=colour)
