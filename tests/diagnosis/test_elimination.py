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
    """Names of the causes that stay; None where none would."""
    fitter = Linear(own, remaining, spent)
    monkeypatch.setattr(
        elimination, "without_cause", lambda fitter, null, final, cause, others: fitter.fit([o for o in others])
    )
    causes = tuple((SimpleNamespace(name=name, candidate=name), ()) for name in own)
    found = eliminated(fitter, fitter.fit([]), causes, fitter.fit(list(own)))
    if found is None:
        return None
    names = tuple(cause.name for cause, _ in found.causes)
    assert found.final.names == ["stiffness", *names]
    for one in found.left_out:
        assert one.share == pytest.approx(own[one.effect] / (own[one.effect] + remaining))
        remaining += own[one.effect]
    assert {*names, *(one.effect for one in found.left_out)} == set(own)
    return names


@pytest.mark.parametrize(
    ("own", "remaining", "kept"),
    [
        ({"drag": 10.0, "friction": 1.0}, 2.9 * STD, ("drag", "friction")),  # nothing but noise is left
        ({"drag": 9000.0, "friction": 2000.0}, 1000.0, ("drag", "friction")),
        ({"drag": 90_000.0, "friction": 1900.0}, 1000.0, ("drag",)),  # what is left may as well look like friction
        ({"friction": 1900.0, "drag": 90_000.0}, 1000.0, ("drag",)),
        ({"drag": 5000.0, "friction": 1900.0}, 1000.0, None),  # of what is left without friction drag is 1.7 times
        ({"drag": 2000.0}, 1000.0, ("drag",)),
        ({"drag": 1900.0}, 1000.0, None),
        ({"lag": 3000.0, "drag": 90_000.0, "friction": 5000.0}, 1600.0, ("drag",)),
        ({"lag": 3000.0, "drag": 90_000.0, "friction": 20_000.0}, 1600.0, ("drag", "friction")),
        ({}, 1000.0, None),
    ],
)
def test_each_cause_explains_twice_what_all_leave_or_goes_the_weakest_first(own, remaining, kept, monkeypatch):
    assert left(own, remaining, monkeypatch) == kept


def test_without_a_budget_it_is_not_known_whether_several_causes_stay(monkeypatch):
    assert left({"drag": 90_000.0, "friction": 40_000.0}, 1000.0, monkeypatch, spent=True) is None
    assert left({"drag": 90_000.0}, 1000.0, monkeypatch, spent=True) == ("drag",)
    assert left({"drag": 9.0, "friction": 4.0}, 0.0, monkeypatch, spent=True) == ("drag", "friction")
