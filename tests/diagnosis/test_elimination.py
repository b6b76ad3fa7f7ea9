"""Which causes stay beside what remains: linear models in noise-free records, whose sums of squares are known."""

from types import SimpleNamespace

import numpy as np
import pytest

from calib.diagnosis import elimination
from calib.diagnosis.elimination import eliminated

SAMPLES = 10_000
STD = float(np.sqrt(2.0 * SAMPLES))


class Linear:
    """Stands in for a fitter: causes of orthogonal signatures, each of which explains a chi-square of its own."""

    def __init__(self, own, remaining, spent=False):
        self.own, self.remaining = own, remaining
        self.effort = SimpleNamespace(spent=spent)
        self.evidence = SimpleNamespace(counted=lambda: float(SAMPLES))

    def fit(self, names):
        """Model with these causes, which leaves what the others explain."""
        left = self.remaining + sum(chi2 for name, chi2 in self.own.items() if name not in names)
        nothing = np.zeros((0, 0))
        return SimpleNamespace(chi2=SAMPLES + left, columns=nothing, nuisances=nothing, names=["stiffness", *names])

    def with_derivatives(self, fit):
        return fit


def left(own, remaining, monkeypatch, spent=False):
    """Elimination of causes that explain so much, and began with these."""
    fitter = Linear(own, remaining, spent)
    monkeypatch.setattr(elimination, "without_cause", lambda fitter, null, final, cause, others: fitter.fit([*others]))
    causes = tuple((SimpleNamespace(name=n, candidate=n, chi2_reduction=chi2), ()) for n, chi2 in own.items())
    return eliminated(fitter, fitter.fit([]), causes, fitter.fit(list(own)))


def names(found):
    return tuple(cause.name for cause, _ in found.causes)


@pytest.mark.parametrize(
    ("own", "remaining", "kept"),
    [
        ({"drag": 10.0, "friction": 1.0}, 2.9 * STD, ("drag", "friction")),  # nothing but noise is left
        ({"drag": 9000.0, "friction": 2000.0}, 1000.0, ("drag", "friction")),
        ({"drag": 90_000.0, "friction": 1900.0}, 1000.0, ("drag",)),  # what is left may as well look like friction
        ({"friction": 1900.0, "drag": 90_000.0}, 1000.0, ("drag",)),
        ({"drag": 5000.0, "friction": 1900.0}, 1000.0, ()),  # of what is left without friction drag is 1.7 times
        ({"drag": 2000.0}, 1000.0, ("drag",)),
        ({"drag": 1900.0}, 1000.0, ()),
        ({"lag": 3000.0, "drag": 90_000.0, "friction": 5000.0}, 1600.0, ("drag",)),
        ({"lag": 3000.0, "drag": 90_000.0, "friction": 20_000.0}, 1600.0, ("drag", "friction")),
    ],
)
def test_each_cause_explains_twice_what_all_leave_or_goes_the_weakest_first(own, remaining, kept, monkeypatch):
    found = left(own, remaining, monkeypatch)
    assert found.is_explained == bool(kept)
    if not kept:  # all stay as what comes closest
        assert (names(found), found.left_out) == (tuple(own), ())
        return
    assert names(found) == kept
    assert found.final.names == ["stiffness", *kept]
    others = list(own)
    for one in found.left_out:
        others.remove(one.effect)
        assert one.beside == tuple(others)
        assert one.share == pytest.approx(own[one.effect] / (own[one.effect] + remaining))
        remaining += own[one.effect]
    assert tuple(others) == kept


@pytest.mark.parametrize(
    ("own", "remaining", "margin"),
    [
        ({"drag": 2500.0}, 1000.0, 500.0),
        ({"drag": 1700.0}, 1000.0, 300.0),
        ({"drag": 90_000.0, "friction": 1900.0}, 1000.0, 100.0),  # that friction goes is less sure than that drag stays
        ({"drag": 10.0}, 2.9 * STD, np.inf),
    ],
)
def test_the_margin_is_that_of_the_nearest_comparison(own, remaining, margin, monkeypatch):
    assert left(own, remaining, monkeypatch).margin == pytest.approx(margin)


def test_without_a_budget_causes_are_judged_by_what_they_explained_when_they_were_found(monkeypatch):
    monkeypatch.setattr(Linear, "with_derivatives", None)  # no fit begins
    assert left({"drag": 90_000.0, "friction": 40_000.0}, 1000.0, monkeypatch, spent=True).is_explained
    assert not left({"drag": 90_000.0, "friction": 1900.0}, 1000.0, monkeypatch, spent=True).is_explained
    assert left({"drag": 9.0, "friction": 4.0}, 0.0, monkeypatch, spent=True).is_explained
