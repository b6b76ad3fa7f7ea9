"""Causes that the records refute, and what takes their place: stand-ins for selections."""

from dataclasses import dataclass
from types import SimpleNamespace

import pytest
from in_turn import InTurn

from calib.diagnosis.constancy import RECORDS, Constancy
from calib.diagnosis.refutation import revised_by_records

KNOWN, VAGUE, ELSEWHERE = (0.1, ("one", "two")), (0.5, ("one", "two")), (0.1, ("one", "three"))
FITTER = InTurn(effort=SimpleNamespace(suffices=lambda: True, spent=False))


@pytest.mark.parametrize(
    ("one_size", "refuted", "left"),
    [
        ({"a": KNOWN}, "", ("a", "b", "c")),  # it speaks for itself: its rivals are not tried
        ({"b": KNOWN, "c": KNOWN}, "", ("b", "c")),
        ({"c": KNOWN}, "", ("c",)),
        ({"b": VAGUE, "c": KNOWN}, "", ("c",)),  # sizes so vague would not show what told a apart
        ({"b": ELSEWHERE}, "", ("a", "b", "c")),  # nor would those of another record
        ({"rejected": KNOWN}, "", ()),
        ({"weak": KNOWN}, "", ()),  # it explains too little beside what remains
        ({"a": KNOWN, "fails": KNOWN}, "a", ()),  # with it what refuted a cannot be simulated
        ({}, "", ("a", "b", "c")),
        ({"b": KNOWN, "c": KNOWN}, "c", ("b",)),  # with c the misfit of a record held out rises
        ({"a": KNOWN, "b": VAGUE, "c": KNOWN}, "a", ("b", "c")),  # all have one size: prediction alone decides
        ({"a": KNOWN, "b": KNOWN}, "abc", ("a", "b", "c")),
        ({"a": KNOWN}, "a", ("a", "b", "c")),  # what predicts has several sizes
    ],
)
def test_of_causes_that_explain_alike_those_are_preferred_that_have_one_size_and_predict(
    monkeypatch, one_size, refuted, left
):
    """Stand-ins for selections, of which each has a cause with rivals."""

    class Alike:
        is_explained, remainder_is_significant, runners_up = True, False, ()

        def __init__(self, name, names):
            self.name, self.names, self.is_homogeneous = name, names, name in one_size
            self.is_sufficient = self.is_homogeneous and name != "weak"
            self.heterogeneous = () if self.is_homogeneous else (Constancy(name, 9.0, 0.3, 1.0, RECORDS),)
            self.differing_by_record = self.heterogeneous
            own = [SimpleNamespace(name=n, aic_penalty=2.0, chi2_reduction=1.0) for n in names]
            self.alternatives = (tuple(self.cause(one) for one in own),)
            self.causes = self.alternatives[0][:1]

        def cause(self, one):
            return SimpleNamespace(**vars(one), candidate=SimpleNamespace(free=(one.name,)))

        def with_rivals(self, rivals):
            return Alike(self.name, tuple(rival.name for rival in rivals))

    def with_gain(fitter, bench, own, seed):
        detectable, records = one_size.get(own.name, KNOWN)
        agreement = SimpleNamespace(parameter=own.name, agree=True, detectable=detectable, records=records)
        refutes, tries = own.name in refuted, own.name != "fails"
        found = {"agreements": (agreement,), "refutes": refutes, "covers": lambda _: tries, "joint": None}
        return own, SimpleNamespace(name=own.name, **found)

    def exchanged(fitter, selection, cause, rival, reason):
        assert ("held out" in reason) == (cause.name in refuted and cause.name in one_size)
        return None if rival.name == "rejected" else Alike(rival.name, (rival.name,))

    monkeypatch.setattr("calib.diagnosis.refutation.exchanged", exchanged)
    monkeypatch.setattr("calib.diagnosis.refutation._with_gain", with_gain)
    monkeypatch.setattr("calib.diagnosis.refutation.paired", lambda *given: None)
    special = {"rejected", "weak", "fails"} & set(one_size)
    names = ("a", *special) if special else ("a", "b", "c")
    found, gain = revised_by_records(FITTER, None, Alike("a", names), (), 0)
    assert found.names == (names if special else left)
    assert found.name == gain.name == found.names[0]


@pytest.mark.parametrize(
    ("differing", "refuted", "insufficient", "kept", "reason"),
    [
        ({}, (), (), "abc", ""),
        ({"b": RECORDS}, (), (), "ac", "its size differs by 30 % among the records"),
        ({}, ("abc",), (), "ab", "with it the misfit of the records held out rises"),  # c is the weakest
        ({}, ("abc", "ab"), (), "a", "with it the misfit of the records held out rises"),
        ({"b": RECORDS, "a": RECORDS}, (), (), "abc", ""),  # c alone is no better: neither is left out
        ({"b": RECORDS}, (), ("ac",), "abc", ""),  # the others explain too little
        ({}, ("abc", "ab", "a"), (), "abc", ""),
    ],
)
def test_a_cause_that_the_records_refute_is_left_out_where_the_others_hold(
    monkeypatch, differing, refuted, insufficient, kept, reason
):
    """Stand-ins for selections of causes a, b and c, c the weakest, without rivals."""
    left = {}

    class Chosen:
        is_explained, remainder_is_significant, runners_up = True, False, ()

        def __init__(self, names):
            self.name, self.causes = names, tuple(SimpleNamespace(name=name) for name in names)
            self.alternatives = tuple((cause,) for cause in self.causes)
            self.heterogeneous = tuple(Constancy(n, 9.0, 0.3, 1.0, differing[n]) for n in names if n in differing)
            self.differing_by_record = self.heterogeneous
            self.constancy = tuple(Constancy(n, 0.0, 0.0, 100.0 - ord(n)) for n in names)
            self.is_sufficient = not self.heterogeneous and (len(names) > 1 or not differing)

    def left_out(fitter, selection, cause, why):
        left[cause.name] = why
        names = selection.name.replace(cause.name, "")
        return None if names in insufficient else Chosen(names)

    def with_gain(fitter, bench, own, seed):
        return own, SimpleNamespace(refutes=own.name in refuted, joint=None)

    monkeypatch.setattr("calib.diagnosis.refutation.left_out", left_out)
    monkeypatch.setattr("calib.diagnosis.refutation.parted", lambda *given: None)  # of three there is no room for four
    monkeypatch.setattr("calib.diagnosis.refutation._with_gain", with_gain)
    monkeypatch.setattr("calib.diagnosis.refutation.paired", lambda *given: None)
    found, _ = revised_by_records(FITTER, None, Chosen("abc"), (), 0)
    assert found.name == kept
    assert [left[name] for name in "abc" if name not in kept] == [reason] * (3 - len(kept))


@pytest.mark.parametrize(
    ("parts", "kept"),
    [
        ({"b": "acd"}, "acd"),
        ({"a": "bcd"}, "a"),  # only b has several sizes, and is left out
        ({"b": "afd"}, "a"),  # f has several sizes too
    ],
)
def test_a_cause_of_several_sizes_that_stands_for_two_is_replaced_by_them(monkeypatch, parts, kept):
    """Stand-ins for selections of causes a and b, and of the two in the place of one."""

    class Chosen:
        is_explained, remainder_is_significant, runners_up = True, False, ()

        def __init__(self, names):
            self.name, self.causes = names, tuple(SimpleNamespace(name=name) for name in names)
            self.alternatives = tuple((cause,) for cause in self.causes)
            self.heterogeneous = tuple(Constancy(n, 9.0, 0.3, 1.0, RECORDS) for n in names if n in "bf")
            self.differing_by_record = self.heterogeneous
            self.constancy = tuple(Constancy(n, 0.0, 0.0, 100.0 - ord(n)) for n in names)
            self.is_sufficient = not self.heterogeneous

    def parted(fitter, selection, cause, candidates, seed):
        return Chosen(parts[cause.name]) if cause.name in parts else None

    monkeypatch.setattr("calib.diagnosis.refutation.parted", parted)
    monkeypatch.setattr("calib.diagnosis.refutation.left_out", lambda *given: Chosen("a"))
    monkeypatch.setattr(
        "calib.diagnosis.refutation._with_gain",
        lambda fitter, bench, own, seed: (own, SimpleNamespace(refutes=False, joint=None)),
    )
    monkeypatch.setattr("calib.diagnosis.refutation.paired", lambda *given: None)
    found, _ = revised_by_records(FITTER, None, Chosen("ab"), (), 0)
    assert found.name == kept


@pytest.mark.parametrize(
    ("significant", "refuted", "vague", "behind", "kept"),
    [
        (True, "b", "", (), "ac"),  # what was held out refutes b
        (True, "", "c", (), "ab"),  # c surely lowers the misfit there by less
        (False, "b", "c", (), "abc"),  # nothing but noise is left: they differ by too little
        (True, "a", "", ("d", "e"), "bc"),
        (True, "abc", "", ("d", "e"), "d"),  # e explains too little
        (True, "abcd", "", ("d", "e"), "abc"),
    ],
)
def test_where_more_is_left_each_rival_stands_in_the_place_of_the_cause(
    monkeypatch, significant, refuted, vague, behind, kept
):
    """Stand-ins for a selection of the cause a, whose rivals are b and c, and others that explained less."""

    class Chosen:
        is_explained, remainder_is_significant = True, significant
        heterogeneous, differing_by_record, is_homogeneous = (), (), True

        def __init__(self, names):
            self.names, self.is_sufficient = names, names != "e"
            rivals = [SimpleNamespace(name=n, aic_penalty=2.0, chi2_reduction=100.0 - ord(n)) for n in names]
            self.alternatives, self.causes = (tuple(rivals),), tuple(rivals[:1])
            self.runners_up = tuple(SimpleNamespace(name=n, aic_penalty=2.0, chi2_reduction=0.0) for n in behind)

        def with_rivals(self, rivals):
            return Chosen("".join(rival.name for rival in rivals))

    def with_gain(fitter, bench, own, seed):
        interval = (0.1, 0.2) if own.names in vague else (0.3, 0.4)
        refutes = own.names[0] in refuted
        tried = {"refutes": refutes, "covers": lambda _: True, "interval": interval, "agreements": (), "joint": None}
        return own, SimpleNamespace(**tried)

    monkeypatch.setattr("calib.diagnosis.refutation.exchanged", lambda f, s, cause, rival, reason: Chosen(rival.name))
    monkeypatch.setattr("calib.diagnosis.refutation.paired", lambda *given: None)
    monkeypatch.setattr("calib.diagnosis.refutation._with_gain", with_gain)
    found, _ = revised_by_records(FITTER, None, Chosen("abc"), (), 0)
    assert found.names == kept


@pytest.mark.parametrize("refuted", ["", "a"])
def test_a_rival_whose_test_the_budget_breaks_off_is_not_refuted(monkeypatch, refuted):
    """Stand-ins for a selection of the cause a, whose rivals are b and c; the budget ends in the test of the last."""
    effort = SimpleNamespace(suffices=lambda: True, spent=False)

    @dataclass
    class Chosen:
        names: str
        cut_short: bool = False
        is_explained = is_sufficient = remainder_is_significant = is_homogeneous = True
        heterogeneous = differing_by_record = runners_up = ()

        def __post_init__(self):
            rivals = tuple(SimpleNamespace(name=n, aic_penalty=2.0, chi2_reduction=9.0) for n in self.names)
            self.alternatives, self.causes = (rivals,), rivals[:1]

        def with_rivals(self, rivals):
            return Chosen("".join(rival.name for rival in rivals))

    def with_gain(fitter, bench, own, seed):
        effort.spent = effort.spent or own.names == "c"
        tried = {"covers": lambda _: own.names != "c", "interval": (0.1, 0.2), "agreements": (), "joint": None}
        return own, SimpleNamespace(refutes=own.names[0] in refuted, omitted=own.names == "c", **tried)

    monkeypatch.setattr("calib.diagnosis.refutation.exchanged", lambda f, s, cause, rival, reason: Chosen(rival.name))
    monkeypatch.setattr("calib.diagnosis.refutation._with_gain", with_gain)
    fitter = InTurn(effort=effort, attempt=lambda step: None if effort.spent else step())
    found, _ = revised_by_records(fitter, None, Chosen("abc"), (), 0)
    assert (found.names, found.cut_short) == ("abc", True)


@pytest.mark.parametrize(
    ("pair", "stands", "alone", "taken"),
    [
        (None, (), (), False),
        ("ab", (), (), False),
        ("ab", ("ab",), (), True),
        ("ab", ("ab", "c"), ("c",), False),  # the only cause has one size in all records: no pair is tried
        ("ab", ("ab", "c"), ("ab",), True),  # its size differs, by little
        ("ab", ("ab", "c"), (), False),  # so do those of the pair
    ],
)
def test_the_best_pair_is_tried_where_an_only_cause_does_not_stand(monkeypatch, pair, stands, alone, taken):
    """Stand-ins for selections: of an only cause, and of a pair.

    stands : which explain enough; alone : which have one size in all records, where the only cause stands
    """

    def selection(names, sufficient):
        causes = tuple(SimpleNamespace(name=name) for name in names)
        differ = "c" in stands and names not in alone
        return SimpleNamespace(
            name=names, causes=causes, alternatives=tuple((cause,) for cause in causes), heterogeneous=(),
            differing_by_record=tuple(Constancy(n, 9.0, 0.2, 1.0, RECORDS) for n in names if differ),
            is_explained=True, is_sufficient=sufficient, remainder_is_significant=False, runners_up=(),
        )  # fmt: skip

    both = None if pair is None else selection(pair, pair in stands)
    monkeypatch.setattr("calib.diagnosis.refutation.paired", lambda *given: both)
    monkeypatch.setattr(
        "calib.diagnosis.refutation._with_gain", lambda *given: (given[2], SimpleNamespace(refutes=False, joint=None))
    )
    found, _ = revised_by_records(FITTER, None, selection("c", "c" in stands), (), 0)
    assert found.name == ("ab" if taken else "c")
