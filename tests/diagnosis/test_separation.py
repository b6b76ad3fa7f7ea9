"""Predicted separations and the search for the largest, where the answer is known in closed form."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calib import records
from calib.diagnosis.bench import Bench, Run
from calib.diagnosis.design_search import GRID_ASPECT
from calib.diagnosis.effort import Budget, Effort
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.fit import Fit
from calib.diagnosis.laboratory import DesignPoint, Laboratory, inapplicable_tests
from calib.diagnosis.next_measurement import next_measurement
from calib.diagnosis.noise import Noise
from calib.diagnosis.part import Part
from calib.diagnosis.separation import LinearisedPrediction, least_squares, prior_of
from calib.diagnosis.signature import Point
from calib.execution.pool import InProcess
from calib.modelling.model import Model
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Request
from calib.objective import Objective, Reference, Term
from calib.plugins import load
from calib.records.excitation import Excitation

RESONANCE, WIDTH = 17.0, 0.2  # Hz; of the resonance, relative
NOISE = 0.02  # standard deviation over root mean square
DRIVE = Excitation("base", "base motion", frequency=12.0, amplitude=1e-3)
REQUEST = Request(periods=4, samples=50)


# --- two linear models in Gaussian noise


def linear(one, other, derivatives, priors):
    """Separation of two predictions (n,) with one derivative (n,) each, known before to a precision."""
    columns = np.column_stack([one, other, *derivatives])
    triangle = np.linalg.qr(columns, mode="r")
    return LinearisedPrediction((triangle,), (1, 1), tuple(np.array([[p]]) for p in priors)).separation()


def test_the_separation_is_the_distance_of_the_predictions_where_no_parameter_is_free():
    rng = np.random.default_rng(0)
    one, other = rng.standard_normal((2, 40))
    none = np.zeros((40, 2)).T
    assert linear(one, other, none, (1.0, 1.0)).z == pytest.approx([np.linalg.norm(other - one)])


@pytest.mark.parametrize("prior", [0.0, 3.0, 1e4])
def test_of_the_difference_a_parameter_absorbs_what_its_prior_leaves_free(prior):
    column = np.random.default_rng(1).standard_normal(40)
    separation = linear(np.zeros(40), 5.0 * column, (column, np.zeros(40)), (prior, 1.0))
    length = column @ column
    assert separation.z == pytest.approx([5.0 * np.sqrt(length * prior**2 / (length + prior**2))], abs=1e-6)
    assert separation.moves[0][0] == pytest.approx([5.0 * length / (length + prior**2)])


def test_a_nuisance_known_to_its_unit_absorbs_what_that_leaves_free():
    column = np.random.default_rng(2).standard_normal(40)
    block = np.column_stack([np.zeros(40), 5.0 * column, np.zeros((40, 2)), column])
    priors = (np.array([[1.0]]), np.array([[1.0]]))
    known = LinearisedPrediction((np.linalg.qr(block, mode="r"),), (1, 1), priors, standardised=1).separation()
    length = column @ column
    assert known.z == pytest.approx([5.0 * np.sqrt(length / (1.0 + length))], abs=1e-6)


def test_least_squares_leave_out_a_column_that_is_zero():
    move, left = least_squares(np.array([[1.0, 0.0], [0.0, 0.0]]), np.array([2.0, 1.0]))
    assert (move.tolist(), left) == ([2.0, 0.0], 1.0)


def test_what_one_record_alone_had_is_not_known_of_the_next():
    """Of a release that is fitted to each record: what that leaves unknown of the stiffness stays unknown."""
    columns = np.random.default_rng(3).standard_normal((40, 3))
    columns[:, 1] += 2.0 * columns[:, 0]  # the release in this record acts like the stiffness
    none = np.zeros((40, 0))
    names = ("stiffness", "release@tone", "release@other")
    fit = Fit(Point({}, (), {}), (), np.zeros(40), columns, names, (1.0, 1.0, 1.0), none, np.zeros(40, dtype=int))
    made = SimpleNamespace(part=SimpleNamespace(name="tone"), initial_steps=(0.1,))
    prior = prior_of(fit, made)
    shared = columns[:, [0, 2]]
    left = shared - np.outer(columns[:, 1], columns[:, 1] @ shared) / (columns[:, 1] @ columns[:, 1])
    information = prior.T @ prior
    np.testing.assert_allclose(information[np.ix_([0, 2], [0, 2])], left.T @ left, atol=1e-9)
    np.testing.assert_array_equal(information[[1, 3]], 0.0)


# --- the search, on two models that differ by a second harmonic


class Resonant:
    """A body that follows its base, with a second harmonic that is largest at a resonance.

    Parameters
    ----------
    fails_above : amplitude from which its simulation fails  [m]
    irregular_above : frequency from which its motion does not return  [Hz]
    two_motions_above : frequency from which it moves in one of two ways  [Hz]: from rest by the sign of its harmonic,
        else as it did before, which is its state
    """

    name = "resonant"
    bodies = ("mass", "frame")
    sites = frozenset()
    excitations = (("base motion", "base"),)
    parameters = (Parameter("harmonic", "1/m", 0.0, "second harmonic over the square of the amplitude"),)

    def __init__(self, fails_above=np.inf, irregular_above=np.inf, two_motions_above=np.inf):
        self.fails_above, self.irregular_above = fails_above, irregular_above
        self.two_motions_above = two_motions_above

    def run(self, values, excitation, laws, request):
        if excitation.amplitude > self.fails_above:
            return records.failed(self.bodies, "diverged", "it is too loud")
        time = np.arange(request.periods * request.samples) / (request.samples * excitation.frequency)
        angle = 2.0 * np.pi * excitation.frequency * time
        size = values["harmonic"] * excitation.amplitude**2 * at_resonance(excitation.frequency)
        before = request.initial_state
        way = before if before is not None else np.sign([values["harmonic"]])
        if excitation.frequency > self.two_motions_above:
            size += 0.1 * way[0] * excitation.amplitude
        motion = excitation.amplitude * np.cos(angle) + size * np.cos(2.0 * angle)
        frame = excitation.amplitude * np.cos(angle) + 3.0 * size * np.cos(2.0 * angle)
        steps = np.arange(64.0)
        wander = np.cos(steps**2) if excitation.frequency > self.irregular_above else np.zeros(64)
        section = {name: excitation.amplitude * np.tile(1.0 + wander, (2, 1)) for name in ("displacement", "velocity")}
        channels = {"displacement": np.array([motion, frame])}
        return records.make(time, self.bodies, channels, section=section, state=way, frequency=excitation.frequency)


def at_resonance(frequency):
    return np.exp(-((np.log(frequency / RESONANCE) / WIDTH) ** 2))


def expected(amplitude, frequency, harmonic):
    """Separation of the models with and without the harmonic: the ratio of amplitudes over that of the noise."""
    samples = REQUEST.periods * REQUEST.samples
    return harmonic * amplitude * at_resonance(frequency) * np.sqrt(samples) / NOISE


class Counted(InProcess):
    """A pool that knows how often it was asked, and for how much."""

    def __init__(self, function):
        super().__init__(function)
        self.sizes = []

    def map(self, payloads):
        payloads = list(payloads)
        self.sizes.append(len(payloads))
        return super().map(payloads)


def designed(laboratory, harmonics=(0.0, 120.0), budget=None, **simulator):
    """Search for the next measurement beside one tone, between models with these harmonics; and its pool."""
    model = Model(Resonant(**simulator))
    measured = model.run({"harmonic": 0.0}, DRIVE, REQUEST).sel(body=["mass"])
    reference = Reference("tone", measured, "calibrate", excitation=DRIVE, request=REQUEST)
    objective = Objective({"tone": reference}, [Term(load("calib.features", "time_history")())])
    bench = Bench(model, objective, {"tone": (("mass", "displacement"),)})
    rows = measured["displacement"].values
    noise = Noise(NOISE * float(np.sqrt((rows**2).mean())), np.zeros(0), "stated in the record")
    part = Part(
        "tone", (("mass", "displacement"),), measured.time.values, rows, DRIVE.period, 1, (), (noise,),
        np.ones(rows.shape, dtype=bool), np.ones(rows.shape),
    )  # fmt: skip
    none = np.zeros((rows.size, 0))
    rivals = []
    for harmonic in harmonics:
        values = {"harmonic": harmonic}
        point = Point(values, (), {"tone": bench(Run("tone", values))})
        fit = Fit(point, (), np.zeros(rows.size), none, (), (), none, np.zeros(rows.size, dtype=int))
        rivals.append(SimpleNamespace(name=f"h{harmonic:g}", fit=fit))
    pool = Counted(bench)
    effort = Effort(pool, budget)
    fitter = SimpleNamespace(evidence=Evidence((part,)), with_derivatives=lambda fit: fit, effort=effort)
    return next_measurement(pool if budget is None else effort, bench, fitter, rivals, laboratory), pool


BENCH = Laboratory(frequency=(5.0, 40.0), amplitude=(2e-4, 3e-3), tests=("steady tone",), channels=(), simulations=300)


@pytest.mark.parametrize("simulations", [0, 40, 150])
def test_the_search_takes_no_more_simulations_than_the_budget_leaves(simulations):
    design, _ = designed(BENCH, budget=Budget(simulations=simulations))
    assert design.max_simulations == simulations
    assert 0.5 * simulations <= design.simulations <= simulations
    assert bool(design.measurements) == (simulations > 0)
    if not simulations:
        assert "the allowed number of simulations does not suffice" in design.unavailable.values()


def test_the_best_tone_is_at_the_resonance_and_at_the_largest_amplitude():
    design, _ = designed(BENCH)
    [best] = design.measurements
    assert best.point.frequency == pytest.approx(RESONANCE, rel=0.03)
    assert best.point.amplitude == pytest.approx(3e-3)
    assert best.z == pytest.approx(expected(best.point.amplitude, best.point.frequency, 120.0), rel=0.02)
    assert best.z > 0.97 * expected(3e-3, RESONANCE, 120.0)
    assert design.models == ("h0", "h120")


def test_every_separation_that_is_drawn_is_the_known_one():
    design, _ = designed(BENCH)
    assert len(design.points) > 60
    for evaluated in design.points:
        known = expected(evaluated.point.amplitude, evaluated.point.frequency, 120.0)
        assert evaluated.z == pytest.approx(known, rel=0.02, abs=1e-6)


def test_the_grid_has_more_frequencies_than_amplitudes():
    design, _ = designed(BENCH)
    grid = [(e.point.amplitude, e.point.frequency) for e in design.points if e.stage == "grid"]
    amplitudes, frequencies = (sorted(set(values)) for values in zip(*grid, strict=True))
    assert len(grid) == len(set(grid)) == len(amplitudes) * len(frequencies)
    assert len(frequencies) / len(amplitudes) == pytest.approx(GRID_ASPECT, abs=0.15)
    assert (amplitudes[0], amplitudes[-1], frequencies[0], frequencies[-1]) == pytest.approx((2e-4, 3e-3, 5.0, 40.0))


def test_the_simulations_are_bounded_and_handed_out_in_batches():
    design, pool = designed(BENCH)
    assert design.simulations == sum(pool.sizes) <= 300
    assert max(pool.sizes) >= 30  # sixteen points of two models
    few, _ = designed(Laboratory(tests=("steady tone",), simulations=24))
    assert few.simulations <= 24
    assert few.measurements


def test_where_a_simulation_fails_there_is_no_measurement():
    design, _ = designed(BENCH, fails_above=1.2e-3)
    assert design.measurements[0].point.amplitude <= 1.2e-3
    failed = [e for e in design.points if e.status == "failed"]
    assert {e.point.amplitude > 1.2e-3 for e in failed} == {True}
    assert {e.reason for e in failed} == {"it is too loud"}
    assert np.isnan([e.z for e in failed]).all()


def test_an_irregular_motion_is_no_measurement():
    design, _ = designed(BENCH, irregular_above=15.0)
    assert design.measurements[0].point.frequency <= 15.0
    told = {(e.point.frequency > 15.0, e.status == "irregular") for e in design.points}
    assert told == {(True, True), (False, False)}


@pytest.mark.slow
def test_where_nothing_can_be_simulated_the_reason_is_given():
    design, _ = designed(BENCH, fails_above=1e-3 * 1.0001, irregular_above=12.5)
    above = Laboratory(frequency=(20.0, 40.0), amplitude=(2e-4, 1e-3), tests=("steady tone",), channels=())
    design, _ = designed(above, irregular_above=12.5)
    assert design.measurements == ()
    assert design.unavailable["steady tone"].startswith("irregular at every point; at the first: ")


def test_a_channel_that_the_record_lacks_separates_further():
    asked = Laboratory(frequency=(12.0, 12.0), amplitude=(1e-3, 1e-3), channels=(("frame", "displacement"),))
    design, _ = designed(asked)
    repeated = next(m for m in design.measurements if m.kind == "repeated record")
    assert repeated.channel == "frame.displacement"
    assert repeated.description == "tone once more, with the displacement of frame measured too"
    frame = 3.0 * 120.0 * 1e-3 * at_resonance(12.0)  # its noise is in proportion to its motion
    level = np.sqrt(1.0 + frame**2)
    known = expected(1e-3, 12.0, 120.0)
    assert repeated.z == pytest.approx(np.hypot(known, 3.0 * known), rel=0.1 * level)
    assert design.measurements[0].channel == ""  # decisive too, and needs no other sensor


def test_a_channel_that_the_simulator_does_not_give_is_left_out():
    design, _ = designed(Laboratory(tests=("repeated record",)))  # it gives no velocities
    [best] = design.measurements
    assert best.channel == "frame.displacement"


def test_of_three_models_the_two_least_distinguishable_are_separated():
    design, _ = designed(BENCH, harmonics=(0.0, 100.0, 120.0))
    [best] = design.measurements
    assert best.z == pytest.approx(expected(3e-3, best.point.frequency, 20.0), rel=0.1)
    assert best.z_max == pytest.approx(expected(3e-3, best.point.frequency, 120.0), rel=0.02)


def test_without_bounds_these_come_from_the_record():
    design, _ = designed(Laboratory(simulations=60))
    bounds = {v.name: (v.low, v.high, v.stated) for v in design.variables if v.name != "release"}
    assert bounds == {
        "amplitude": pytest.approx((1e-4, 1.5e-3, False)),
        "frequency": pytest.approx((6.0, 24.0, False)),
    }


def test_one_model_leaves_nothing_to_be_separated():
    assert designed(BENCH, harmonics=(0.0,))[0] is None


def test_the_prediction_says_whether_all_some_or_none_are_distinguished():
    design, _ = designed(BENCH, harmonics=(0.0, 120.0, 120.0))
    assert design.measurements[0].prediction.startswith("would distinguish some of them (z = 0 to ")
    design, _ = designed(BENCH, harmonics=(0.0, 0.1))
    assert design.measurements[0].prediction.startswith("would not distinguish them (z = 0")
    assert DesignPoint("steady tone", 1.0, 2.0).release is None


def test_what_a_simulation_at_the_refitted_parameters_denies_is_not_promised():
    design, _ = designed(BENCH)
    [best] = design.measurements
    assert best.distinguished == 1
    assert best.prediction.startswith("would distinguish them")
    unchecked = replace(best, distinguished=0, unchecked=1, z_refit=None)
    assert unchecked.prediction.endswith("the budget left no simulations to confirm it)")
    one_of_three = replace(best, pairs=3, distinguished=2)
    assert one_of_three.prediction.startswith("would distinguish some of them")
    jumped = replace(best, distinguished=0, z_refit=1800.0)
    assert not jumped.confirmed
    assert jumped.prediction.startswith("may distinguish them")
    assert jumped.prediction.endswith("which simulations do not confirm)")


def test_where_each_model_may_move_as_the_other_does_no_separation_is_promised():
    design, _ = designed(BENCH, harmonics=(-1e-3, 1e-3), two_motions_above=20.0)
    ways = [e.z for e in design.points if e.point.frequency > 20.0]
    assert min(ways) > 20.0  # by derivatives of the one motion and of the other
    [best] = design.measurements
    assert best.distinguished == 0
    assert best.z < 0.01


def test_a_test_without_bounds_is_unavailable_for_that_reason():
    model = Model(load("calib.simulators", "oscillator")())
    drive = Excitation("mass", "force", frequency=5.0, amplitude=1.0)
    time = np.arange(400) / 2000.0
    record = records.make(time, ("mass",), {"velocity": np.zeros((1, 400))})
    references = {"tone": Reference("tone", record, "calibrate", excitation=drive, request=Request(times=time))}
    part = Part("tone", (("mass", "velocity"),), time, np.zeros((1, 400)), 0.2, 1, (), (), None, None)
    one_frequency = Laboratory(frequency=(5.0, 5.0), tests=("sweep", "free decay"))
    reasons = inapplicable_tests(one_frequency, references, model, part)
    assert reasons["sweep"].startswith("its first and its last frequency are the same")
    assert reasons["free decay"].startswith("no measured displacement bounds the release")
