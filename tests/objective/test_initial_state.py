"""The initial state of a free decay, solved for as a nuisance of its record alone."""

import re
from functools import partial

import numpy as np
import pytest
from scipy.optimize import least_squares

from calib import records
from calib.confidence import around_best
from calib.diagnosis.bench import Run
from calib.diagnosis.diagnose import diagnose
from calib.diagnosis.gathering import gathered
from calib.diagnosis.preparation import bench_of
from calib.diagnosis.verdict import NONE
from calib.errors import CalibError
from calib.execution.pool import InProcess
from calib.modelling.model import Model
from calib.modelling.parameter import Space, Window
from calib.modelling.simulator import Request
from calib.objective import Objective, Reference, Term
from calib.objective.initial_state import Comparison, Unknown, View, first_value, quarter_period, released
from calib.objective.outliers import isolated_outliers
from calib.plugins import load as registered
from calib.records.excitation import Excitation
from calib.simulators.oscillator import Oscillator
from calib.store import Store
from calib.study import CalibrationStudy, evaluate
from calib.study_file import load
from calib.workflows.calibrate import calibrate

MODEL = Model(Oscillator())
TIME = np.arange(600) * 0.01
DECAY = Excitation("mass", "free decay")
REQUEST = Request(times=TIME)
TRUE = {"mass": 0.2, "stiffness": 15.0, "damping": 0.04}
STARTS = {"first": (0.07, 0.3), "second": (-0.02, 0.5), "third": (0.05, -0.1)}  # m, m/s
OFFSET, SIGMA = 0.4, 2e-4  # m
USES = {"first": "calibrate", "second": "name", "third": "holdout"}


def decay(start, seed, model=MODEL, **values):
    """Measured displacement of a decay from `start`, with offset and noise."""
    begin = dict(zip(("initial_displacement", "initial_velocity"), start, strict=True))
    x = model.run({**TRUE, **begin, **values}, DECAY, REQUEST).displacement.values
    noise = SIGMA * np.random.default_rng(seed).standard_normal(x.shape)
    record = records.make(TIME, ("mass",), {"displacement": x + OFFSET + noise}, place="mass", quantity="free decay")
    return record.assign(displacement_sigma=(("body", "time"), np.full(x.shape, SIGMA)))


def reference(name, record=None, nuisance=("initial_state", "offset"), use=None):
    record = decay(STARTS[name], list(STARTS).index(name)) if record is None else record
    return Reference(name, record, use or USES[name], nuisance, DECAY, REQUEST)


def objective(*references):
    return Objective({r.name: r for r in references}, [Term(registered("calib.features", "time_history")())])


def study(*references, fixed=None, windows=None):
    windows = windows or {"stiffness": Window(10.0, 20.0), "damping": Window(0.0, 0.2)}
    space = Space(windows, {"mass": 0.2} if fixed is None else fixed)
    return CalibrationStudy(
        "decay", MODEL, space, objective(*references), registered("calib.optimisers", "multistart"), 60
    )


# --- what the record alone tells --------------------------------------------------------------------------------------


@pytest.mark.parametrize("outliers", [(), ((0, 0.05), (4, -0.03), (9, 0.05))])
def test_the_start_is_read_off_the_first_samples_and_outliers_have_no_say(outliers):
    x = 0.05 * np.cos(9.0 * TIME + 0.4)
    assert quarter_period(x) == pytest.approx(2.0 * np.pi / 9.0 / 4.0 / 0.01, abs=3)
    value, rate = x[0], -9.0 * 0.05 * np.sin(0.4)
    for sample, size in outliers:
        x[sample] += size
    assert first_value(TIME, x, quarter_period(x)) == (pytest.approx(value, abs=1e-3), pytest.approx(rate, abs=0.05))


def test_a_channel_that_does_not_move_has_no_quarter_period():
    assert quarter_period(np.zeros(600)) == 600


def test_lost_echoes_are_outliers_and_turning_points_are_not():
    rng = np.random.default_rng(5)
    x = 0.05 * np.cos(9.0 * TIME) + 1e-4 * rng.standard_normal(TIME.size)
    bad = np.arange(20, 600, 37)
    x[bad] += 0.03
    assert np.flatnonzero(isolated_outliers(x[None])[0]).tolist() == bad.tolist()


# --- the solution -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("effect", [None, "quadratic_drag", "cubic_stiffness"])
def test_the_solution_is_that_of_a_full_least_squares_fit(effect):
    model, values = MODEL, TRUE
    if effect is not None:
        extension = registered("calib.effects", effect)
        model = MODEL.extended(extension)
        values = {**TRUE, extension.parameters[0].name: {"quadratic_drag": 1.0, "cubic_stiffness": 1500.0}[effect]}
    record = decay(STARTS["first"], 0, model, **values)
    measured = record.displacement.values[0]

    def residual(x):
        begin = {"initial_displacement": x[0], "initial_velocity": x[1]}
        return (model.run({**values, **begin}, DECAY, REQUEST).displacement.values[0] + x[2] - measured) / SIGMA

    best = least_squares(residual, [*STARTS["first"], OFFSET], x_scale=[0.01, 0.1, 0.01], xtol=1e-12)
    found = objective(reference("first", record))
    released = found.released("first", model, values)
    nuisances = found({"first": released.record}).nuisances["first"]
    errors = np.sqrt(np.diag(np.linalg.inv(best.jac.T @ best.jac)))
    solved = [nuisances[name] for name in ("initial_displacement", "initial_velocity", "offset.mass")]
    assert (np.abs(solved - best.x) < 0.02 * errors).all()
    assert (np.abs(solved - np.array([*STARTS["first"], OFFSET])) < 4.0 * errors).all()
    assert released.simulations <= (4 if effect is None else 10)


def test_the_same_values_give_the_same_bits_whatever_ran_before():
    references = reference("first"), reference("second", use="calibrate")
    wanted = evaluate(study(*references), {**TRUE, "stiffness": 14.0})
    again = study(*references)
    evaluate(again, {**TRUE, "stiffness": 18.0})
    found = evaluate(again, {**TRUE, "stiffness": 14.0})
    assert (found.score.residuals == wanted.score.residuals).all()
    assert found.score.nuisances == wanted.score.nuisances
    assert found.records.keys() == wanted.records.keys() == {"first", "second"}
    assert all(found.records[name].identical(record) for name, record in wanted.records.items())


def test_isolated_outliers_do_not_move_the_solution():
    record = decay(STARTS["first"], 0)
    record.displacement.values[:] -= OFFSET
    disturbed = record.copy(deep=True)
    disturbed.displacement.values[0, np.arange(9, 600, 31)] += 0.05
    states = []
    for one in (record, disturbed):
        found = objective(reference("first", one, ["initial_state"]))
        states.append(found({"first": found.released("first", MODEL, TRUE).record}).nuisances["first"])
    assert states[1] == pytest.approx(states[0], rel=2e-4)


def test_a_plain_value_of_the_initial_state_is_replaced_for_the_records_that_free_it():
    freed, held = reference("first"), reference("second", nuisance=("offset",), use="calibrate")
    begin = {"initial_displacement": -0.02, "initial_velocity": 0.5}
    found = evaluate(study(freed, held, fixed={"mass": 0.2, **begin}), {**TRUE, **begin})
    assert found.score.nuisances["first"]["initial_displacement"] == pytest.approx(0.07, abs=1e-3)
    assert set(found.score.nuisances["second"]) == {"offset.mass"}
    assert found.simulations == 4 + 1


def test_a_simulation_that_fails_is_a_status():
    found = evaluate(study(reference("first")), {**TRUE, "mass": -1.0})
    assert found.score.status == "impossible value"
    assert found.records["first"].attrs["reason"]
    seen = bench_of(study(reference("first")), {})(Run("first", {**TRUE, "mass": -1.0}))
    assert (seen.usable, seen.status) == (False, "impossible value")


def test_a_simulation_that_fails_on_the_way_is_a_status():
    compared = Comparison(decay(STARTS["first"], 0), [("mass", "displacement")])
    good = records.make(TIME, ("mass",), {"displacement": 0.0 * TIME[None]})
    bad = records.failed(("mass",), "diverged", "it flew off")

    def look(state):
        if state["x"] != 0.0:
            return View(bad, status="diverged")
        return compared.view(good, {"displacement": good.displacement.values}, np.ones(TIME.size))

    found = released(look, compared, [Unknown("x", 0.0, 1.0, -1.0, 1.0)])
    assert found.record.attrs["status"] == "diverged"
    assert found.simulations == 3  # the start, and a step to either side


def test_a_recorded_input_has_a_start_too():
    force = Excitation("mass", "force", time=TIME, value=0.3 * np.sin(5.0 * TIME))
    begin = {"initial_displacement": 0.01, "initial_velocity": -0.2}
    record = MODEL.run({**TRUE, **begin}, force, REQUEST)
    found = objective(Reference("forced", record, "calibrate", ("initial_state",), force, REQUEST))
    score = found({"forced": found.released("forced", MODEL, TRUE).record})
    assert score.nuisances["forced"] == pytest.approx(begin, rel=1e-6)
    assert score.cost < 1e-6


# --- calibration ------------------------------------------------------------------------------------------------------


STUDY = """
[study]
name = "decay"
seed = 1
budget = 40
timeout = "30 s"

{records}
[model]
simulator = "{simulator}"
fixed = {{ mass = 0.2{fixed} }}

[windows]
stiffness = {{ low = 10.0, high = 20.0 }}
damping = {{ low = 0.0, high = 0.2 }}
{windows}

[[term]]
feature = "time_history"

[optimiser]
name = "multistart"
"""
RECORD = """
[[record]]
name = "{name}"
path = "{name}.nc"
use = "{use}"
nuisance = ["initial_state", "offset"]

[record.excitation]
place = "mass"
quantity = "{quantity}"
{more}
"""


def written(folder, fixed="", windows="", simulator="oscillator", quantity="free decay", more=""):
    """Write a study of three decays; return its path."""
    for number, (name, start) in enumerate(STARTS.items()):
        records.write(decay(start, number), folder / f"{name}.nc")
    entries = "".join(RECORD.format(name=n, use=u, quantity=quantity, more=more) for n, u in USES.items())
    text = STUDY.format(records=entries, fixed=fixed, windows=windows, simulator=simulator)
    (folder / "study.toml").write_text(text)
    return folder / "study.toml"


def test_a_decay_from_an_unknown_state_is_calibrated_to_the_true_stiffness_and_damping(tmp_path):
    whole = study(reference("first"))
    pool = InProcess(partial(evaluate, whole))
    best = whole.run(Store(tmp_path / "out"), pool).best
    confidence = around_best(whole, pool, best, evaluate(whole, best.values))
    for name in ("stiffness", "damping"):
        low, high = confidence.interval[name]
        assert low < TRUE[name] < high
        assert high - low < 0.1 * TRUE[name]
    assert best.simulations == 4


@pytest.mark.slow
def test_the_states_of_all_records_are_told_with_their_units(tmp_path):
    found = calibrate(written(tmp_path), quiet=True)
    solved = found.nuisances["first"]
    assert (solved["initial_displacement"], solved["offset.mass"]) == pytest.approx((0.07, OFFSET), abs=1e-3)
    assert found.nuisance_units == {"offset.mass": "m", "initial_displacement": "m", "initial_velocity": "m/s"}
    held = found.holdout["third"]
    assert held.nuisances["initial_displacement"] == pytest.approx(0.05, abs=1e-3)
    assert held.misfit < 0.05
    assert found.simulations > 4 * found.trials > 0
    page = (tmp_path / "out" / "report.html").read_text()
    assert re.search(r"in third [^;]*initial_velocity \S+ m*/s", page)


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"fixed": ', "initial_displacement@third" = 0.05'}, "model.fixed.initial_displacement@third: .*'third' has"),
        (
            {"windows": '"initial_velocity@first" = { low = 0.0, high = 1.0 }'},
            "windows.initial_velocity@first: .*drop one of the two",
        ),
        (
            {"windows": "initial_velocity = { low = 0.0, high = 1.0 }"},
            "windows.initial_velocity: nothing is left to search",
        ),
        (
            {"quantity": "force", "more": "frequency = 1.0\namplitude = 1.0"},
            r"record\[.*\].nuisance.*first: .*harmonic",
        ),
        ({"simulator": "tiny_simulators:Undeclared"}, "nuisance: first: .*does not say which of its parameters"),
    ],
)
def test_mistakes_name_record_and_key(tmp_path, how, message):
    with pytest.raises(CalibError, match=message):
        load(written(tmp_path, **how))


# --- diagnosis --------------------------------------------------------------------------------------------------------


def test_a_diagnosis_takes_out_what_the_initial_state_explains():
    names = ["first", "second"]
    whole = study(reference("first"))
    bench = bench_of(whole, {name: reference(name) for name in names[1:]})
    seen = {name: bench(Run(name, TRUE)) for name in names}
    assert all(view.initial.shape == (2, 1, TIME.size) for view in seen.values())
    begin = dict(zip(("initial_displacement", "initial_velocity"), STARTS["first"], strict=True))
    ends = [
        MODEL.run({**TRUE, **begin, "initial_velocity": 0.3 + step}, DECAY, REQUEST).displacement.values
        for step in (-0.05, 0.05)
    ]
    evidence = gathered({n: bench.objective.references[n] for n in names}, bench.rows, dict.fromkeys(names, 1), seen)
    part = evidence.parts[0]
    change, columns = part.white(ends[1] - ends[0]), part.tangents(seen["first"])
    assert columns.shape[1] == 3  # two of the initial state, and the offset
    left = change - columns @ np.linalg.lstsq(columns, change, rcond=None)[0]
    assert np.linalg.norm(left) < 1e-6 * np.linalg.norm(change)


def test_nothing_is_found_in_decays_that_lack_nothing():
    names = ("cubic_stiffness", "quadratic_drag", "channel_drift")
    effects = [registered("calib.effects", name) for name in names]
    found = diagnose(
        study(reference("first")),
        {name: reference(name) for name in ("second", "third")},
        {**TRUE, "stiffness": 15.01},
        effects,
        pool=InProcess,
    )
    assert found.verdict == NONE


@pytest.mark.slow
def test_drag_that_is_hidden_in_decays_is_named_and_proven_on_the_record_held_out():
    drag = registered("calib.effects", "quadratic_drag")
    model = MODEL.extended(drag)
    known = {n: reference(n, decay(s, k, model, c2=0.8)) for k, (n, s) in enumerate(STARTS.items())}
    whole = study(known.pop("first"))
    effects = [drag, registered("calib.effects", "cubic_stiffness"), registered("calib.effects", "softening")]
    found = diagnose(whole, known, {**TRUE, "damping": 0.1}, effects, pool=InProcess)
    assert found.causes == ("quadratic_drag",)
    assert found.selection.final.value("c2") == pytest.approx(0.8, rel=0.1)
    assert found.gain.proven
    assert found.gain.records == ("third",)
