"""The effects that come with calib pass the suite that is given to others."""

import numpy as np
import pytest
import short_beam

from calib import plugins
from calib.errors import CalibError
from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.records import record
from calib.records.excitation import Excitation
from calib.simulators.delaminated_beam import DelaminatedBeam
from calib.simulators.delaminated_beam.drive import centre_displacement
from calib.simulators.four_dof import FourDof
from calib.simulators.oscillator import Oscillator
from calib.testing import EffectSuite

EFFECTS = plugins.load_all("calib.effects")
SHORT = Request(periods=2, samples=100, settle=1)
FORCE = Excitation("mass", "force", frequency=5.0, amplitude=5.0)


class Fixed:
    """A motion without any physics: what sensors see."""

    name = "fixed"
    bodies = ("q2", "q3")
    parameters = ()
    sites = frozenset()

    def run(self, values, excitation, laws, request):
        phase = 2.0 * np.pi * np.arange(request.periods * request.samples) / request.samples
        x = np.array([1e-3 * np.cos(phase), 2e-3 * np.cos(phase - 0.3) + 3e-4 * np.sin(3.0 * phase)])
        v = -np.array([1e-3 * np.sin(phase), 2e-3 * np.sin(phase - 0.3) - 9e-4 * np.cos(3.0 * phase)])
        v *= 2.0 * np.pi * excitation.frequency
        time = phase / (2.0 * np.pi * excitation.frequency)
        return record.make(time, self.bodies, {"displacement": x, "velocity": v}, frequency=excitation.frequency)


class Case:
    """Where an effect is tried, and the size at which it is present."""

    def __init__(
        self, name, *, on=FourDof, excitation=EffectSuite.excitation, base=None, request=None, least=1e-6, **at
    ):
        self.effect = EFFECTS[name]
        self.on, self.excitation, self.values = on, excitation, EffectSuite.values if base is None else base
        self.request, self.least, self.present = request or SHORT, least, at


def sensed(name, **at):
    return Case(name, on=Fixed, base={}, **at)


def on_oscillator(name, **at):
    return Case(name, on=Oscillator, excitation=FORCE, base={}, **at)


def full_beam():
    return short_beam.beam(fidelity="full")


def coarse():
    return FourDof(mode="fixed_step")


CENTRE = Excitation("centre", "displacement", frequency=36.0, amplitude=1e-3)
BEAM = {
    "on": full_beam,
    "excitation": short_beam.EXCITATION,
    "base": {**short_beam.VALUES, "g_max": 2e-3, "s": 1.5e-3},
    "request": Request(periods=2, samples=100, settle=0),
}
CASES = [
    Case("linear_drag", c1=1.0),
    Case("quadratic_drag", c2=0.5),
    Case("coulomb_friction", friction=0.1, friction_slip=3e-3),
    Case("presliding", dahl_force=0.1, dahl_distance=1e-3),
    on_oscillator("bouc_wen", hysteresis_force=0.5, hysteresis_distance=0.03),
    on_oscillator("iwan", iwan_force=0.5, iwan_distance=0.03),
    on_oscillator("stribeck", stribeck_force=0.5, stribeck_distance=0.01, stribeck_speed=0.5),
    Case("power_law_damping", power_damping=0.1),
    on_oscillator("fractional_damping", fractional_stiffness=200.0, fractional_frequency=5.0),
    Case("damping_drift", damping_rise=5.0),
    Case("magnetic_attraction", magnet_strength=1e-6, magnet_distance=5e-3),
    on_oscillator("delayed_feedback", feedback_stiffness=-200.0, feedback_damping=0.5, feedback_delay=0.02),
    Case("cubic_stiffness", k3=1e9),
    Case("quadratic_stiffness", k2=1e6),
    Case("softening", kx=1e6),
    Case("preload", preload=1.0),
    Case("support", support_stiffness=500.0, support_damping=1.0),
    Case("glue_bond", bond=0.05),
    Case("added_mass", added_mass=0.02),
    Case("detuning_drift", detuning=1e4),
    Case("extra_mode", mode_mass=0.01, mode_frequency=80.0),
    Case("drive_harmonic_2", h2_cos=0.02, h2_sin=0.01),
    Case("drive_harmonic_3", h3_cos=0.02, h3_sin=0.01),
    Case("drive_modulation", modulation=0.1),
    Case("frequency_drift", chirp=0.1),
    Case("phase_jitter", jitter_sin=0.02, jitter_cos=0.01, jitter_frequency=10.0),
    Case("backlash", backlash_stiffness=300.0, backlash_width=5e-4, backlash_force=1.0),
    Case("gap_offset", dg=1e-4),
    Case("interface_shift", **BEAM, interface_shift=1e-4),
    Case("adhesion", adhesion=1e-5),
    Case("rate_restitution", rate_exponent=0.1),
    Case("compliant_contact", contact_time=5e-4),
    Case("hertz_contact", contact_time=5e-4),
    Case("contact_compliance", **BEAM, hunt_crossley=0.3),
    Case("squeeze_film", squeeze=0.01),
    sensed("channel_gain", gain_displacement=0.02, gain_velocity=-0.01),
    sensed("channel_nonlinearity", cubic_displacement=3e3, cubic_velocity=1.0),
    sensed("channel_offset", offset_displacement=1e-4, offset_velocity=1e-2),
    sensed("channel_drift", drift_displacement=1e-3, drift_velocity=0.1),
    sensed("channel_lag", lag=1e-4),
    sensed("velocity_lowpass", lowpass=1e-4),
    sensed("velocity_differencing", differencing=1.0),
    sensed("plot_shear", shear=1e-4),
    sensed("plot_scale", plot_scale=0.02),
    sensed("axis_tilt", tilt=0.02),
    sensed("clipping", clip_displacement=8e-4, clip_velocity=0.1),
    sensed("quantisation", quantum_displacement=1e-4, quantum_velocity=1e-2),
    sensed("outliers", outlier_share=0.01),
    Case("residual_compliance", residual_compliance=-1e-5),
    Case("response_lag", response_lag=1e-3),
    Case("time_step", on=coarse, refinement=2.0),
    Case("event_tolerance", tolerance_refinement=10.0, base={"restitution": 0.3, "gap": 2e-4}, least=0.0),
]


YIELDING = {"compliant_contact", "hertz_contact"}  # a kernel of its own, long to compile, serves them


def cases(yielding):
    own = [case for case in CASES if (case.effect.name in YIELDING) == yielding]
    return pytest.mark.parametrize("case", own, ids=[case.effect.name for case in own])


class Tried(EffectSuite):
    @pytest.fixture(autouse=True)
    def tried(self, case):
        self.on(case)

    def on(self, case):
        for name in ("effect", "present", "excitation", "values", "request", "least"):
            setattr(self, name, getattr(case, name))
        self.make = case.on
        return self


@cases(yielding=False)
class TestEffects(Tried):
    pass


@cases(yielding=True)
class TestStopsThatYield(Tried):
    test_it_shows_where_it_is_present = None  # `simulators/test_uncompiled_contact.py` has it without compiling


def test_every_registered_effect_is_tried():
    assert {case.effect.name for case in CASES} == set(plugins.names("calib.effects"))


@pytest.mark.parametrize("name", [name for name, effect in EFFECTS.items() if effect.transient])
def test_what_is_explicit_in_time_has_no_part_in_a_motion_that_has_settled(name):
    excitation = Excitation("end", "displacement", frequency=26.24, amplitude=1.5e-3)
    (case,) = (case for case in CASES if case.effect.name == name)
    plain = Model(FourDof()).run({}, excitation, SHORT)
    settled = Model(FourDof(), [EFFECTS[name]]).run(case.present, excitation, SHORT)
    np.testing.assert_array_equal(settled.velocity, plain.velocity)


def test_the_file_of_an_effect_has_its_name_and_what_it_is_confused_with_is_known():
    assert len(EFFECTS) >= 50
    for name, effect in EFFECTS.items():
        assert effect.name == name
        assert set(effect.confused) <= set(EFFECTS) - {name}


def law_of(name, **values):
    effect = EFFECTS[name]
    return effect.law.function, effect.bound({p.name: p.nominal for p in effect.parameters} | values).p


@pytest.mark.parametrize(
    ("name", "values"),
    [("linear_drag", {"c1": 2.0}), ("quadratic_drag", {"c2": 2.0}), ("coulomb_friction", {"friction": 1.0})],
)
def test_drag_and_friction_oppose_the_motion(name, values):
    law, p = law_of(name, **values)
    forward, back = (law(0.0, 0.0, v, p, np.zeros(4), np.zeros(4)) for v in (0.5, -0.5))
    assert forward < 0.0
    assert back == pytest.approx(-forward)


def test_dahl_friction_slips_at_its_force():
    law, p = law_of("presliding", dahl_force=2.0, dahl_distance=1e-4)
    z, dz = np.zeros(4), np.zeros(4)
    for _ in range(20_000):
        law(0.0, 0.0, 1.0, p, z, dz)
        z += 1e-7 * dz
    assert law(0.0, 0.0, 1.0, p, z, dz) == pytest.approx(-2.0, rel=1e-6)


def test_a_mount_with_play_is_silent_within_it_and_slides_at_its_force():
    law, p = law_of("backlash", backlash_stiffness=1e4, backlash_width=1e-4, backlash_force=2.0)
    z, dz = np.zeros(4), np.zeros(4)
    assert law(0.0, 0.9e-4, 1.0, p, z, dz) == 0.0
    assert law(0.0, 2e-4, 1.0, p, z, dz) == pytest.approx(-1.0)
    assert dz[0] == 0.0
    assert law(0.0, 4e-4, 1.0, p, z, dz) == pytest.approx(-3.0)
    assert dz[0] == 1.0
    law(0.0, 4e-4, -1.0, p, z, dz)
    assert dz[0] == 0.0


def test_a_film_of_air_resists_the_more_the_narrower_the_gap_down_to_its_floor():
    effect = EFFECTS["squeeze_film"]
    p = effect.bound({"squeeze": 0.1, "gap": 1e-3}, {"interface": ("interface",)}).p
    at = [effect.law.function(0.0, x, -0.1, p, p, p) for x in (1e-3, 5e-4, 2e-5, 1e-5, -1e-5)]
    assert at[:3] == pytest.approx([0.01, 0.08, 1250.0])
    assert at[3:] == pytest.approx([1250.0, 1250.0])


def test_restitution_falls_with_speed_and_slow_impacts_stick():
    falling, p = law_of("rate_restitution", rate_exponent=0.25, rate_speed=2.0)
    assert 0.4 + falling(0.4, 2.0, p) == pytest.approx(0.4)
    assert 0.4 + falling(0.4, 32.0, p) == pytest.approx(0.2)
    held, p = law_of("adhesion", adhesion=0.01)
    assert 0.5 + held(0.5, 1.0, p) == pytest.approx(np.sqrt(0.24))
    assert 0.5 + held(0.5, 0.1, p) == 0.0


@pytest.mark.slow
@pytest.mark.parametrize(("name", "contact"), [("compliant_contact", "kelvin_voigt"), ("hertz_contact", "gonthier")])
def test_a_stop_that_yields_is_the_contact_of_the_simulator_and_comes_near_newton_as_it_shortens(name, contact):
    driven = EffectSuite.excitation, EffectSuite.request
    values, changes = EffectSuite.values, []
    model, stated = Model(FourDof(), [EFFECTS[name]]), Model(FourDof(contact=contact))
    plain = model.run(values, *driven)
    for time in (4e-5, 2e-5):
        found, expected = (m.run({**values, "contact_time": time}, *driven) for m in (model, stated))
        np.testing.assert_array_equal(found.velocity, expected.velocity)
        changes.append(float(np.abs(found.displacement - plain.displacement).max()))
    assert changes[0] == pytest.approx(2.0 * changes[1], rel=0.1)


@pytest.mark.slow
def test_the_stop_of_an_oscillator_yields_too():
    values, drive = {"contact_time": 1e-2}, Excitation("mass", "force", frequency=4.0, amplitude=4.0)
    found = Model(Oscillator(stop=True), [EFFECTS["compliant_contact"]]).run(values, drive, SHORT)
    expected = Model(Oscillator(stop=True, contact="kelvin_voigt")).run(values, drive, SHORT)
    np.testing.assert_array_equal(found.velocity, expected.velocity)


def test_a_stop_that_yields_and_a_law_of_its_restitution_exclude_one_another():
    model = Model(FourDof(), [EFFECTS["compliant_contact"], EFFECTS["rate_restitution"]])
    record = model.run({"contact_time": 1e-4, "rate_exponent": 0.1}, EffectSuite.excitation, SHORT)
    assert (record.attrs["status"], "'restitution' and 'compliant_contact'" in record.attrs["reason"]) == (
        "impossible value", True,
    )  # fmt: skip
    with pytest.raises(CalibError, match="exclude one another"):
        model.period_map({"contact_time": 1e-4, "rate_exponent": 0.1}, EffectSuite.excitation)
    assert model.run({"rate_exponent": 0.1}, EffectSuite.excitation, SHORT).attrs["status"] == "ok"


# --- instruments


def seen(name, periods=2, samples=100, cut=None, **values):
    """Return what an instrument makes of the fixed motion, and the motion itself; cut off after `cut` samples."""
    effect = EFFECTS[name]
    excitation = EffectSuite.excitation
    plain = Model(Fixed()).run({}, excitation, Request(periods=periods, samples=samples)).isel(time=slice(cut))
    return effect.sense(plain, {p.name: p.nominal for p in effect.parameters} | values), plain


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("channel_lag", {"lag": 2e-3}),
        ("velocity_lowpass", {"lowpass": 5e-3}),
        ("velocity_differencing", {"differencing": 0.7}),
    ],
)
def test_what_has_a_memory_keeps_a_stationary_motion_periodic(name, values):
    found, _ = seen(name, **values)
    v = found.velocity.values
    np.testing.assert_allclose(v[:, :100], v[:, 100:], rtol=0, atol=1e-9 * np.abs(v).max())


def test_a_low_pass_starts_with_the_first_sample_of_any_other_record():
    found, plain = seen("velocity_lowpass", cut=150, lowpass=5e-3)
    assert found.velocity.values[:, 0] == pytest.approx(plain.velocity.values[:, 0])


def test_a_late_channel_of_any_other_record_goes_on_before_it_as_straight_as_it_begins():
    found, plain = seen("channel_lag", cut=150, lag=2e-3)
    v, dt = plain.velocity.values, float(plain.time[1] - plain.time[0])
    assert found.velocity.values[:, 0] == pytest.approx(v[:, 0] - 2e-3 * (v[:, 1] - v[:, 0]) / dt)


def test_differences_of_any_other_record_begin_as_straight_as_they_go_on():
    found, plain = seen("velocity_differencing", cut=150, differencing=1.0)
    slope = np.diff(plain.displacement.values, axis=1) / np.diff(plain.time.values)
    assert found.velocity.values[:, 0] == pytest.approx(2.0 * slope[:, 0] - slope[:, 1])


@pytest.mark.parametrize("per_period", [40, 150, 400, 731.3])
def test_differences_are_of_the_samples_of_the_instruments_however_finely_a_motion_is_simulated(per_period):
    """What a differenced harmonic is: sin(a) / a of itself, and late by a, half a sample in radians."""
    frequency, half = EffectSuite.excitation.frequency, np.pi / per_period
    model = Model(Fixed(), (EFFECTS["velocity_differencing"],))
    request = Request(periods=1, samples=400, interval=1.0 / (per_period * frequency))
    amplitudes = [
        np.fft.rfft(model.run({"differencing": share}, EffectSuite.excitation, request).velocity.values[0])[1]
        for share in (0.0, 1.0)
    ]
    assert amplitudes[1] / amplitudes[0] == pytest.approx(np.sin(half) / half * np.exp(-1j * half), rel=1e-6)


def test_the_low_pass_lags_and_weakens_a_harmonic_as_its_formula_has_it():
    w, tau = 2.0 * np.pi * EffectSuite.excitation.frequency, 3e-3
    found, plain = seen("velocity_lowpass", periods=8, samples=400, lowpass=tau)
    ratio = np.fft.rfft(found.velocity.values[0])[8] / np.fft.rfft(plain.velocity.values[0])[8]
    assert ratio == pytest.approx(1.0 / (1.0 + 1j * w * tau), rel=1e-4)  # linear between samples
    started, _ = seen("velocity_lowpass", periods=8, samples=400, cut=3199, lowpass=tau)
    np.testing.assert_allclose(
        started.velocity.values[:, 2800:],
        found.velocity.values[:, 2800:3199],
        atol=1e-4 * np.abs(found.velocity).max().item(),
    )


@pytest.mark.parametrize("name", [name for name, effect in EFFECTS.items() if effect.site == "sensor"])
@pytest.mark.parametrize("lacking", ["displacement", "velocity"])
def test_an_instrument_leaves_alone_a_channel_that_the_record_lacks(name, lacking):
    effect = EFFECTS[name]
    case = next(case for case in CASES if case.effect is effect)
    plain = seen("plot_scale")[1].drop_vars(lacking)
    found = effect.sense(plain, {p.name: p.nominal for p in effect.parameters} | case.present)
    assert set(found.data_vars) == set(plain.data_vars) >= {"displacement", "velocity"} - {lacking}
    assert all(found[channel].attrs == plain[channel].attrs for channel in found.data_vars)


def test_starting_values_are_read_off_a_clipped_and_a_stepped_record():
    clipped, _ = seen("clipping", clip_displacement=8e-4, clip_velocity=0.1)
    found = EFFECTS["clipping"].guess(clipped)
    assert {name: sizes[0] for name, sizes in found.items()} == pytest.approx(
        {"clip_displacement": 8e-4, "clip_velocity": 0.1}
    )
    stepped, _ = seen("quantisation", quantum_displacement=1e-4)
    found = EFFECTS["quantisation"].guess(stepped)
    assert found["quantum_displacement"] == pytest.approx((1e-4,))
    assert "quantum_velocity" not in found


def test_a_gap_s_height_that_becomes_a_shift_leaves_the_middle_as_wide():
    effect = EFFECTS["interface_shift"]
    new = effect.restructure({"g_max": 3e-4, "s": 7e-4}, {"interface_shift": 1e-4})
    assert new == pytest.approx({"g_max": 2e-4, "s": 8e-4})


# --- numerics


def test_a_finer_fixed_step_is_one_of_more_steps_per_period():
    model = Model(FourDof(mode="fixed_step", steps_per_period=500.0), [EFFECTS["time_step"]])
    twice = Model(FourDof(mode="fixed_step", steps_per_period=1000.0))
    found, expected = (
        m.run({"restitution": 0.05, **v}, EffectSuite.excitation, SHORT)
        for m, v in ((model, {"refinement": 2.0}), (twice, {}))
    )
    np.testing.assert_array_equal(found.displacement, expected.displacement)


def test_a_finer_step_and_tolerance_reach_the_kernel():
    values = {p.name: p.nominal for p in FourDof.parameters}
    law = EFFECTS["quadratic_drag"].bound({"c2": 0.5})
    plain = FourDof().problem(values, EffectSuite.excitation, [law])
    finer = (
        FourDof().finer("time_step", 4.0).finer("event_tolerance", 2.0).problem(values, EffectSuite.excitation, [law])
    )
    assert (plain.step / finer.step, plain.resolution / finer.resolution, plain.height / finer.height) == (
        4.0,
        2.0,
        2.0,
    )


def test_a_finer_oscillator_differs_within_the_error_of_its_steps():
    simulator, law = Oscillator(stop=True), EFFECTS["quadratic_drag"]
    plain, finer = (
        Model(s, [law]).run({"c2": 5.0, "restitution": 0.3}, FORCE, SHORT)
        for s in (simulator, simulator.finer("time_step", 4.0))
    )
    assert (plain.displacement.values != finer.displacement.values).any()
    np.testing.assert_allclose(finer.displacement, plain.displacement, rtol=0, atol=1e-9)


def test_a_finer_beam_takes_the_next_level_or_half_the_step():
    beam = DelaminatedBeam(tolerance=0.01)
    assert beam.finer("time_step", 2.0).levels == beam.levels[1:]
    assert beam.finer("time_step", 64.0).levels == beam.levels[2:]
    full = DelaminatedBeam(fidelity="auto")
    values = {p.name: p.nominal for p in full.parameters}
    steps = [
        b.confirming._case(values, centre_displacement(CENTRE), ()).count for b in (full, full.finer("time_step", 2.0))
    ]
    assert steps[1] == pytest.approx(2 * steps[0], abs=1)
