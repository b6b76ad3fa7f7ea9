"""How far simulated records are from measured ones."""

import pickle
from pathlib import Path

import numpy as np
import pytest
from phase_loops import FREQUENCY, SIGMA, chaotic, clapping, noisy

from calib.errors import CalibError
from calib.features import (
    Amplitude,
    ContactTime,
    ForceBalance,
    Harmonics,
    ImpactPhase,
    PhaseCurve,
    PoincareSpread,
    TimeHistory,
)
from calib.objective import Objective, Reference, Term
from calib.records import failed, make, read, with_channels
from calib.records.cycles import phase_curve
from calib.records.excitation import Excitation

PERIOD = 1.0 / FREQUENCY
MEASURED = Path(__file__).parents[2] / "experiments_ref"


def objective(record, *terms, nuisance=("trigger",), **how):
    terms = terms or (Term(PhaseCurve()),)
    return Objective({"run": Reference("run", record, nuisance=nuisance, **how)}, terms)


def simulated(**how):
    return clapping(section=64, **how)


def cost(record, run, *terms, **how):
    return objective(record, *terms, **how)({"run": run}).cost


# --- the distance


def test_an_identical_loop_scores_zero():
    score = objective(simulated())({"run": simulated()})
    assert score.cost == pytest.approx(0.0, abs=1e-10)
    assert score.status == "ok"
    assert score.kind == "period-1"
    assert score.wrong == ()


@pytest.mark.parametrize("jump", [0.0, 0.4])
def test_ten_per_cent_larger_scores_a_tenth(jump):
    assert cost(simulated(jump=jump), simulated(jump=jump, size=1.1)) == pytest.approx(0.1, rel=0.02)


@pytest.mark.parametrize("trigger", [0.0, 0.0123, 0.0387])
def test_a_shifted_start_costs_no_more_than_the_noise(trigger):
    truth = clapping(jump=0.0)
    noise = [SIGMA[c] / np.sqrt(6) / phase_curve(truth)[c].std("phase").values for c in ("displacement", "velocity")]
    level = float(np.sqrt(np.mean(np.square(noise))))
    found = cost(noisy(clapping(jump=0.0, trigger=trigger)), simulated(jump=0.0))
    assert found == pytest.approx(level, rel=0.1)
    assert found < 0.01


def test_the_trigger_is_found_with_its_sign():
    score = objective(noisy(clapping(trigger=0.0123)))({"run": simulated()})
    assert score.nuisances["run"]["trigger"] == pytest.approx(0.0123, abs=0.02 * PERIOD / 400 * 5)


def test_without_the_nuisance_nothing_is_shifted():
    assert cost(clapping(trigger=0.25 * PERIOD), simulated(), nuisance=()) > 1.0


def test_one_trigger_is_common_to_all_bodies():
    record, late = clapping(jump=0.0), clapping(jump=0.0, trigger=0.05 * PERIOD)
    for channel in ("displacement", "velocity"):
        record[channel][1] = late[channel][1]  # the layer alone is early
    run = simulated(jump=0.0)
    each = [cost(record, run, Term(PhaseCurve(), bodies=[body])) for body in ("beam", "layer")]
    assert max(each) < 1e-3
    assert cost(record, run) > 0.1


@pytest.mark.parametrize(
    "how", [{"start": 0.0173}, {"samples": 173}, {"samples": 500, "start": -0.3}, {"periods": 2}, {"periods": 9}]
)
def test_records_that_start_late_or_are_sampled_otherwise_are_aligned_too(how):
    assert cost(clapping(jump=0.0, trigger=0.007, **how), simulated(jump=0.0)) < 2e-3


def test_samples_that_do_not_divide_the_period_are_aligned_too():
    whole = clapping(jump=0.0, samples=1733)
    record = whole.isel(time=slice(0, None, 10))
    assert cost(record, simulated(jump=0.0)) < 2e-3


def test_the_cost_is_the_root_of_the_summed_squares_of_the_residuals():
    terms = [Term(PhaseCurve()), Term(Amplitude(), weight=2.0), Term(Harmonics(), bodies=["layer"], weight=0.5)]
    score = objective(noisy(clapping()), *terms)({"run": simulated(size=1.2, impact=0.28)})
    assert score.cost == pytest.approx(np.sqrt((score.residuals**2).sum()))
    distances = np.array(list(score.terms.values()))
    assert score.cost == pytest.approx(np.sqrt(np.average(distances**2, weights=[1.0, 2.0, 0.5])))


def test_weights_count_only_against_each_other():
    run, record = simulated(size=1.2), noisy(clapping())
    one = objective(record, Term(PhaseCurve()), Term(Amplitude()))({"run": run})
    ten = objective(record, Term(PhaseCurve(), weight=10.0), Term(Amplitude(), weight=10.0))({"run": run})
    assert one.cost == pytest.approx(ten.cost)


def test_a_very_large_distance_stays_below_a_wrong_kind():
    far = cost(simulated(), simulated(size=1e3))
    assert 8.0 < far < 9.0
    assert cost(simulated(), simulated(size=1e4)) > far


def test_a_stated_uncertainty_that_varies_weighs_the_samples():
    record = noisy(clapping(jump=0.0), factor=1e-3)
    sigma = np.full((2, 2400), 1e-5)
    sigma[:, :1200] = 1e-3  # the first three cycles are coarse: the mean loop's uncertainty is even
    even = record.assign(displacement_sigma=(("body", "time"), sigma, {"units": "m"}))
    assert cost(even, simulated(jump=0.0, size=1.1)) == pytest.approx(0.1, rel=1e-3)
    phase = np.arange(2400) % 400 / 400
    sigma = np.where((phase > 0.2) & (phase < 0.4), 1e-2, 1e-5) * np.ones((2, 1))
    blind = record.assign(displacement_sigma=(("body", "time"), sigma, {"units": "m"}))
    bent = simulated(jump=0.0)
    bent["displacement"] = bent.displacement + 1e-3 * ((phase > 0.25) & (phase < 0.35))
    term = Term(PhaseCurve(channels=["displacement"]))
    assert cost(blind, bent, term, nuisance=()) < 0.01 * cost(record, bent, term, nuisance=())


# --- nuisances


def test_offset_scale_and_shear_are_recovered():
    truth = simulated()
    plotted = clapping(trigger=40 * PERIOD / 400)
    run = phase_curve(plotted)  # as an instrument gives it
    velocity = np.tile(run.velocity.values, 6)
    displacement = 1.2 * np.tile(run.displacement.values, 6) + 2e-4 * velocity + np.array([[1e-4], [-3e-4]])
    record = make(plotted.time, ["beam", "layer"], {"displacement": displacement, "velocity": 0.9 * velocity})
    record.attrs.update(plotted.attrs)
    score = objective(record, nuisance=("trigger", "offset", "scale", "shear"))({"run": truth})
    found = score.nuisances["run"]
    assert score.cost < 1e-6
    assert found["trigger"] == pytest.approx(40 * PERIOD / 400, abs=1e-8)
    assert found["offset.beam"] == pytest.approx(1e-4, abs=1e-9)
    assert found["offset.layer"] == pytest.approx(-3e-4, abs=1e-9)
    assert (found["scale.displacement"], found["scale.velocity"]) == (pytest.approx(1.2), pytest.approx(0.9))
    assert found["shear"] == pytest.approx(2e-4, rel=1e-5)


def test_an_offset_is_solved_without_a_period_too():
    time = np.linspace(0.0, 3.0, 700)
    x = np.exp(-time) * np.cos(20 * time)
    stated = {"place": "mass", "quantity": "free decay"}
    record = make(time, ["mass"], {"displacement": x[None] + 0.3}, **stated)
    run = make(
        np.linspace(0.0, 3.0, 3001), ["mass"], {"displacement": np.interp(np.linspace(0, 3, 3001), time, x)[None]}
    )
    score = objective(record, Term(TimeHistory()), nuisance=("offset",))({"run": run})
    assert score.kind == "not periodic"
    assert score.nuisances["run"]["offset.mass"] == pytest.approx(0.3, abs=1e-3)
    assert score.cost < 5e-3


def test_what_a_body_at_rest_cannot_tell_does_not_stop_the_rest():
    run = simulated()
    run["displacement"][:] = 0.0
    run["velocity"][:] = 0.0
    score = objective(noisy(clapping()), nuisance=("trigger", "offset", "scale", "shear"))({"run": run})
    assert np.isfinite(score.cost)


def test_the_prescribed_channel_fixes_the_trigger_and_is_not_scored():
    record = noisy(clapping(trigger=0.0123, prescribed="beam.displacement,beam.velocity"))
    run = simulated(impact=0.5, jump=0.8)  # a layer that would pull the trigger away
    score = objective(record)({"run": run})
    assert score.nuisances["run"]["trigger"] == pytest.approx(0.0123, abs=2e-6)
    assert set(objective(record).residuals({"run": run}).body.values) == {"layer"}
    with pytest.raises(CalibError, match="prescribes all"):
        objective(record, Term(PhaseCurve(), bodies=["beam"]))


def test_a_channel_that_only_the_simulator_prescribes_leaves_zeros():
    record = noisy(clapping(trigger=0.0123))
    run = simulated(impact=0.5, prescribed="beam.displacement,beam.velocity")
    both = objective(record)
    residuals = both.residuals({"run": run})
    assert (residuals[residuals.body == "beam"] == 0.0).all()
    assert both({"run": run}).cost == pytest.approx(cost(record, run, Term(PhaseCurve(), bodies=["layer"])))
    assert both({"run": simulated()}).residuals.size == residuals.size
    assert both({"run": run}).nuisances["run"]["trigger"] == pytest.approx(0.0123, abs=2e-6)
    with pytest.raises(CalibError, match="simulator prescribes"):
        cost(record, run, Term(PhaseCurve(), bodies=["beam"]))


# --- residuals


def test_residuals_have_one_length_whatever_is_simulated():
    compared = objective(noisy(clapping()), Term(PhaseCurve()), Term(ImpactPhase()), Term(PoincareSpread()))
    runs = [
        simulated(),
        simulated(jump=0.0),
        simulated(wander=chaotic(64)),
        clapping(periods=3),
        clapping(samples=1000),
        simulated(subharmonic=0.1),
    ]
    assert len({compared({"run": run}).residuals.size for run in runs}) == 1


def test_residuals_say_where_they_belong():
    residuals = objective(noisy(clapping()), Term(PhaseCurve()), Term(Amplitude())).residuals({"run": simulated()})
    assert residuals.sizes["residual"] == 1600 + 4
    assert set(residuals.term.values) == {"phase_curve", "amplitude"}
    assert set(residuals.channel.values) == {"displacement", "velocity"}
    assert set(residuals.record.values) == {"run"}


@pytest.mark.parametrize("nuisance", [("trigger",), ("trigger", "offset", "scale", "shear")])
def test_residuals_are_smooth_in_a_parameter(nuisance):
    compared = objective(noisy(clapping(trigger=0.0123)), nuisance=nuisance)

    def residuals(impact):
        return compared({"run": simulated(impact=impact)}).residuals

    at = 0.3012345  # not at a sample
    slope, *others = [(residuals(at + h) - residuals(at - h)) / (2 * h) for h in (1e-7, 1e-6, 1e-5)]
    differences = np.linalg.norm(np.array(others) - slope, axis=1)
    assert differences.max() < 1e-3 * np.linalg.norm(slope)


def test_nothing_jumps_where_the_trigger_passes_a_sample():
    compared = objective(noisy(clapping(jump=0.0)))
    at = np.linspace(-1.5, 1.5, 301) * PERIOD / 400
    runs = [compared({"run": simulated(jump=0.0, trigger=t)}) for t in at]
    triggers = np.array([(run.nuisances["run"]["trigger"] + PERIOD / 2) % PERIOD - PERIOD / 2 for run in runs])
    assert np.diff(triggers) == pytest.approx(-np.diff(at), rel=0.01)
    steps = np.linalg.norm(np.diff([run.residuals for run in runs], axis=0), axis=1)
    assert steps.max() < 1e-4


def test_scoring_is_deterministic_and_survives_pickling():
    compared = objective(noisy(clapping(trigger=0.0123)), nuisance=("trigger", "offset"))
    run = simulated(impact=0.28)
    first, again = compared({"run": run}), pickle.loads(pickle.dumps(compared))({"run": run})
    assert np.array_equal(first.residuals, again.residuals)
    assert first.nuisances == again.nuisances


# --- failures and kinds of motion


def test_a_failed_run_scores_infinity_and_says_why():
    score = objective(clapping())({"run": failed(["beam", "layer"], "diverged", "at 0.3 s")})
    assert (score.cost, score.status, score.reason, score.residuals) == (np.inf, "diverged", "at 0.3 s", None)
    run = simulated()
    run["velocity"][1, 7] = np.nan
    assert objective(clapping())({"run": run}).status == "not finite"
    assert objective(clapping()).judged({"run": run})[1] == []
    with pytest.raises(CalibError, match="cannot be aligned"):
        objective(clapping()).aligned("run", run)


def test_a_failed_record_fails_all():
    references = {name: Reference(name, clapping()) for name in ("one", "two")}
    records = {"one": simulated(), "two": failed(["beam", "layer"], "timeout", "")}
    assert Objective(references, [Term(PhaseCurve())])(records).status == "timeout"
    with pytest.raises(CalibError, match="no simulated record for 'two'"):
        Objective(references, [Term(PhaseCurve())])({"one": simulated()})


@pytest.mark.parametrize(
    ("motion", "kind"),
    [
        ({"subharmonic": 0.003}, "period-2"),
        ({"wander": chaotic(64)}, "irregular"),
        ({"wander": [1.0, 1.01, 1.03]}, "period-3"),
    ],
)
def test_the_right_kind_beats_any_wrong_kind(motion, kind):
    compared = objective(noisy(clapping()))
    worst = compared({"run": simulated(size=1e6)}).cost
    score = compared({"run": simulated(**motion)})
    assert score.cost > worst
    assert (score.wrong, score.kind) == (("run",), kind)
    assert "the reference is period-1" in score.evidence
    assert score.residuals is not None


def test_the_penalty_falls_towards_the_right_kind():
    compared = objective(noisy(clapping()))
    costs = [compared({"run": simulated(subharmonic=share)}).cost for share in (0.5, 0.2, 0.1, 0.05, 0.01, 0.005)]
    assert (np.diff(costs) < 0.0).all()


def test_a_period_2_reference_wants_a_period_2_motion():
    compared = objective(noisy(clapping(subharmonic=0.2, trigger=1.3 * PERIOD)), Term(PhaseCurve(periods=2)))
    right, wrong = compared({"run": simulated(subharmonic=0.2)}), compared({"run": simulated()})
    assert right.cost < 0.03
    assert right.nuisances["run"]["trigger"] == pytest.approx(1.3 * PERIOD, abs=1e-5)
    assert wrong.cost > 10.0


def repeating(loops, periods):
    """Motion of one body that returns after so many periods of the excitation, with its section."""
    time = np.arange(64 * periods) * PERIOD / 64
    subharmonic = 0.2 * np.cos(2.0 * np.pi * FREQUENCY * time / loops + 0.4)
    rate = -0.2 / loops * np.sin(2.0 * np.pi * FREQUENCY * time / loops + 0.4)
    angle = 2.0 * np.pi * FREQUENCY * time
    channels = {
        "displacement": np.cos(angle) + subharmonic,
        "velocity": 2.0 * np.pi * FREQUENCY * (rate - np.sin(angle)),
    }
    at = np.arange(64) / loops * 2.0 * np.pi + 0.4
    section = {"displacement": 1.0 + 0.2 * np.cos(at), "velocity": -0.4 * np.pi * FREQUENCY / loops * np.sin(at)}
    return make(
        time, ["mass"], {name: row[None] for name, row in channels.items()},
        section={name: row[None] for name, row in section.items()},
        frequency=FREQUENCY, amplitude=1.0, place="mass", quantity="force",
    )  # fmt: skip


@pytest.mark.parametrize("nuisance", [(), ("trigger",)])
@pytest.mark.parametrize(("loops", "asked"), [(1, 6), (3, 6), (4, 8), (5, 10), (7, 7)])
def test_a_motion_of_any_period_is_compared_over_whole_loops(loops, asked, nuisance):
    compared = objective(repeating(loops, 3 * 16), Term(TimeHistory()), nuisance=nuisance)
    assert compared.references["run"].request.periods == asked
    for periods in (asked, asked + 1):  # a simulator that records more than it is asked for
        score = compared({"run": repeating(loops, periods)})
        assert score.kind == f"period-{loops}"
        assert score.cost < 1e-3


def test_the_trigger_is_solved_from_what_is_compared():
    """A velocity that nothing compares, ten times as noisy as the displacement, would move it."""
    rng, compared = np.random.default_rng(3), Term(PhaseCurve(channels=("displacement",)))
    record = clapping(jump=0.0, trigger=0.0123)
    velocity = record["velocity"]
    record = record.assign(velocity=velocity + 0.3 * float(velocity.std()) * rng.standard_normal(velocity.shape))
    found = objective(record, compared)({"run": simulated(jump=0.0)}).nuisances["run"]["trigger"]
    both = objective(record)({"run": simulated(jump=0.0)}).nuisances["run"]["trigger"]
    assert found == pytest.approx(0.0123, abs=1e-7)
    assert abs(both - 0.0123) > 1e-6


@pytest.mark.parametrize("jump", [0.0, 0.4])
def test_the_shear_of_a_compared_displacement_is_told_from_the_trigger(jump):
    """It needs the velocity, which nothing compares: without it the trigger would take its place."""
    record = clapping(jump=jump, trigger=0.0123)
    record = with_channels(record, {"displacement": (record["displacement"] + 2e-3 * record["velocity"]).values})
    compared = objective(record, Term(PhaseCurve(channels=("displacement",))), nuisance=("trigger", "shear"))
    found = compared({"run": simulated(jump=jump)}).nuisances["run"]
    assert found["trigger"] == pytest.approx(0.0123, abs=1e-5)
    assert found["shear"] == pytest.approx(2e-3, rel=0.02)


@pytest.mark.parametrize("contacts", [True, False])
def test_a_scale_is_that_of_what_is_compared_with_and_without_impacts(contacts):
    """Of displacements only that of the beam is compared, which is 10 % too large; that of the layer is 30 %."""
    record = clapping()
    factors = np.array([[1.1], [1.3]])
    record = with_channels(record, {"displacement": factors * record["displacement"].values})
    terms = Term(TimeHistory(channels=("displacement",)), bodies=("beam",)), Term(PhaseCurve(channels=("velocity",)))
    compared = objective(record, *terms, nuisance=("trigger", "scale"))
    found = compared({"run": simulated(contacts=contacts)}).nuisances["run"]
    assert found["scale.displacement"] == pytest.approx(1.1, rel=1e-6 if not contacts else 2e-3)


def test_a_decay_with_an_instant_before_and_behind_an_impact_is_compared():
    regular = np.arange(200) * 1e-3

    def decay(time, **stated):
        record = make(np.arange(time.size) * 1e-3, ["mass"], {"displacement": np.cos(50.0 * time)[None]}, **stated)
        return record.assign_coords(time=("time", time, record["time"].attrs))

    compared = objective(decay(regular, place="mass", quantity="free decay"), Term(TimeHistory()), nuisance=())
    assert compared({"run": decay(np.sort(np.append(regular, 0.1)))}).cost < 1e-6


def test_a_decay_at_the_simulators_own_times_keeps_its_amplitude():
    """At 12 samples a period a straight line half a sample away would be 3 % too small."""
    rate, step = 40.0, 2.0 * np.pi / 40.0 / 12.0  # rad/s, s

    def decay(time, **stated):
        return make(time, ["mass"], {"displacement": (np.exp(-2.0 * time) * np.cos(rate * time))[None]}, **stated)

    record = decay(step * np.arange(96), place="mass", quantity="free decay")
    compared = objective(record, Term(TimeHistory()), nuisance=())
    assert compared({"run": decay(step * (np.arange(98) - 0.5))}).cost < 0.008


def test_a_motion_without_contact_is_of_no_other_period():
    assert objective(noisy(clapping()))({"run": simulated(jump=0.0)}).wrong == ()


def test_a_motion_that_settles_to_the_right_kind_is_not_wrong():
    settling = simulated(wander=1.0 + 0.5 * 0.97 ** np.arange(64))
    score = objective(noisy(clapping()))({"run": settling})
    assert (score.kind, score.wrong) == ("undecided", ())


def test_kinds_of_several_records_are_told_apart():
    references = {name: Reference(name, noisy(clapping())) for name in ("one", "two")}
    records = {"one": simulated(), "two": simulated(subharmonic=0.1)}
    score = Objective(references, [Term(PhaseCurve())])(records)
    assert score.kind == "one: period-1; two: period-2"
    assert score.wrong == ("two",)


# --- features of other kinds


def test_the_difference_of_impact_phases_goes_around_the_circle():
    early, late = simulated(impact=0.99), simulated(impact=0.01)
    expected = 2 * np.pi * 0.02
    assert cost(early, late, Term(ImpactPhase(), bodies=["layer"]), nuisance=()) == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("feature", [ImpactPhase(), ContactTime()], ids=lambda feature: feature.name)
def test_no_impact_where_one_was_measured_scores_one(feature):
    assert cost(clapping(), simulated(jump=0.0), Term(feature)) == pytest.approx(1.0)


def test_a_body_without_impact_is_left_out_or_refused_by_name():
    residuals = objective(clapping(), Term(ImpactPhase())).residuals({"run": simulated()})
    assert list(residuals.body.values) == ["layer"]
    with pytest.raises(CalibError, match="no impact_phase of 'beam'"):
        objective(clapping(), Term(ImpactPhase(), bodies=["beam"]))
    with pytest.raises(CalibError, match="of any body"):
        objective(clapping(jump=0.0), Term(ImpactPhase()))


def test_the_spread_is_taken_from_the_section_as_simulated():
    spread = cost(clapping(), simulated(subharmonic=0.1), Term(PoincareSpread()))
    assert spread > 10.0
    score = objective(clapping(), Term(PoincareSpread()))({"run": simulated(subharmonic=0.1)})
    assert 0.01 < score.terms["poincare_spread"] < 0.2


def test_a_force_is_compared_where_motion_is_prescribed():
    time = np.arange(3000) / 1000.0
    force = 20.0 * np.sin(11.0 * time)
    drive = Excitation("mass", "displacement", time=time, value=np.sin(time))
    record = make(time, ["mass"], {"force": force[None]})
    run = make(time, ["mass"], {"force": 1.1 * force[None], "displacement": np.sin(time)[None]})
    assert cost(record, run, Term(ForceBalance()), nuisance=(), excitation=drive) == pytest.approx(0.1)
    names = {
        feature.label
        for feature in objective(record, Term(ForceBalance()), nuisance=(), excitation=drive).judged({"run": run})[1]
    }
    assert names == {"force amplitude", "force rms"}


class PeakSpeed:
    """A stranger's feature: no channel dimension, a plain number as scale."""

    name, unit, channels = "peak_speed", "m/s", ("velocity",)

    def __call__(self, record, bodies=None):
        return np.abs(record.velocity.sel(body=list(bodies or record.body.values))).max("time")

    def scale(self, reference):
        return 0.5


def test_a_stranger_s_feature_of_one_number_a_body_is_enough():
    term = Term(PeakSpeed(), bodies=["layer"])
    expected = 0.1 * float(np.abs(clapping().velocity[1]).max()) / 0.5
    assert cost(clapping(), simulated(size=1.1), term, nuisance=()) == pytest.approx(expected, rel=1e-3)
    assert list(objective(clapping(), term).residuals({"run": simulated()}).channel.values) == ["peak_speed"]


# --- what is refused


def test_a_record_that_is_not_one_is_refused():
    record = clapping()
    record["displacement"][0, 3] = np.nan
    with pytest.raises(CalibError, match="not a number at sample 3"):
        Reference("run", record)


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"use": "calibrated"}, "did you mean 'calibrate'"),
        ({"nuisance": ["triger"]}, "did you mean 'trigger'"),
    ],
)
def test_a_reference_is_told_its_mistakes(how, message):
    with pytest.raises(CalibError, match=message):
        Reference("run", clapping(), **how)


def test_nuisances_that_cannot_be_solved_are_refused():
    record = clapping()
    decay = Excitation("end", "free decay")
    with pytest.raises(CalibError, match="excitation has a period"):
        Reference("run", record, nuisance=["trigger"], excitation=decay)
    with pytest.raises(CalibError, match="needs velocity"):
        Reference("run", record.drop_vars("velocity"), nuisance=["shear"])
    with pytest.raises(CalibError, match="run: the nuisance 'initial_state'.*harmonic excitation"):
        Reference("run", record, nuisance=["initial_state"])
    Reference("run", record, nuisance=["initial_state"], excitation=decay)


def test_a_term_whose_channel_the_reference_lacks_is_refused_with_what_is_possible():
    with pytest.raises(CalibError, match="phase_curve needs velocity.*amplitude.*phase_curve with channels"):
        objective(clapping().drop_vars("velocity"))
    with pytest.raises(CalibError, match="force_balance needs force"):
        objective(clapping(), Term(ForceBalance()))


def test_unknown_bodies_and_records_are_answered_with_the_nearest():
    with pytest.raises(CalibError, match="did you mean 'layer'"):
        objective(clapping(), Term(PhaseCurve(), bodies=["layr"]))
    with pytest.raises(CalibError, match="did you mean 'run'"):
        objective(clapping(), Term(PhaseCurve(), records=["rum"]))
    with pytest.raises(CalibError, match="no body 'layer'"):
        objective(clapping())({"run": simulated().sel(body=["beam"])})
    with pytest.raises(CalibError, match="no reference 'rnu'.*did you mean 'run'"):
        objective(clapping()).aligned("rnu", simulated())


def test_an_objective_needs_a_term_and_a_reference():
    with pytest.raises(CalibError, match="at least one term"):
        Objective({"run": Reference("run", clapping())}, [])
    with pytest.raises(CalibError, match='use = "calibrate"'):
        Objective({"run": Reference("run", clapping(), use="holdout")}, [Term(PhaseCurve())])
    with pytest.raises(CalibError, match="weight above 0"):
        Term(PhaseCurve(), weight=0.0)


def test_a_body_at_rest_in_the_reference_is_refused():
    record = clapping()
    record["displacement"][0] = 0.0
    with pytest.raises(CalibError, match="'beam' does not move"):
        objective(record)


def test_a_simulation_that_lacks_a_channel_is_refused():
    with pytest.raises(CalibError, match="no velocity"):
        objective(clapping())({"run": simulated().drop_vars("velocity")})
    with pytest.raises(CalibError, match="velocity"):
        objective(clapping(), nuisance=())({"run": simulated().drop_vars("velocity")})


def test_equal_terms_get_labels_of_their_own():
    terms = [Term(TimeHistory(["displacement"])), Term(TimeHistory(["velocity"]))]
    assert [term.label for term in objective(clapping(), *terms).terms] == ["time_history", "time_history (2)"]
    assert Term(Amplitude(), ["layer"], ["run"]).label == "amplitude of layer in run"


# --- on other records


def test_the_same_terms_score_other_records():
    terms = [Term(PhaseCurve()), Term(Amplitude(), records=["one"])]
    one = Objective({"one": Reference("one", clapping())}, terms)
    held = one.on({"louder": Reference("louder", clapping(size=1.2, trigger=0.004), "holdout", ["trigger"])})
    score = held({"louder": simulated(size=1.2)})
    assert score.cost == pytest.approx(0.0, abs=0.01)
    assert set(score.terms) == {"phase_curve", "amplitude in one"}


def test_a_term_of_named_records_is_left_out_where_it_cannot_compare_another():
    references = {"one": Reference("one", clapping()), "bare": Reference("bare", clapping().drop_vars("velocity"))}
    terms = [Term(PhaseCurve(["displacement"])), Term(TimeHistory(["velocity"]), records=["one"])]
    both, other = Objective(references, terms), {"two": Reference("two", clapping().drop_vars("velocity"), "holdout")}
    assert set(both.on(other)({"two": simulated()}).terms) == {"phase_curve"}
    with pytest.raises(CalibError, match="velocity"):
        Objective({"one": references["one"]}, terms[1:]).on(other)
    with pytest.raises(CalibError, match="velocity"):
        Objective({"one": references["one"]}, [terms[0], Term(TimeHistory(["velocity"]))]).on(other)


def test_other_records_are_aligned_but_not_scored():
    references = {
        "one": Reference("one", clapping()),
        "two": Reference("two", clapping(trigger=0.003), "name", ["trigger"]),
    }
    both = Objective(references, [Term(PhaseCurve())])
    assert both({"one": simulated()}).cost == pytest.approx(0.0, abs=1e-9)
    aligned = both.aligned("two", simulated())
    assert np.allclose(aligned.time, references["two"].record.time)
    assert aligned.attrs["nuisance_trigger"] == pytest.approx(0.003, abs=1e-5)


def test_an_aligned_record_lies_on_the_measured_one():
    measured = clapping(jump=0.0, trigger=0.0123, start=0.4, periods=3)
    aligned = objective(measured).aligned("run", simulated(jump=0.0))
    assert np.abs(aligned.displacement - measured.displacement).max() < 1e-6


# --- what the model reaches


def test_scalar_features_stand_side_by_side():
    values = {(f.label, f.body): f for f in objective(noisy(clapping())).judged({"run": simulated(size=1.1)})[1]}
    amplitude = values["displacement amplitude", "beam"]
    assert (amplitude.measured, amplitude.simulated) == (pytest.approx(2e-3, rel=0.01), pytest.approx(2.2e-3, rel=1e-3))
    assert (amplitude.unit, amplitude.tolerance) == ("m", pytest.approx(0.02 * amplitude.measured))
    assert values["velocity change at impact", "layer"].simulated == pytest.approx(0.44, rel=0.05)
    assert ("impact phase", "beam") not in values
    assert all(f.measured is not None and f.tolerance > 0.0 for f in values.values())


def test_a_missing_impact_is_none_and_an_impact_phase_is_the_nearest_equal():
    compared = objective(clapping(impact=0.99), nuisance=())
    missing = {f.label: f for f in compared.judged({"run": simulated(jump=0.0)})[1] if f.body == "layer"}
    assert missing["impact phase"].simulated is None
    found = {f.label: f for f in compared.judged({"run": simulated(impact=0.01)})[1] if f.body == "layer"}
    assert found["impact phase"].simulated == pytest.approx(1.01, abs=2e-3)


def test_prescribed_channels_and_bodies_not_compared_are_no_features():
    prescribed = objective(noisy(clapping(prescribed="beam.displacement,beam.velocity")))
    assert {f.body for f in prescribed.judged({"run": simulated()})[1]} == {"layer"}
    layer = objective(noisy(clapping()), Term(Amplitude(["displacement"]), bodies=["layer"]))
    assert {(f.body, f.unit) for f in layer.judged({"run": simulated()})[1]} == {("layer", "m"), ("layer", "1")}


# --- the reference records


@pytest.mark.parametrize("folder", ["clapping_minimal", "clapping_beam"])
def test_a_reference_record_is_at_its_noise_from_its_own_mean_loop(folder):
    record = read(MEASURED / folder / "clapping.nc")
    loop = phase_curve(record)
    time = np.arange(2400) / 400 / record.attrs["frequency"]
    channels = {c: np.tile(loop[c].values, 6) for c in ("displacement", "velocity")}
    run = make(time, ["beam", "layer"], channels, frequency=record.attrs["frequency"])
    score = objective(record)({"run": run})
    assert score.cost < 1e-3
    score = objective(record, Term(TimeHistory()))({"run": run})
    assert 0.002 < score.cost < 0.05


@pytest.mark.parametrize("trigger", [0.0, 0.2, 0.5, 0.8])
def test_a_sampled_jump_between_two_samples_costs_nothing(trigger):
    late = trigger * PERIOD / 400  # the same motion, sampled a share of a sample later
    score = objective(clapping(trigger=0.3 * PERIOD + late))({"run": simulated()})
    assert score.cost < 5e-4  # half a jump in one of 400 samples would be 6e-3
    assert score.nuisances["run"]["trigger"] == pytest.approx(0.3 * PERIOD + late, abs=0.01 * PERIOD / 400)


def test_a_jump_at_another_phase_is_still_seen():
    apart = [cost(clapping(), simulated(impact=0.3012 + moved)) for moved in (0.0, 0.02, 0.05)]
    assert apart[0] < 1e-3 < 0.02 < apart[1] < apart[2]
