"""What is known of a suspect without a score test, with one, and after a refit."""

from types import SimpleNamespace

import numpy as np
import pytest

from calib.diagnosis.score import ScoreTest, Signature
from calib.diagnosis.serialise import _unfitted
from calib.diagnosis.suspect import Scored, Untestable, leading_variants

CANDIDATE = SimpleNamespace(name="drag", free=("k",), form=("width",), null=np.array([2.0]))
SIGNATURE = Signature.of(np.ones((4, 1)), lambda columns: columns, np.zeros(1))
TEST = ScoreTest(z=5.0, size=np.array([0.3]), error=np.array([0.1]), chi2_reduction=25.0)
FIT = SimpleNamespace(
    names=("k",),
    value={"k": 2.4}.get,
    error=lambda names: np.array([0.05]),
    half_width=lambda names: np.array([0.12]),
    chi2=4.0,
    residual=np.ones(4),
)


def unknown(name):
    raise KeyError(name)


FAILED = SimpleNamespace(names=(), value=unknown, reason="its simulation fails at the start")


def test_of_an_untestable_suspect_nothing_is_known():
    suspect = Untestable(CANDIDATE, "it has no derivative")
    assert (suspect.z, suspect.known_reduction, suspect.is_testable) == (0.0, 0.0, False)
    assert suspect.size.tolist() == [2.0]
    assert np.isinf([*suspect.error, *suspect.half_width, *suspect.detectable]).all()
    assert suspect.signature_columns.size == 0


def test_a_scored_suspect_has_the_size_that_its_test_estimates():
    suspect = Scored(CANDIDATE, TEST, np.ones((4, 1)), SIGNATURE, np.array([0.35]))
    assert (suspect.z, suspect.known_reduction, suspect.is_testable) == (5.0, 25.0, True)
    assert suspect.size == pytest.approx([2.3])
    assert suspect.half_width == pytest.approx([0.196], rel=1e-3)
    assert not Scored(CANDIDATE, TEST, np.ones((4, 1)), SIGNATURE, np.array([0.35]), "it is rough").is_testable


@pytest.mark.parametrize(
    ("screened", "z"),
    [
        (Scored(CANDIDATE, TEST, np.ones((4, 1)), SIGNATURE, np.array([0.35])), 5.0),
        (Scored(CANDIDATE, TEST, np.ones((4, 1)), SIGNATURE, np.array([0.35]), "it is rough"), 6.0),
        (Untestable(CANDIDATE, "it has no derivative"), 6.0),
    ],
)
def test_a_refitted_suspect_has_the_size_of_its_fit_and_the_deviate_that_can_be_relied_on(screened, z):
    suspect = screened.refitted(FIT, 36.0)
    assert suspect.z == pytest.approx(z)
    assert (suspect.known_reduction, suspect.predicted_reduction) == (36.0, screened.predicted_reduction)
    assert (*suspect.size, *suspect.error, *suspect.half_width) == (2.4, 0.05, 0.12)
    assert (suspect.parameter_count, suspect.aic_penalty) == (2, 4.0)


def test_what_a_refit_leaves_widens_the_deviate_of_one_without_a_score_test():
    left = SimpleNamespace(**{**vars(FIT), "chi2": 36.0, "residual": np.full(4, 3.0)})  # nine times the noise
    assert Untestable(CANDIDATE, "it has no derivative").refitted(left, 36.0).z == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("screened", "size"),
    [
        (Scored(CANDIDATE, TEST, np.ones((4, 1)), SIGNATURE, np.array([0.35])), 2.3),
        (Untestable(CANDIDATE, "it has no derivative"), 2.0),
    ],
)
def test_of_a_refit_that_could_not_begin_no_size_is_asked(screened, size):
    failed = screened.refitted(FAILED, 0.0)
    assert failed.size == pytest.approx([size])
    assert failed.error.tolist() == screened.error.tolist()
    assert _unfitted(failed) == "its simulation fails at the start"
    assert not _unfitted(screened)
    assert not _unfitted(screened.refitted(FIT, 36.0))


def test_a_second_fit_replaces_the_first():
    scored = Scored(CANDIDATE, TEST, np.ones((4, 1)), SIGNATURE, np.array([0.35]))
    suspect = scored.refitted(FIT, 36.0).refitted(FIT, 40.0)
    assert suspect.chi2_reduction == 40.0
    assert suspect.screened is scored


def test_the_first_variant_of_each_effect_leads():
    other = SimpleNamespace(name="gap", free=("g",), form=(), null=np.zeros(1))
    ordered = [Untestable(CANDIDATE, "first"), Untestable(other, ""), Untestable(CANDIDATE, "second")]
    assert [(s.name, s.reason) for s in leading_variants(ordered)] == [("drag", "first"), ("gap", "")]
