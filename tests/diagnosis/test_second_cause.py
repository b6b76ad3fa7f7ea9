"""Pairs that only records held out reveal: stand-ins for selections."""

from types import SimpleNamespace

import pytest

from calib.diagnosis.joint_misfit import JointMisfit
from calib.diagnosis.second_cause import with_second_cause

STD = 100.0  # of the chi-square of noise
FITTER = SimpleNamespace()


class Suspect:
    """A suspect whose name is the model that was fitted with it."""

    def __init__(self, name, reduction=1000.0, penalty=2.0):
        self.name, self.chi2_reduction, self.aic_penalty = name, reduction, penalty
        self.fit = SimpleNamespace(names=("k",), chi2=0.0)
        self.candidate = SimpleNamespace(effect=SimpleNamespace(noise=False))


class Chosen(SimpleNamespace):
    """A selection of causes with these names."""

    def __init__(self, causes, alternatives=None, differing=(), suspects=(), **rest):
        search = SimpleNamespace(chosen=None, suspects=suspects, threshold=3.3)  # the cause is left of a pair
        super().__init__(
            causes=causes, alternatives=alternatives or tuple((c,) for c in causes), rounds=(search,),
            is_sufficient=True, differing_by_record=differing, remainder_is_significant=False, null=None, **rest,
        )  # fmt: skip


def gain(joint):
    return SimpleNamespace(joint=None if joint is None else JointMisfit(joint, STD, {}), refutes=False)


@pytest.mark.parametrize(
    ("joint", "classes"),
    [
        ({"ac": -10.0}, [["a"], ["c"]]),
        ({"ac": -10.0, "ad": -9.0}, [["a"], ["c", "d"]]),
        ({"ac": -10.0, "bc": -12.0, "ad": 0.0}, [["a", "b"], ["c"]]),  # of a tie the simpler; d is 10 behind
        ({"bc": -12.0}, [["b"], ["c"]]),  # of the cause and its rival, only the latter has one size
        ({"ac": 400.0}, None),  # a pair that leaves more than noise
        ({"ac": -10.0, "c": -9.0}, None),  # c alone does as much
        ({"ac": None}, None),
        ({}, None),
    ],
)
def test_a_pair_is_chosen_by_the_misfit_of_all_records_and_named_with_its_rivals(monkeypatch, joint, classes):
    """The cause is a, its rival b, which takes two parameters more; others are c and d."""
    a, b, c, d = Suspect("a"), Suspect("b", penalty=6.0), Suspect("c", 990.0), Suspect("d", 600.0)
    weak = Suspect("weak", 400.0)
    left = {"a": 5000.0, "c": 5000.0, **joint}

    def selected(fitter, selection, fit, suspects):
        return Chosen(tuple(suspects))

    def tested(selection):
        name = "".join(cause.name for cause in selection.causes)
        assert "weak" not in name  # it explains too little
        return selection, gain(left.get(name, 5000.0))

    monkeypatch.setattr("calib.diagnosis.second_cause._fitted_between", lambda *given: SimpleNamespace(names=("k",)))
    monkeypatch.setattr("calib.diagnosis.second_cause._selected", selected)
    monkeypatch.setattr(
        "calib.diagnosis.second_cause._refitted_towards_all",
        lambda fitter, selection, fit, pair, tested: tested(Chosen(pair)),
    )
    monkeypatch.setattr("calib.diagnosis.second_cause.leading_variants", list)
    monkeypatch.setattr("calib.diagnosis.second_cause.Refitted", Suspect)
    monkeypatch.setattr("calib.diagnosis.second_cause.replace", lambda own, **new: Chosen(own.causes, **new))
    found = with_second_cause(FITTER, Chosen((a,), ((a, b),), suspects=(a, b, c, d, weak)), gain(5000.0), tested)
    if classes is None:
        assert found is None
    else:
        selection, _ = found
        assert [[rival.name for rival in own] for own in selection.alternatives] == classes


def test_no_pair_is_tried_where_the_cause_leaves_noise_alone_in_all_records_or_more_than_that_in_its_own():
    a = Suspect("a")
    for joint, remains in ((0.0, False), (None, False), (5000.0, True)):
        selection = Chosen((a,))
        selection.remainder_is_significant = remains
        assert with_second_cause(FITTER, selection, gain(joint), None) is None
