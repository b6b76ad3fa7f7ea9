"""Force effects against scipy's DOP853, which sees the same laws and shares nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from simulators.four_dof_peer import dop853

from calib import plugins
from calib.modelling.laws import STATES
from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.records.excitation import Excitation
from calib.simulators.four_dof import FourDof
from calib.simulators.four_dof.lumped import lumped
from calib.simulators.impact import kernel
from calib.simulators.impact.initial_state import start
from calib.simulators.impact.problem import IMPACTS
from calib.simulators.impact.scratch import scratch
from calib.simulators.oscillator import Oscillator

EFFECTS = plugins.load_all("calib.effects")
VALUES = {
    "linear_drag": {"c1": 2.0},
    "quadratic_drag": {"c2": 0.5},
    "coulomb_friction": {"friction": 0.1, "friction_slip": 0.05},
    "presliding": {"dahl_force": 0.5, "dahl_distance": 5e-4},
    "cubic_stiffness": {"k3": 2e9},
    "quadratic_stiffness": {"k2": 1e6},
    "softening": {"kx": 2e6},
    "preload": {"preload": 2.0},
    "support": {"support_stiffness": 900.0, "support_damping": 3.0},
    "extra_mode": {"mode_mass": 0.05, "mode_frequency": 80.0, "mode_damping": 0.02},
    "backlash": {"backlash_stiffness": 2e3, "backlash_width": 3e-4, "backlash_force": 1.0},
    "squeeze_film": {"squeeze": 0.02},
    "bouc_wen": {
        "hysteresis_force": 0.5,
        "hysteresis_distance": 5e-4,
        "hysteresis_exponent": 1.5,
        "hysteresis_shape": 0.6,
    },
    "iwan": {"iwan_force": 0.5, "iwan_distance": 8e-4, "iwan_exponent": -0.4, "iwan_ratio": 0.6},
    "stribeck": {
        "stribeck_force": 0.3,
        "stribeck_distance": 4e-4,
        "stribeck_rise": 0.5,
        "stribeck_speed": 0.05,
    },
    "power_law_damping": {"power_damping": 0.3, "power_exponent": 1.5},
    "fractional_damping": {"fractional_stiffness": 500.0, "fractional_order": 0.4, "fractional_frequency": 20.0},
    "magnetic_attraction": {"magnet_strength": 3e-6, "magnet_distance": -6e-3},
    "delayed_feedback": {"feedback_stiffness": 300.0, "feedback_damping": -0.5, "feedback_delay": 8e-3},
}
MIXED = [
    ("presliding", "extra_mode", "squeeze_film", "quadratic_drag"),
    ("backlash", "cubic_stiffness", "linear_drag", "preload"),
    ("coulomb_friction", "softening", "quadratic_stiffness", "squeeze_film"),
    ("bouc_wen", "fractional_damping", "power_law_damping", "magnetic_attraction"),
    ("iwan", "stribeck", "delayed_feedback"),
]
MANY_STATES = MIXED[3:]
BODY = "q3"


class Laws:
    """Laws as a peer takes them: with their numbers, the bodies they act on, and where their states begin."""

    def __init__(self, names, own, places):
        self.parts, self.inner = [], 0
        for name in names:
            effect = EFFECTS[name]
            law = effect.bound({**VALUES[name], **own}, places)
            for body in law.bodies or places["body"]:
                self.parts.append((law, body, self.inner))
                self.inner += law.states

    def __call__(self, t, motion, z):
        """Accelerations by body of `motion`, body -> (x, v), and the rates of all states."""
        found, rates = dict.fromkeys(motion, 0.0), np.zeros(self.inner)
        for law, body, begin in self.parts:
            own, dz = np.zeros(STATES), np.zeros(STATES)
            own[: law.states] = z[begin : begin + law.states]
            found[body] += law.function(t, *motion[body], law.p, own, dz)
            rates[begin : begin + law.states] = dz[: law.states]
        return found, rates


def effects_of(names, bodies=None):
    """Return the effects, those on a body on some bodies only."""
    return [EFFECTS[n] if EFFECTS[n].place != "body" else replace(EFFECTS[n], bodies=bodies) for n in names]


@pytest.mark.parametrize(
    ("names", "gap"),
    [
        pytest.param(
            names,
            gap,
            marks=pytest.mark.slow if gap == 1e-3 and names in MANY_STATES else (),
            id="-".join([f"{gap}", *names]),
        )
        for names in [*MIXED, ("support", "squeeze_film", "softening", "extra_mode")]
        for gap in (1e-3, 2e-4)
    ],
)
def test_impacts_of_the_minimal_model(names, gap):
    count, frequency = 6, 26.24
    simulator = FourDof().finer("time_step", 24.0)
    own = {p.name: p.nominal for p in simulator.parameters} | {"restitution": 0.3, "gap": gap}
    laws = Laws(names, own, simulator.places)
    mass = np.diag(lumped(own).mass)

    def law(t, q, dq, z=()):
        motion = {f"q{i + 1}": (q[i], dq[i]) for i in range(4)} | {"interface": (gap + q[2] - q[1], dq[2] - dq[1])}
        found, rates = laws(t, motion, z)
        opening = found.pop("interface") * np.array([0.0, -mass[2] / mass[1], 1.0, 0.0])
        accelerations = np.array(list(found.values())) + opening
        return (accelerations, rates) if laws.inner else accelerations

    peer = dop853(own, frequency, 1.5e-3, count, law=law, inner=laws.inner, rtol=1e-10)

    model = Model(simulator, effects_of(names, (BODY,)))
    values = model.nominal | own | {k: v for name in names for k, v in VALUES[name].items()}
    excitation = Excitation("end", "displacement", frequency=frequency, amplitude=1.5e-3)
    problem = simulator.problem(own, excitation, model._laws(values, own))
    state, impacts, none = start(problem, np.zeros(4), np.zeros(4)), np.zeros((5000, 10)), np.zeros((0, 10))
    rows = np.zeros((int(peer.times[-1] * frequency) + 2, 10))
    kernel.advance(problem, state, scratch(problem), len(rows), 0.0, 10**8, rows, np.zeros(0), none, impacts)
    found = impacts[: int(state.counters[IMPACTS])]
    found, expected = found[found[:, 1] > 1e-3][:count], peer.speeds > 1e-3
    np.testing.assert_allclose(found[:, 0] * frequency, peer.times[expected] * frequency, rtol=0, atol=1e-6)
    speeds = peer.speeds[expected]
    np.testing.assert_allclose(found[:, 1], speeds, rtol=0, atol=1e-6 * speeds.max())


def oscillate(own, drive, laws, times):
    """Displacement and velocity (2, n) of the oscillator at `times` from rest, up to its third impact at most."""
    w = 2.0 * np.pi * drive.frequency

    def rates(t, s):
        x, v = s[:2]
        found, dz = laws(t, {"mass": (x, v), "interface": (own["gap"] - x, -v)}, s[2:])
        pushed = drive.amplitude * np.cos(w * t) - own["damping"] * v - own["stiffness"] * x
        return np.concatenate([[v, pushed / own["mass"] + found["mass"] - found["interface"]], dz])

    def clearance(t, s):
        return own["gap"] - s[0]

    clearance.terminal, clearance.direction = True, -1.0
    t, state, rows, hits = 0.0, np.zeros(2 + laws.inner), [], 0
    while t < times[-1] and hits < 3:
        asked = times[times >= t] if not rows else times[times > t]
        run = solve_ivp(
            rates, (t, times[-1]), state, "DOP853", asked, events=clearance, rtol=1e-10, atol=1e-13, max_step=2e-3
        )
        rows.append(run.y[:2] if len(run.t) else np.zeros((2, 0)))
        if not run.t_events[0].size:
            break
        t, state, hits = run.t_events[0][0], run.y_events[0][0].copy(), hits + 1
        state[:2] = own["gap"] - 1e-16, -own["restitution"] * state[1]
    return np.concatenate(rows, axis=1), hits


@pytest.mark.slow
@pytest.mark.parametrize("names", MIXED, ids="-".join)
def test_the_motion_of_an_oscillator_with_a_stop(names):
    simulator = Oscillator(stop=True).finer("time_step", 24.0)
    drive = Excitation("mass", "force", frequency=5.0, amplitude=4.0)
    own = {p.name: p.nominal for p in simulator.parameters} | {"restitution": 0.8, "gap": 1e-3}
    values = {k: v for name in names for k, v in VALUES[name].items()}
    record = Model(simulator, effects_of(names)).run(
        {**own, **values}, drive, Request(periods=2, samples=100, settle=0)
    )
    (x, v), hits = oscillate(own, drive, Laws(names, own, simulator.places), record.time.values)
    assert hits > 0
    np.testing.assert_allclose(record.displacement.values[0, : x.size], x, rtol=0, atol=1e-6 * np.ptp(x))
    np.testing.assert_allclose(record.velocity.values[0, : v.size], v, rtol=0, atol=1e-6 * np.ptp(v))


def test_steps_that_grow_again_end_with_the_period():
    """Each of the four bodies slips at its own instants; no sliver of a period is left to rounding."""
    excitation = Excitation("end", "displacement", frequency=26.24, amplitude=1.5e-3)
    values = {"restitution": 0.05, **VALUES["presliding"]}
    record = Model(FourDof(), [EFFECTS["presliding"]]).run(
        values, excitation, Request(periods=15, samples=20, settle=0)
    )
    assert record.attrs["status"] == "ok"
