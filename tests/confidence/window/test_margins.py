"""Graded margins of evaluated points: how near a motion is to its first or last contact."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.confidence.window.margins import CONTACT_MARGIN, observed_of, of_measured_kind
from calib.confidence.window.motion import CLOSEST_APPROACH, approach_features
from calib.store import Trial
from calib.study.evaluation import as_trial, evaluate
from calib.study_file import load

STUDY = Path(__file__).parents[3] / "studies" / "minimal" / "study.toml"


@pytest.fixture(scope="module")
def study():
    """The minimal model, its gap a parameter that a test sets."""
    return load(STUDY).study.without_search()


def values(study, gap):
    """Values (SI) with another gap [m], damped so well that the motion from rest does not overshoot."""
    return {**study.space.values(np.full(study.space.dim, 0.3)), "damping": 0.5, "gap": gap}


def approach(study, gap):
    """Closest approach [m] of the motion with a gap [m], and its amplitude [m]."""
    own = values(study, gap)
    name = study.objective.scored[0]
    record = evaluate(study, own).records[name]
    [feature] = approach_features(study, name, record, own)
    assert (feature["label"], feature["unit"]) == (CLOSEST_APPROACH, "m")
    return feature["simulated"], feature["tolerance"]


def test_without_contact_it_is_the_clearance_that_is_left(study):
    (near, amplitude), (far, _) = approach(study, 6e-3), approach(study, 7e-3)
    assert 0.0 < near < 6e-3
    assert far - near == pytest.approx(1e-3, rel=1e-3)  # the motion does not know of a stop that it never touches
    assert amplitude > 1e-4


def test_it_comes_to_zero_from_both_sides_of_the_grazing(study):
    clearance, _ = approach(study, 7e-3)
    grazing = 7e-3 - clearance
    above, below = approach(study, grazing + 1e-5)[0], approach(study, grazing - 1e-5)[0]
    assert above == pytest.approx(1e-5, rel=0.1)  # it had settled within a ten thousandth of its scale
    assert -2e-3 < below < 0.0
    assert approach(study, 0.5 * grazing)[0] < 0.0


def test_a_motion_without_contact_has_a_negative_margin_and_a_known_misfit(study):
    """The calibrated motion has contact: the one without is far from it by so much, and its misfit is known."""
    trials = []
    for number, gap in enumerate([1e-4, 6e-3, 7e-3]):
        own = values(study, gap)
        evaluation = evaluate(study, own)
        [name] = study.objective.scored
        features = [*evaluation.features, *approach_features(study, name, evaluation.records[name], own)]
        trials.append(as_trial(number, [0.5], own, replace(evaluation, features=features), "search", 0))
    [label] = trials[0].terms
    observed = observed_of(trials, {label: 0.05})
    assert CONTACT_MARGIN in observed.labels
    assert [of_measured_kind(trial, trials[0]) for trial in trials] == [True, False, False]
    assert observed.right.all()
    margin = observed.margins[:, observed.labels.index(CONTACT_MARGIN)]
    assert margin[0] > 0.0 > margin[1] > margin[2]
    assert np.isfinite(observed.margins[:, 0]).all()
    assert not observed.admissible[1:].any()


def test_a_motion_whose_approach_is_not_known_is_of_another_kind():
    def trial(kind, approach):
        own = {"label": CLOSEST_APPROACH, "record": "r", "simulated": approach, "tolerance": 1.0}
        features = [] if approach is None else [own]
        return Trial(0, [0.5], {"a": 0.5}, 0.01, terms={"misfit": 0.01}, kind=kind, features=features)

    trials = [trial("period-1", -0.2), trial("no contact", 0.1), trial("no contact", None)]
    observed = observed_of(trials, {"misfit": 0.05})
    assert observed.right.tolist() == [True, True, False]
    assert np.isnan(observed.margins[2]).all()
