"""Shares of a rehearsal's cases, and the size from which an effect is reliably named."""

import io

import pytest
from rich.console import Console

from calib.cli.rehearse import show
from calib.diagnosis.rehearse import NOTHING, RehearsalCase, Rehearsed, rates, smallest
from calib.diagnosis.verdict import NAMED, NONE, ONE_OF

UNITS = {"c2": "1/m"}


def cases(effect, strength, *verdicts):
    """Rehearse an effect, each time with another seed: named, among two alternatives, or not detected."""
    values = {"c2": strength / 10.0} if strength else {}
    classes = {NAMED: ((effect,),), ONE_OF: ((effect,), ("linear_drag",)), NONE: ()}
    return [
        Rehearsed(
            RehearsalCase(effect, strength, values, seed, UNITS if values else {}),
            verdict,
            (effect,) if verdict == NAMED else (),
            classes[verdict],
        )
        for seed, verdict in enumerate(verdicts)
    ]


PLAYED = [
    *cases(NOTHING, 0.0, NONE, NONE),
    *cases("quadratic_drag", 5.0, NONE, ONE_OF, NAMED, NAMED),
    *cases("quadratic_drag", 10.0, NAMED, NAMED, NAMED, ONE_OF),
    *cases("quadratic_drag", 20.0, NAMED, NAMED),
    *cases("support", 5.0, NAMED, NAMED),
    *cases("support", 10.0, NONE, NONE),
]


def test_shares_are_of_the_cases_of_one_size():
    shares = {(row.hidden.effect, row.hidden.strength): row for row in rates(PLAYED)}
    row = shares["quadratic_drag", 5.0]
    assert (row.cases, row.detected, row.named, row.covered) == (4, 0.75, 0.5, 0.75)
    assert (row.hidden.values, row.hidden.units) == ({"c2": 0.5}, UNITS)
    assert (shares[NOTHING, 0.0].cases, shares[NOTHING, 0.0].detected) == (2, 0.0)


def test_an_effect_is_reliably_named_from_a_size_above_which_it_always_is():
    least = smallest(PLAYED)
    assert least.keys() == {"quadratic_drag", "support"}
    assert least["quadratic_drag"].hidden.strength == 10.0
    assert least["support"] is None


def test_the_table_shows_shares_and_the_smallest_size():
    printed = io.StringIO()
    show(PLAYED, Console(file=printed, width=120, color_system=None))
    rows = [line.split() for line in printed.getvalue().splitlines()]
    [drag] = [row for row in rows if "quadratic_drag" in row]
    shown = " ".join(drag)
    assert all(text in shown for text in ("90%", "70%", "c2 = 1 1/m (z = 10)")), shown
    assert sum(one.detected for one in PLAYED[2:12]) / 10 == pytest.approx(0.9)
