"""The simulator delaminated_beam: its options, its two kernels on one beam, its record."""

import json
import math
import pickle
import re
import subprocess
import sys

import numpy as np
import pytest
from child_environment import environment
from click.testing import CliRunner
from printed import cells
from short_beam import EXCITATION, MESH, REQUEST, VALUES, attempt, beam, run

from calib import records
from calib.cli import main
from calib.effects.gap_offset import EFFECT as GAP_OFFSET
from calib.effects.quadratic_drag import EFFECT as AIR_DRAG
from calib.errors import CalibError
from calib.modelling.effect import Effect
from calib.modelling.laws import contact, excitation, force
from calib.modelling.model import Model
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Request
from calib.records import STATE
from calib.records.excitation import Excitation
from calib.simulators.delaminated_beam import DelaminatedBeam
from calib.simulators.delaminated_beam.mesh import smooth_step
from calib.testing import SimulatorSuite

BOTH = pytest.mark.parametrize("fidelity", ["reduced", "full"])
CLEAR = {"s": 8e-3}  # a gap too wide for contact


class TestReduced(SimulatorSuite):
    excitation = Excitation("centre", "displacement", frequency=26.51, amplitude=0.92e-3)

    def make(self):
        return DelaminatedBeam()


class TestFull(SimulatorSuite):
    excitation = EXCITATION
    values = VALUES

    def make(self):
        return beam(fidelity="full")


@pytest.mark.slow
class TestAuto(TestFull):
    def make(self):
        return beam(fidelity="auto")


@pytest.mark.slow
class TestFullOnItsOwnMesh(TestReduced):
    values = {"dt": 4e-7}

    def make(self):
        return DelaminatedBeam(fidelity="full", masters=8, outer=6)


def layer(record):
    """Return displacement and velocity of the layer's middle (2, n), the velocity over the angular frequency  [m]."""
    omega = 2.0 * np.pi * record.attrs["frequency"]
    return np.array([record.displacement.sel(body="layer"), record.velocity.sel(body="layer") / omega])


def apart(one, other):
    """Root mean square difference of two records' layers over that of the second about its mean  [1]."""
    one, other = layer(one), layer(other)
    return np.sqrt(np.mean((one - other) ** 2) / np.mean((other - other.mean(axis=1, keepdims=True)) ** 2))


def amplitude(record):
    """Half the way of the layer's middle  [m]."""
    return 0.5 * float(np.ptp(layer(record)[0]))


# --- options and values


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"length": 0.0}, "inside a beam of 0 m; mend delamination or length"),
        ({"delamination": 2.0}, "inside a beam of 1.386 m; mend"),
        ({"support": 0.1}, r"between delamination .0.28 m. and end .0.693 m.; mend support"),
        ({"width": 0.0}, "width is 0; give it a positive value"),
        ({"dt": 0.0}, "give dt, or f_dt"),
        ({"dt": 1e-3}, "lower dt, f_dt or beta"),
    ],
)
def test_values_that_give_no_beam_fail_and_the_reason_says_what_to_mend(values, said):
    record = attempt(beam(), **{"beta": 0.02, **values})
    assert record.attrs["status"] != records.OK
    assert re.search(said, record.attrs["reason"])


def test_a_tied_shift_lets_no_layer_lie_within_the_beam():
    tied = {"gap": 1e-3, "g_max": 1.5e-3}
    values = {name: value for name, value in VALUES.items() if name not in ("s", "g_max")}
    record = Model(beam(shift="tied")).run({**values, **tied}, EXCITATION, REQUEST)
    assert record.attrs["status"] == "diverged"
    assert "g_max of 1.5 mm is above the gap of 1 mm" in record.attrs["reason"]
    assert "lower g_max" in record.attrs["reason"]


def test_a_shift_that_is_tied_takes_the_gap_for_a_parameter():
    names = {p.name for p in beam(shift="tied").parameters}
    free = {p.name for p in beam().parameters}
    assert (names - free, free - names) == ({"gap"}, {"s"})


@BOTH
def test_a_tied_shift_is_the_gap_less_the_height_of_the_cubics(fidelity):
    free, tied = beam(fidelity=fidelity), beam(fidelity=fidelity, shift="tied")
    values = {name: value for name, value in VALUES.items() if name != "s"}
    record = Model(tied).run({**values, "gap": 4e-3}, EXCITATION, REQUEST)
    np.testing.assert_array_equal(layer(record), layer(run(free, s=4e-3 - VALUES["g_max"])))


@BOTH
def test_a_table_of_the_cubics_is_the_cubics(fidelity):
    cubics = beam(fidelity=fidelity)
    place = np.arange(9) / 8  # where the pairs are
    rows = np.stack([place, VALUES["g_max"] * smooth_step(place)], axis=1).tolist()
    record = run(beam(fidelity=fidelity, gap_table=rows), g_max=0.123)
    np.testing.assert_allclose(layer(record), layer(run(cubics)), rtol=0, atol=1e-12)


def test_a_table_of_the_whole_beam_may_be_lopsided():
    rows = [[-1.0, 0.0], [-0.5, -2e-3], [0.0, 0.8e-3], [1.0, 0.0]]
    whole = run(beam(symmetric=False, gap_table=rows))
    mirrored = run(beam(symmetric=False, gap_table=[[-x, gap] for x, gap in rows[::-1]]))
    even = run(beam(symmetric=False, gap_table=[[-1.0, 0.0], [0.0, 0.8e-3], [1.0, 0.0]]))
    assert apart(whole, mirrored) < 1e-5
    assert apart(whole, even) > 1e-3
    share = whole.contact_share.values
    np.testing.assert_allclose(mirrored.contact_share.values[::-1], share, atol=1e-3)


@BOTH
def test_half_a_beam_moves_as_the_whole_one(fidelity):
    half = run(beam(fidelity=fidelity, modes=12))
    whole = run(beam(fidelity=fidelity, modes=24, symmetric=False))  # half of its modes are even
    assert apart(whole, half) < 1e-6
    np.testing.assert_allclose(whole.contact_force.values, half.contact_force.values, rtol=1e-6, atol=1e-3)
    assert whole.attrs["contact_force_max"] == pytest.approx(half.attrs["contact_force_max"], rel=1e-6)


@BOTH
def test_a_finer_mesh_is_another_beam_and_not_much(fidelity):
    coarse, fine = (run(beam(fidelity=fidelity, masters=8, refinement=n), dt=8e-7, **CLEAR) for n in (1, 2))
    assert 1e-4 < apart(fine, coarse) < 0.1
    assert fine.attrs["critical_step"] == pytest.approx(0.5 * coarse.attrs["critical_step"], rel=0.02)


# --- values


@BOTH
@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"delamination": 2.0}, "delamination of 2 m"),
        ({"delamination": 0.0}, "delamination of 0 m"),
        ({"length": 0.5}, "beam of 0.5 m"),
        ({"support": 0.1}, "supports"),
        ({"support": 1.0}, "supports"),
        ({"width": 0.0}, "width"),
        ({"density": -1.0}, "density"),
        ({"young_modulus": 0.0}, "young_modulus"),
        ({"layer_thickness": 0.0}, "layer_thickness"),
        ({"layer_thickness": 1e30}, "too slender"),
        ({"beam_thickness": 1e-9}, "too slender"),
        ({"poisson_ratio": 0.5}, "bulk modulus"),
        ({"poisson_ratio": -1.0}, "poisson_ratio"),
        ({"f": -0.01}, "parameter f"),
        ({"c_con": -1.0}, "c_con"),
        ({"alpha": -5.0}, "alpha"),
        ({"beta_seconds": -1e-9}, "beta_seconds"),
        ({"dt": 0.0}, "time step"),
        ({"alpha": math.inf}, "alpha"),
    ],
)
def test_values_that_give_no_beam_are_a_status_with_a_reason(fidelity, values, said):
    record = attempt(beam(fidelity=fidelity), **values)
    assert record.attrs["status"] == "diverged"
    assert said in record.attrs["reason"]
    with pytest.raises(ValueError, match=said):
        Model(beam(fidelity=fidelity)).period_map({**VALUES, **values}, EXCITATION)


@BOTH
def test_a_step_above_the_limit_is_refused_and_the_limit_is_told(fidelity):
    record = attempt(beam(fidelity=fidelity), dt=2e-6)
    assert record.attrs["status"] == "unstable step"
    assert f"{record.attrs['stable_step']:.4g} s" in record.attrs["reason"]
    assert record.attrs["step"] > record.attrs["stable_step"]
    with pytest.raises(ValueError, match="above the stable one"):
        Model(beam(fidelity=fidelity)).period_map({**VALUES, "dt": 2e-6}, EXCITATION)


@BOTH
def test_the_step_is_the_longest_below_what_is_asked_for_that_divides_the_period(fidelity):
    for asked in (1.7e-6, 1.1e-6):
        attrs = run(beam(fidelity=fidelity), dt=asked).attrs
        count = EXCITATION.period / attrs["step"]
        assert attrs["step"] <= asked
        assert EXCITATION.period / (round(count) - 1) > asked
        assert count == pytest.approx(round(count), rel=1e-12)


def test_a_share_of_the_critical_step_is_a_step():
    critical = run(beam(fidelity="full")).attrs["critical_step"]
    share, seconds = (run(beam(fidelity="full"), **step) for step in ({"f_dt": 0.66}, {"dt": 0.66 * critical}))
    assert share.attrs["step"] == pytest.approx(0.66 * critical, rel=1e-3)
    np.testing.assert_array_equal(layer(share), layer(seconds))


@BOTH
def test_damping_in_seconds_is_the_share_of_critical_times_the_critical_step(fidelity):
    simulator = beam(fidelity=fidelity)
    critical = run(simulator).attrs["critical_step"]
    share, seconds = run(simulator, beta=0.1), run(simulator, beta=0.0, beta_seconds=0.1 * critical)
    assert apart(seconds, share) < 1e-9
    assert share.attrs["stable_step"] == pytest.approx(seconds.attrs["stable_step"], rel=1e-12)
    assert share.attrs["stable_step"] == pytest.approx(critical * (math.sqrt(1.01) - 0.1), rel=1e-9)


def test_contact_stiffness_by_mass_grows_as_the_step_shrinks():
    by_mass = {"contact_stiffness": "mass_dt", "fidelity": "full"}
    depth = [run(beam(**by_mass), f=1e-4, dt=dt).attrs["penetration_max"] for dt in (1.7e-6, 0.85e-6)]
    bulk = [run(beam(fidelity="full"), f=1e-4, dt=dt).attrs["penetration_max"] for dt in (1.7e-6, 0.85e-6)]
    assert depth[1] < 0.7 * depth[0]
    assert bulk[1] == pytest.approx(bulk[0], rel=0.05)


def test_a_lagged_damper_departs_from_the_implicit_one_with_the_damping():
    slight, strong = (
        apart(run(beam(fidelity="full", damper="lagged"), c_con=c), run(beam(fidelity="full"), c_con=c))
        for c in (0.02, 2.0)
    )
    assert slight < strong < 0.05


@BOTH
def test_contact_that_may_pull_holds_on_longer(fidelity):
    clipped, pulling = (run(beam(fidelity=fidelity, clipped=clipped)) for clipped in (True, False))
    assert clipped.contact_force.min() == 0.0
    assert pulling.contact_force.min() < 0.0


@BOTH
def test_without_a_drive_nothing_moves(fidelity):
    record = run(beam(fidelity=fidelity), amplitude=0.0)
    assert not layer(record).any()
    assert record.attrs["contact_fraction"] == 0.0
    assert record.attrs["stationary"] == 1


def test_a_drive_that_no_beam_bears_diverges():
    for fidelity in ("reduced", "full"):
        record = attempt(beam(fidelity=fidelity), amplitude=1e4)
        assert record.attrs["status"] in ("diverged", "unstable step")
        assert "grew beyond" in record.attrs["reason"]


@BOTH
def test_a_budget_counts_steps(fidelity):
    budget = {"reduced": 2000, "full": 20_000}[fidelity]
    record = attempt(beam(fidelity=fidelity), request=Request(periods=2, samples=50, step_budget=budget))
    assert record.attrs["status"] == "step budget"
    assert f"{budget} steps" in record.attrs["reason"]


@BOTH
def test_output_times_are_refused(fidelity):
    with pytest.raises(CalibError, match="periods and samples"):
        run(beam(fidelity=fidelity), request=Request(times=np.linspace(0.0, 1.0, 10)))


@BOTH
def test_a_start_of_the_wrong_size_is_refused(fidelity):
    with pytest.raises(CalibError, match="numbers, got 3"):
        run(beam(fidelity=fidelity), request=Request(initial_state=np.zeros(3)))


def test_an_arched_layer_is_stiffer_than_a_straight_one():
    for fidelity in ("reduced", "full"):
        straight, arched = (run(beam(fidelity=fidelity, layer=kind), **CLEAR) for kind in ("straight", "arched"))
        assert apart(arched, straight) > 1e-3
    assert apart(run(beam(layer="arched"), **CLEAR), arched) < 1e-2


# --- laws, in both kernels


@contact
def glue(place, clearance, rate, pressure, p):
    """Return a pull [Pa] between sides nearer than p[1]."""
    return -p[0] if clearance < p[1] else 0.0


@excitation
def doubled(t, phase, amplitude, x, p):
    """Return a second harmonic of the drive; p[0] is its share of the amplitude."""
    return p[0] * amplitude * math.cos(2.0 * phase)


def changes(effect, bodies=None, **values):
    """Change of the layer's displacement (n,) by an effect, in the reduced kernel and in the full one  [m]."""
    effect = Effect(effect.name, effect.site, effect.law, effect.parameters, effect.meaning, bodies=bodies)
    plain = {name: value for name, value in values.items() if name in VALUES}
    for fidelity in ("reduced", "full"):
        simulator = beam(fidelity=fidelity, modes=40, steps=2048)
        yield layer(run(simulator, effect, **values))[0] - layer(run(simulator, **plain))[0]


def size(x):
    return np.sqrt(np.mean(x**2))


def of(name, site, law, *parameters):
    return Effect(name, site, law, tuple(Parameter(p, "1", 0.0, p, null=0.0) for p in parameters), meaning=name)


DOUBLED = of("doubled", "excitation", doubled, "h2")


@pytest.mark.parametrize(
    ("effect", "bodies", "values", "within"),
    [
        (AIR_DRAG, None, {"c2": 40.0}, 0.02),
        (AIR_DRAG, ("layer",), {"c2": 40.0}, 0.02),
        (AIR_DRAG, None, {"c2": 40.0, **CLEAR}, 0.002),
        (GAP_OFFSET, None, {"dg": -4e-4}, 0.02),
        (DOUBLED, None, {"h2": 0.02}, 0.02),
        (DOUBLED, None, {"h2": 0.02, **CLEAR}, 0.002),
        (of("glue", "contact", glue, "pull", "reach"), None, {"pull": 2e4, "reach": 2e-3, "s": 4.5e-3}, 0.1),
    ],
    ids=["drag", "on the layer", "drag in flight", "gap", "harmonic", "harmonic in flight", "adhesion"],
)
def test_an_effect_changes_both_kernels_alike(effect, bodies, values, within):
    reduced, full = changes(effect, bodies, **values)
    assert size(full) > 1e-6
    assert size(reduced - full) < within * size(full)


@BOTH
def test_drag_takes_amplitude_the_layer_s_share_of_it_less(fidelity):
    on_layer = Effect("layer_drag", "force", AIR_DRAG.law, AIR_DRAG.parameters, "drag", bodies=("layer",))
    free, braked, partly = (
        amplitude(run(beam(fidelity=fidelity), effect, **CLEAR, c2=c2))
        for effect, c2 in ((AIR_DRAG, 0.0), (AIR_DRAG, 50.0), (on_layer, 50.0))
    )
    assert braked < free
    assert partly < free
    assert partly != braked


@BOTH
def test_a_gap_offset_is_a_shift(fidelity):
    offset, shifted = run(beam(fidelity=fidelity), GAP_OFFSET, dg=-3e-4), run(beam(fidelity=fidelity), s=2.9e-3)
    np.testing.assert_allclose(layer(offset), layer(shifted), rtol=0, atol=1e-12)


@BOTH
def test_a_second_harmonic_shows_in_the_driven_point(fidelity):
    record = run(beam(fidelity=fidelity), DOUBLED, h2=0.05)
    x = record.displacement.sel(body="beam").values
    angle = 2.0 * np.pi * EXCITATION.frequency * record.time.values
    drive = EXCITATION.amplitude * (np.cos(angle) + 0.05 * np.cos(2.0 * angle))
    np.testing.assert_allclose(x, drive, rtol=0, atol=1e-4 * EXCITATION.amplitude)


def test_a_force_law_with_internal_states_is_refused_before_any_run():
    lag = Effect("falter", "force", force(states=1)(falter_plain), (Parameter("k", "1/s", 0.0, "k", null=0.0),), "lag")
    with pytest.raises(CalibError, match="internal states"):
        Model(beam(), [lag])


def falter_plain(t, x, v, p, z, dz):
    """Return a force per unit mass that lags behind the velocity [m/s^2]."""
    dz[0] = v - z[0]
    return -p[0] * z[0]


# --- the record


@BOTH
def test_the_record_tells_of_contact(fidelity):
    record = run(beam(fidelity=fidelity))
    attrs, share = record.attrs, record.contact_share
    assert attrs["fidelity"] == fidelity
    assert attrs["source"] == f"delaminated_beam, {fidelity}"
    assert attrs["stationary"] == 1
    assert 0 < attrs["settled_periods"] < 50
    assert attrs["prescribed"] == "beam.displacement,beam.velocity"
    assert share.contact_place.values[[0, -1]].tolist() == [0.0, 1.0]
    assert ((share >= 0.0) & (share <= 1.0)).all()
    assert share.max() <= attrs["contact_fraction"] <= share.sum()
    assert attrs["centre_impacts"] in (1.0, 2.0)
    assert record.impact_time.size >= 2
    assert ((record.impact_time >= 0.0) & (record.impact_time < 2.0 * EXCITATION.period)).all()
    assert (record.impact_speed > 0.0).all()
    assert attrs["contact_force_max"] > record.contact_force.max() > 0.0
    assert ("modes" in attrs) == (fidelity == "reduced")
    if fidelity == "reduced":
        assert (attrs["modes"], attrs["steps_per_period"], attrs["parts"]) == (40, 512, 16)


def test_contact_force_and_impulse_of_the_kernels_agree():
    impulse = [
        float(run(beam(fidelity=f, modes=40, steps=2048)).contact_force.mean()) * EXCITATION.period
        for f in ("reduced", "full")
    ]
    assert impulse[0] == pytest.approx(impulse[1], rel=0.03)


def test_both_kernels_have_the_same_motion():
    full = run(beam(fidelity="full"))
    assert apart(run(beam()), full) < 0.02
    assert apart(run(beam(modes=40, steps=2048)), full) < 0.01


@BOTH
def test_settling_is_the_first_periods_dropped(fidelity):
    short, long = (run(beam(fidelity=fidelity), request=Request(periods=p, samples=50, settle=s))
                   for p, s in ((2, 3), (5, 0)))  # fmt: skip
    atol = 1e-9 if fidelity == "full" else 1e-6  # the reduced kernel begins each period without contact forces
    np.testing.assert_allclose(layer(short), layer(long)[:, 150:], rtol=0, atol=atol)
    assert short.attrs["settled_periods"] == 3


def test_a_motion_that_does_not_return_is_recorded_and_says_so():
    record = run(beam(settle_limit=2), alpha=5.0)
    assert record.attrs["stationary"] == 0
    assert "no stationary state within 2 periods" in record.attrs["reason"]
    assert run(beam(settle_limit=2), alpha=5.0, request=Request(periods=1, samples=20, settle=2)).attrs["reason"] == ""


@BOTH
def test_a_record_is_read_as_it_was_written(fidelity, tmp_path):
    record = run(beam(fidelity=fidelity))
    records.write(record, tmp_path / "beam.nc")
    again = records.read(tmp_path / "beam.nc")
    for name in record.variables:
        np.testing.assert_array_equal(again[name].values, record[name].values)
    assert again.attrs["stationary"] == 1
    assert again.attrs["stable_step"] == record.attrs["stable_step"]


@pytest.mark.slow
def test_a_child_process_gives_the_same_bits(tmp_path):
    code = (
        "import sys, pickle; from calib import records; simulator, path = pickle.load(sys.stdin.buffer), sys.argv[1];"
        "from short_beam import run; records.write(run(simulator), path)"
    )
    subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "child.nc")],
        input=pickle.dumps(beam()), env=environment(), check=True,
    )  # fmt: skip
    child = records.read(tmp_path / "child.nc")
    for channel in STATE:
        np.testing.assert_array_equal(child[channel].values, run(beam())[channel].values)


# --- commands

STUDY = """\
[study]
name = "short beam"
seed = 1
budget = 20
jobs = 1

[[record]]
name = "bench"
path = "bench.nc"

[model]
simulator = "delaminated_beam"
options = {options}
fixed = {fixed}

[windows]
alpha = {{ low = "400 1/s", high = "1600 1/s" }}

[[term]]
feature = "phase_curve"
bodies = ["layer"]

[optimiser]
name = "multistart"
"""


def calib(*arguments, code=0):
    ended = CliRunner().invoke(main, [str(a) for a in arguments])
    assert ended.exit_code == code, ended.output
    return ended


def toml(options):
    return "{ " + ", ".join(f"{key} = {json.dumps(value)}" for key, value in options.items()) + " }"


@pytest.fixture
def study(tmp_path):
    bench = run(beam()).drop_vars(["section_displacement", "section_velocity"])
    records.write(bench, tmp_path / "bench.nc")
    fixed = toml({name: value for name, value in VALUES.items() if name != "alpha"})
    path = tmp_path / "study.toml"
    path.write_text(STUDY.format(options=toml({**MESH, "fidelity": "auto"}), fixed=fixed))
    return path


def test_a_study_s_beam_can_be_simulated(study):
    said = calib("simulate", study, "--set", "alpha=800 1/s", "-o", study.parent / "loop.nc").stdout
    assert "displacement of layer: amplitude" in said
    record = records.read(study.parent / "loop.nc")
    assert record.attrs["fidelity"] == "reduced"
    assert record.attrs["stationary"] == 1


def test_the_list_tells_of_its_parameters_and_options():
    said = calib("list", "delaminated_beam").stdout
    assert [row[0] for row in cells(said) if row[0]] == [p.name for p in DelaminatedBeam().parameters]
    [options] = [line for line in said.splitlines() if line.startswith("options: ")]
    assert "fidelity = 'reduced'" in options
    assert "settle_limit = 200" in options


@pytest.mark.slow
def test_a_record_accounts_for_the_energy_of_a_period():
    record, plain = run(beam(fidelity="full", balance=True)), run(beam(fidelity="full"))
    work = record.attrs["work_of_drive"]
    lost = [record.attrs[name] for name in ("lost_to_alpha", "lost_to_beta", "lost_in_contact")]
    assert min(work, *lost) > 0.0
    assert work == pytest.approx(sum(lost) + record.attrs["energy_gained"], abs=1e-4 * work)
    assert abs(record.attrs["energy_unaccounted"]) < 1e-4 * work
    np.testing.assert_array_equal(layer(record), layer(plain))
    with pytest.raises(CalibError, match="full kernel"):
        beam(balance=True)


def test_made_finer_it_takes_more_steps_where_they_are_stated_too():
    stated, unstated = DelaminatedBeam(steps=96), DelaminatedBeam()
    assert stated.finer("time_step", 2.0).levels[0].steps == 192
    assert stated.finer("time_step", 2.0).finer("time_step", 2.0).levels[0].steps == 384
    assert unstated.finer("time_step", 2.0).levels == unstated.levels[1:]
