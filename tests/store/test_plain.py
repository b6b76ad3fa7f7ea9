"""What JSON takes, and dataclasses of what it gives back."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest

from calib.store.plain import plain, typed


@dataclass(frozen=True)
class Leaf:
    size: float | None = None
    ends: tuple[float, float] = (0.0, 1.0)


@dataclass(frozen=True)
class Branch:
    name: str
    leaves: tuple[Leaf, ...] = ()
    named: Mapping[str, Leaf] = field(default_factory=dict)
    best: Leaf | None = None


def test_a_dataclass_comes_back_as_it_was_written():
    branch = Branch("oak", (Leaf(1.0), Leaf(2.0, (0.5, 0.6))), {"top": Leaf(3.0)}, Leaf())
    assert typed(Branch, json.loads(json.dumps(plain(branch), allow_nan=False))) == branch


@dataclass(frozen=True)
class Tree:
    kind: str = field(metadata={"key": "class"})
    height: float | None


def test_a_field_stands_under_its_key_and_null_is_a_value_where_none_is_one():
    assert plain(Tree("oak", math.nan)) == {"class": "oak", "height": None}
    assert typed(Tree, {"class": "oak", "height": None}) == Tree("oak", None)
    for document in ({"class": "oak"}, {"kind": "oak", "height": 1.0}, {"class": None, "height": 1.0}):
        with pytest.raises(ValueError, match="Tree has no"):
            typed(Tree, document)


def test_what_is_not_finite_is_none_and_what_is_missing_or_unknown_takes_no_effect():
    assert plain(Leaf(math.nan)) == {"size": None, "ends": [0.0, 1.0]}
    assert plain({"a": np.array([1.0, np.inf])}) == {"a": [1.0, None]}
    assert typed(Branch, {"name": "oak", "best": None, "bark": 1}) == Branch("oak")
