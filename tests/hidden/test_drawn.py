"""Cases in drawn laboratories: each is told from the others, a killed table goes on, and rates are counted right."""

import json
from functools import partial

import numpy as np
import pytest
from hidden import drawn
from hidden.hider import SYSTEMS
from hidden.table import all_played

WANTED = drawn.cases("oscillator", ["none", "one", "absent"], range(4), 40.0, 0.0, {})
CLOCK = {"clock": {"free": False, "drift": 0.0}, "noise": {"level": 0.01, "colour": "white", "stated": True}}
ANSWER = {
    "effect": [], "laboratory": CLOCK, "drift_z": 0.0, "remainder": "", "nearest": None, "said": "", "seconds": 1.0,
    "causes": [], "class": [], "sizes": {}, "verdict": "none",
}  # fmt: skip


def test_cases_are_told_from_one_another():
    assert len({drawn.key(case) for case in WANTED}) == 12
    assert len({drawn.key(json.loads(json.dumps(case))) for case in WANTED} | {drawn.key(c) for c in WANTED}) == 12


def test_a_case_tries_every_effect_once_in_an_order_of_its_own():
    orders = [list(drawn._tries(case, np.random.default_rng(case["seed"]))) for case in WANTED if case["kind"] == "one"]
    known = sorted((name,) for name in SYSTEMS["oscillator"]().effects if name != "outliers")
    assert all(sorted(order) == known for order in orders)
    assert len({order[0] for order in orders}) > 1


@pytest.mark.slow
def test_a_killed_table_goes_on_where_it_ended(tmp_path):
    out = tmp_path / "rows.jsonl"
    first = [{**case, **ANSWER, "said": "before"} for case in WANTED[:10]]
    out.write_text("".join(json.dumps(row) + "\n" for row in first) + '{"simulator": "osc')
    rows = all_played(WANTED, drawn.key, partial(dict, **ANSWER), drawn.line, out, 1)
    assert len(rows) == 12
    assert sum(row["said"] == "before" for row in rows) == 10
    assert len(out.read_text().splitlines()) == 12


def test_shares_have_the_bounds_of_clopper_and_pearson():
    assert drawn.share(0, 10) == "0/10 = 0% (0% to 31%)"  # 1 - 0.025^(1/10)
    assert drawn.share(0, 0) == "0/0"


def test_rates_count_alarms_classes_names_and_sizes():
    rows = [{**case, **ANSWER} for case in drawn.cases("oscillator", ["none", "one"], range(2), 40.0, 0.0, {})]
    none, one = rows[::2], rows[1::2]
    none[0] |= {"verdict": "unexplained"}
    size = {"k3": [1.0, 1.25, 0.1]}  # 2.5 standard errors off
    name = "cubic_stiffness"
    one[0] |= {"effect": [name], "verdict": "named", "causes": [name], "class": [[name]], "sizes": size}
    one[1] |= {"effect": ["preload"], "verdict": "one_of", "class": [["preload"], ["channel_offset"]]}
    text = drawn.rates(rows)
    assert "none, all: false alarms 1/2" in text
    assert "one, all: truth in the class 2/2" in text
    assert "named singly 1/2" in text
    assert "sizes within 3 standard errors 1/1" in text
    assert "covered by their 95 % interval 0/1" in text


@pytest.mark.slow
@pytest.mark.parametrize("kind", sorted({*drawn.KINDS} - {"one", "two"}))  # hidden/test_found plays these
def test_a_case_of_each_kind_can_be_played(kind):
    case = drawn.cases("oscillator", [kind], range(1, 2), 40.0, 0.0, {})[0]
    row = drawn.played(case)
    assert drawn.key(json.loads(json.dumps(row))) == drawn.key(case)
    assert row["verdict"] != "refused"
    assert drawn.line(row).startswith(f"oscillator {kind} 1 (in step")
    assert bool(row["remainder"]) == kind.startswith("remainder")
