"""Which causes stay beside what remains: linear models in noise-free records, whose sums of squares are known."""

from types import SimpleNamespace

import numpy as np
import pytest

from calib.diagnosis import elimination
from calib.diagnosis.constancy import Constancy
from calib.diagnosis.elimination import eliminated

SAMPLES = 10_000
STD = float(np.sqrt(2.0 * SAMPLES))


class Linear:
    """Stands in for a fitter: causes of orthogonal signatures, each of which explains a chi-square of its own.

    unreliable : chi-square of all models where their simulations are not reliable
    """

    def __init__(self, own, remaining, spent=False, unreliable=0.0):
        self.own, self.remaining, self.unreliable = own, remaining, unreliable
        self.attempt = lambda step: None if spent else step()
        self.reliable = SimpleNamespace(parts=(), counted=lambda: float(SAMPLES))
        self.evidence = SimpleNamespace(with_weights=lambda simulated: self.reliable)

    def fit(self, names):
        """Model with these causes, which leaves what the others explain."""
        left = self.remaining + sum(chi2 for name, chi2 in self.own.items() if name not in names)
        nothing = np.zeros((0, 0))

        def residual_over(evidence):
            assert evidence is self.reliable
            return np.sqrt([SAMPLES + left])

        return SimpleNamespace(
            chi2=SAMPLES + left + self.unreliable, chi2_over=lambda evidence: float(residual_over(evidence)[0] ** 2),
            residual_over=residual_over, residual=nothing, point=SimpleNamespace(simulated={}), columns=nothing,
            nuisances=nothing, names=["stiffness", *names],
        )  # fmt: skip

    def with_derivatives(self, fit):
        return fit

    def in_turn(self, tasks):
        return (task(self) for task in tasks)


def left(own, remaining, monkeypatch, spent=False, sizes=lambda evidence, fit: (), before=0.0, unreliable=0.0):
    """Elimination of causes that explain so much, of these constancies; others explained more that went before."""
    fitter = Linear(own, remaining, spent, unreliable)
    monkeypatch.setattr(elimination, "without_cause", lambda fitter, null, final, cause, others: fitter.fit([*others]))
    causes = tuple((SimpleNamespace(name=n, candidate=n, chi2_reduction=chi2), ()) for n, chi2 in own.items())
    monkeypatch.setattr(elimination, "constancies", sizes)
    begun = fitter.fit(list(own))
    return eliminated(fitter, fitter.fit([]), causes, begun, 3.0, begun.chi2 - before)


def names(found):
    return tuple(cause.name for cause, _ in found.causes)


@pytest.mark.parametrize(
    ("own", "remaining", "kept"),
    [
        ({"drag": 9000.0, "friction": 140.0}, 0.0, ("drag",)),  # the sum of squares hardly notices that
        ({"drag": 9000.0, "friction": 143.0}, 0.0, ("drag", "friction")),
        ({"drag": 9000.0, "friction": 143.0}, 2.9 * STD, ("drag", "friction")),
        ({"drag": 200.0, "friction": 120.0}, -100.0, ()),  # beside what friction explains drag is no more
        ({"drag": 9000.0, "friction": 2800.0}, 1000.0, ("drag", "friction")),
        ({"drag": 90_000.0, "friction": 1900.0}, 1000.0, ("drag",)),  # what is left may as well look like friction
        ({"friction": 1900.0, "drag": 90_000.0}, 1000.0, ("drag",)),
        ({"drag": 5000.0, "friction": 1900.0}, 1000.0, ()),  # of what is left without friction drag is 1.7 times
        ({"drag": 10.0}, 2.9 * STD, ("drag",)),
        ({"drag": 2000.0}, 1000.0, ("drag",)),
        ({"drag": 1900.0}, 1000.0, ()),
        ({"lag": 3000.0, "drag": 90_000.0, "friction": 5000.0}, 1600.0, ("drag",)),
        ({"lag": 3000.0, "drag": 90_000.0, "friction": 20_000.0}, 1600.0, ("drag", "friction")),
    ],
)
def test_each_cause_explains_twice_what_all_may_leave_or_goes_the_weakest_first(own, remaining, kept, monkeypatch):
    found = left(own, remaining, monkeypatch)
    assert found.is_explained == bool(kept)
    if not kept:  # all stay as what explains most
        assert (names(found), found.left_out) == (tuple(own), ())
        return
    assert names(found) == kept
    assert found.final.names == ["stiffness", *kept]
    others = list(own)
    for one in found.left_out:
        others.remove(one.effect)
        assert one.beside == tuple(others)
        may_remain = remaining if remaining > 3.0 * STD else 0.5 * STD
        assert one.share == pytest.approx(own[one.effect] / (own[one.effect] + may_remain))
        remaining += own[one.effect]
    assert tuple(others) == kept


def test_what_a_model_leaves_where_simulations_are_not_reliable_is_no_remainder(monkeypatch):
    """As beside the impacts, whose instants a model error shifts."""
    assert left({"drag": 9000.0}, 1000.0, monkeypatch, unreliable=50_000.0).is_explained
    assert not left({"drag": 1900.0}, 1000.0, monkeypatch, unreliable=-900.0).is_explained


def test_what_was_left_out_before_remains(monkeypatch):
    """A sum of squares does not see it, but the cause that explained it did."""
    assert left({"drag": 250.0}, -100.0, monkeypatch, before=120.0).is_explained
    assert not left({"drag": 230.0}, -100.0, monkeypatch, before=120.0).is_explained


@pytest.mark.parametrize(
    ("own", "sizes", "kept"),
    [
        ({"drag": 9000.0, "play": 1000.0}, {"play": 0.5}, ("drag",)),
        ({"drag": 9000.0, "play": 1000.0}, {"play": 0.1}, ("drag",)),  # of several that leave nothing but noise
        ({"drag": 9000.0, "play": 1000.0}, {"drag": 0.5}, ("play", "drag")),  # play alone explains too little
        ({"drag": 9000.0}, {"drag": 0.5}, ("drag",)),  # nothing would be left
        ({"drag": 90_000.0, "play": 9000.0, "lag": 2000.0}, {"play": 0.5, "lag": 0.4}, ("drag",)),
    ],
)
def test_causes_of_several_sizes_are_left_out_where_the_others_explain_enough(own, sizes, kept, monkeypatch):
    unlike = [Constancy(name, 9.0, variation, own[name]) for name, variation in sizes.items()]

    def constancies(evidence, fit):
        return tuple(one for one in unlike if one.effect in fit.names)

    found = left(own, 0.0, monkeypatch, sizes=constancies)
    assert found.is_explained
    assert set(names(found)) == set(kept)
    out = [one for one in sorted(unlike, key=lambda c: c.chi2) if one.effect not in kept]
    assert [(one.effect, one.reason) for one in found.left_out] == [
        (one.effect, f"its size differs by {100 * one.variation:.0f} % among {one.among}") for one in out
    ]


@pytest.mark.parametrize(
    ("own", "remaining", "margin"),
    [
        ({"drag": 2500.0}, 1000.0, 500.0),
        ({"drag": 1700.0}, 1000.0, 300.0),
        ({"drag": 90_000.0, "friction": 1900.0}, 1000.0, 100.0),  # that friction goes is less sure than that drag stays
        ({"drag": 10.0}, 2.9 * STD, 10.0),
    ],
)
def test_the_margin_is_that_of_the_nearest_comparison(own, remaining, margin, monkeypatch):
    assert left(own, remaining, monkeypatch).margin == pytest.approx(margin)


def test_without_a_budget_causes_are_judged_by_what_they_explained_when_they_were_found(monkeypatch):
    monkeypatch.setattr(Linear, "with_derivatives", None)  # no fit begins
    assert left({"drag": 90_000.0, "friction": 40_000.0}, 1000.0, monkeypatch, spent=True).is_explained
    assert not left({"drag": 90_000.0, "friction": 1900.0}, 1000.0, monkeypatch, spent=True).is_explained
    assert left({"drag": 9.0, "friction": 4.0}, 0.0, monkeypatch, spent=True).is_explained
