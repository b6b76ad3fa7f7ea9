"""Values at which an effect cannot act are failures that name them; nothing switches an effect off in silence."""

import math

import numpy as np
import pytest

from calib import plugins
from calib.modelling.effect import Effect
from calib.modelling.laws import force, restitution
from calib.modelling.model import Model
from calib.modelling.parameter import ABOVE_ZERO, Parameter
from calib.modelling.simulator import Request
from calib.records.excitation import Excitation
from calib.simulators.oscillator import Oscillator

EFFECTS = plugins.load_all("calib.effects")
DECAY = Excitation("mass", "free decay")
DECAYING = {"mass": 1.0, "damping": 0.0, "stiffness": 900.0, "initial_displacement": -1e-2, "gap": 1e-3}
FORCE = Excitation("mass", "force", frequency=5.0, amplitude=6.0)
REQUEST = Request(times=np.linspace(0.0, 1.0, 51))
SCALES = [
    ("coulomb_friction", "friction", "friction_slip"),
    ("presliding", "dahl_force", "dahl_distance"),
    ("bouc_wen", "hysteresis_force", "hysteresis_distance"),
    ("iwan", "iwan_force", "iwan_distance"),
    ("stribeck", "stribeck_force", "stribeck_distance"),
    ("stribeck", "stribeck_force", "stribeck_speed"),
    ("fractional_damping", "fractional_stiffness", "fractional_frequency"),
    ("extra_mode", "mode_mass", "mode_frequency"),
    ("rate_restitution", "rate_exponent", "rate_speed"),
    ("phase_jitter", "jitter_sin", "jitter_frequency"),
]  # effect, its size, a parameter of it that is above zero


@force
def divided(t, x, v, p, z, dz):
    return -p[0] * v / p[1]


@restitution
def undefined(e, speed, p):
    return p[0] * (speed - speed) / p[1]


def run(name, excitation=DECAY, request=REQUEST, **values):
    return Model(Oscillator(stop=True), [EFFECTS[name]]).run({**DECAYING, **values}, excitation, request)


def ended(record):
    return record.attrs["status"], record.attrs["reason"]


@pytest.mark.parametrize(("name", "size", "scale"), SCALES)
def test_a_scale_of_zero_is_impossible(name, size, scale):
    status, reason = ended(run(name, **{size: 0.1, scale: 0.0}))
    assert (status, reason.startswith(f"{scale} is 0, outside (0, inf)")) == ("impossible value", True)


@pytest.mark.parametrize(("name", "size", "scale"), SCALES)
def test_a_scale_of_an_absent_effect_does_not_matter(name, size, scale):
    assert run(name, **{size: 0.0, scale: 0.0}).attrs["status"] == "ok"


@pytest.mark.parametrize(
    ("name", "values", "expected"),
    [
        ("rate_restitution", {"rate_exponent": math.nan}, "rate_exponent is nan"),
        ("velocity_lowpass", {"lowpass": -1e-2}, "lowpass is -0.01, outside [0, inf) s"),
        ("linear_drag", {"c1": math.inf}, "c1 is inf"),
        ("velocity_differencing", {"differencing": 1.5}, "differencing is 1.5, outside [0, 1] 1"),
        ("drive_harmonic_3", {"h3_cos": math.nan}, "h3_cos is nan"),
        ("added_mass", {"added_mass": -2.0}, "added_mass is -2, outside [-0.999, inf) 1"),
        ("squeeze_film", {"squeeze": 0.1, "gap": 0.0}, "gap is 0; effect 'squeeze_film' needs it above 0"),
        ("squeeze_film", {"squeeze": 0.1, "gap": -1e-3}, "gap is -0.001; effect 'squeeze_film' needs it above 0"),
    ],
)
def test_a_value_that_an_effect_cannot_act_at_is_named(name, values, expected):
    assert ended(run(name, **values)) == ("impossible value", expected)
    with pytest.raises(ValueError, match=expected.partition(",")[0]):
        Model(Oscillator(stop=True), [EFFECTS[name]]).period_map({**DECAYING, **values}, FORCE)


def test_an_infinite_null_is_a_value_that_an_effect_has():
    assert run("clipping", clip_velocity=1e-3).attrs["status"] == "ok"  # its displacement is clipped at infinity


@pytest.mark.parametrize(("site", "law"), [("force", divided), ("restitution", undefined)])
def test_a_law_that_divides_by_zero_ends_the_run(site, law):
    parameters = (Parameter("size", "1", 0.0, "of it", null=0.0), Parameter("scale", "1", 1.0, "of it"))
    model = Model(Oscillator(stop=True), [Effect("singular", site, law, parameters, "a law without a bound")])
    plain = model.run({**DECAYING, "size": 0.1}, DECAY, REQUEST)
    assert (plain.attrs["status"], plain.sizes["impact"] > 0) == ("ok", True)
    assert model.run({**DECAYING, "size": 0.1, "scale": 0.0}, DECAY, REQUEST).attrs["status"] == "diverged"


@pytest.mark.parametrize("delay", [0.0, 1e-4])
def test_a_controller_without_delay_is_a_spring_and_a_damper(delay):
    values = {"mass": 2.0, "damping": 1.0, "stiffness": 900.0, "initial_displacement": 0.0, "initial_velocity": 0.2}
    fed = {"feedback_stiffness": 100.0, "feedback_damping": 3.0, "feedback_delay": delay}
    found = Model(Oscillator(), [EFFECTS["delayed_feedback"]]).run({**values, **fed}, DECAY, REQUEST)
    stiffer = {**values, "stiffness": 900.0 + 2.0 * 100.0, "damping": 1.0 + 2.0 * 3.0}
    expected = Model(Oscillator()).run(stiffer, DECAY, REQUEST)
    size = float(np.abs(expected.displacement).max())
    np.testing.assert_allclose(found.displacement, expected.displacement, rtol=0, atol=(1e-8 + 30.0 * delay) * size)


@pytest.mark.parametrize("gap", [1e-3, -1e-3])
@pytest.mark.parametrize("clearance", [2e-3, 1e-4, 0.0, -1e-4])
@pytest.mark.parametrize("rate", [0.1, -0.1])
def test_a_film_takes_energy_whatever_the_gap(gap, clearance, rate):
    law = EFFECTS["squeeze_film"].law.function
    assert law(0.0, clearance, rate, np.array([0.05, gap]), np.zeros(4), np.zeros(4)) * rate < 0.0


def test_parameters_that_divide_do_not_have_zero():
    slip = next(p for p in EFFECTS["coulomb_friction"].parameters if p.name == "friction_slip")
    assert (slip.low, slip.interval) == (ABOVE_ZERO, "(0, inf)")
    assert [slip.admits(value) for value in (-1e-3, 0.0, math.nan, math.inf, 1e-9)] == [False] * 4 + [True]
