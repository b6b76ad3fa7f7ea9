"""Frequency and damping over amplitude as features: what a distance of 0.1 means, and what is compared with what."""

import pickle

import numpy as np
import pytest
from decays import integrated, linear, noisy, record

from calib.errors import CalibError
from calib.features import BackboneCurve, DecayCurve, TimeHistory
from calib.objective import Objective, Reference, Term
from calib.records.decay import smoothed_record

TIME = np.arange(0.0, 40.0, 0.021)  # s
OMEGA = 2.0 * np.pi * 1.5  # rad/s


def softening(k3=-0.1, damping=0.02, start=1.0, time=TIME):
    return integrated(time, lambda x, v: -(OMEGA**2) * (x + k3 * x**3) - damping * OMEGA * v, start)


@pytest.fixture(scope="module")
def reference():
    return Reference("bench", record(TIME, noisy(softening(), 0.01, 1)))


def score(reference, *features):
    return Objective({"bench": reference}, [Term(feature) for feature in features])


@pytest.mark.parametrize("feature", [BackboneCurve(), DecayCurve()], ids=lambda feature: feature.name)
def test_ten_per_cent_too_large_scores_a_tenth(feature):
    linear_one = Reference("bench", record(TIME, noisy(linear(TIME, 1.5, 0.01), 1e-3, 1)))
    larger = linear(1.1 * TIME, 1.5, 0.01) if feature.name == "backbone" else linear(TIME, 1.5, 0.011)
    objective = score(linear_one, feature)
    same = objective({"bench": record(TIME, linear(TIME, 1.5, 0.01))}).cost
    assert same < 0.005
    assert objective({"bench": record(TIME, larger)}).cost == pytest.approx(0.1, rel=0.02)


@pytest.mark.slow
def test_phase_and_size_of_the_release_do_not_count(reference):
    objective = score(reference, BackboneCurve(), DecayCurve())
    for time, start in ((TIME, 1.0), (TIME + 0.1, 1.0), (TIME, 1.2)):
        values = softening(start=start, time=np.concatenate([[0.0], time]) if time[0] else time)[-TIME.size :]
        assert objective({"bench": record(TIME, values)}).cost < 0.02
    assert objective({"bench": record(TIME, softening(k3=0.1))}).terms["backbone"] > 0.02
    assert objective({"bench": record(TIME, softening(damping=0.03))}).terms["decay"] > 0.4


@pytest.mark.slow
def test_residuals_are_smooth_in_the_parameters(reference):
    """Second differences shrink with the square of the step."""
    objective = score(reference, BackboneCurve(), DecayCurve())

    def residuals(k3):
        return objective({"bench": record(TIME, softening(k3=k3))}).residuals

    centre = residuals(-0.1)
    wide, narrow = (np.linalg.norm(residuals(-0.1 + h) - 2.0 * centre + residuals(-0.1 - h)) / h for h in (4e-3, 1e-3))
    slope = np.linalg.norm(residuals(-0.099) - centre) / 1e-3
    assert wide < 0.1 * slope
    assert narrow < 0.4 * wide


def test_a_simulation_that_stops_too_early_or_not_at_all_has_a_finite_distance(reference):
    objective = score(reference, BackboneCurve(), DecayCurve())
    for values in (
        softening(damping=0.0),
        softening(damping=0.5),
        softening(damping=3.0),
        0.0 * TIME,
        1.0 + 0.0 * TIME,
    ):
        cost = objective({"bench": record(TIME, values)}).cost
        assert np.isfinite(cost)
        assert cost > 0.4


def test_both_stand_beside_a_time_history_and_pickle(reference):
    objective = score(reference, TimeHistory(), BackboneCurve(), DecayCurve())
    again = pickle.loads(pickle.dumps(objective))
    simulated = {"bench": record(TIME, softening(k3=-0.11))}
    assert again(simulated).terms == objective(simulated).terms
    residuals = objective.residuals(simulated)
    assert {str(term): int((residuals.term == term).sum()) for term in np.unique(residuals.term)} == {
        "backbone": 24, "decay": 24, "time_history": TIME.size,
    }  # fmt: skip


def test_a_decay_is_compared_by_the_channel_named(reference):
    both = reference.record.assign(
        velocity=(("body", "time"), np.gradient(reference.record.displacement.values[0], TIME)[None])
    )
    both.velocity.attrs["units"] = "m/s"
    assert list(BackboneCurve()(both).channel.values) == ["displacement"]
    named = BackboneCurve(channels="velocity")(both)
    assert list(named.channel.values) == ["velocity"]
    assert named.values[0, 0, 12] == pytest.approx(BackboneCurve()(both).values[0, 0, 12], rel=0.01)


def test_what_cannot_be_compared_is_refused_with_its_reason(reference):
    short = Reference("bench", reference.record.isel(time=slice(0, 90)))
    with pytest.raises(CalibError, match="term 'backbone', record 'bench': displacement of mass: .* need 4 periods"):
        score(short, BackboneCurve())
    with pytest.raises(CalibError, match="body 'mess'"):
        Objective({"bench": reference}, [Term(DecayCurve(), bodies="mess")])
    tone = reference.record.assign_attrs(quantity="force", frequency=1.5, amplitude=1.0)
    with pytest.raises(CalibError, match="those of a free decay, got a record of force"):
        score(Reference("bench", tone), DecayCurve())


def test_a_record_is_analysed_once_for_both(reference):
    first = smoothed_record(reference.record, "mass", "displacement")
    assert smoothed_record(reference.record.copy(deep=True), "mass", "displacement") is first
