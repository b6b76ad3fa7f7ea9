"""Two tanks, one above the other: a simulator of levels by a third party, and the effects that it lacks."""

import math
from dataclasses import replace

import numpy as np
from numba import njit

from calib.errors import CalibError
from calib.modelling.effect import Effect
from calib.modelling.laws import STATES, excitation, force, sensor
from calib.modelling.parameter import Parameter
from calib.records import failed, make
from calib.simulators.law_calls import acting, addresses
from calib.simulators.law_calls import excitation as excitation_law
from calib.simulators.law_calls import force as force_law

BODIES = ("upper", "lower")
RANGE = 10.0  # m, end of the sensor's range
STEPS = 16  # Runge-Kutta steps from one sample of the pump to the next


class CascadedTanks:
    """A pump fills the upper tank, which empties into the lower one, which empties into the reservoir.

    x1' = b u - k1 sqrt(x1),  x2' = k1 sqrt(x1) - k2 sqrt(x2), tanks of one cross-section; u is held between its
    samples. The displacement of a body is its level and the velocity its rate. A law of force adds to that rate, its
    m/s^2 counted as m/s; of what laws take out of the upper tank the lower one gets the `spill_share`. A law of the
    excitation changes the pump's samples.
    """

    name = "cascaded_tanks"
    bodies = BODIES
    places = {"body": ("lower",)}
    excitations = frozenset({("force", "pump")})
    sites = frozenset({"force", "excitation"})
    parameters = (
        Parameter("outflow_upper", "m^0.5/s", 0.05, "outflow of the upper tank over the root of its level", low=0.0),
        Parameter("outflow_lower", "m^0.5/s", 0.05, "outflow of the lower tank over the root of its level", low=0.0),
        Parameter("pump", "m/(N s)", 0.05, "rise of the upper level per unit of the pump's input", low=0.0),
        Parameter("initial_upper", "m", 5.0, "level of the upper tank at the first sample", low=0.0),
        Parameter("initial_lower", "m", 5.0, "level of the lower tank at the first sample", low=0.0),
        Parameter("spill_share", "1", 0.6, "share of what spills that falls into the lower tank", low=0.0, high=1.0),
    )

    def run(self, values, excitation, laws, request):
        """Return the record of both levels at the instants of the pump's samples, or the times asked for."""
        if (excitation.quantity, excitation.place) not in self.excitations or not excitation.recorded:
            raise CalibError(f"the tanks take a recorded force at 'pump', got {excitation.quantity} {excitation.place}")
        for name, value in values.items():
            if not np.isfinite(value):
                return failed(self.bodies, "impossible value", f"{name} is {value}")
        if request.step_budget < STEPS * excitation.time.size:
            return failed(self.bodies, "step budget", f"{STEPS * excitation.time.size} steps are needed")
        states = np.array([law.states for law in laws] + [0] * STATES)
        found = _levels(
            excitation.time,
            excitation.value + _changes(excitation.time, excitation.value, *addresses(laws, "excitation")),
            np.array([values[p.name] for p in self.parameters]),
            *addresses(laws, "force"),
            acting(laws, BODIES),
            states,
        )
        if not np.isfinite(found).all():
            return failed(self.bodies, "diverged", "the levels are not finite")
        times = excitation.time if request.times is None else request.times
        at = np.array([[np.interp(times, excitation.time, row) for row in kind] for kind in found])
        attrs = {"place": excitation.place, "quantity": excitation.quantity}
        return make(times, BODIES, {"displacement": at[0], "velocity": at[1]}, **attrs)


@njit(cache=True)
def _changes(time, pump, functions, p, count):
    """Change (n,) of the pump's input by the laws that act on it."""
    change = np.zeros(time.size)
    for n in range(time.size):
        for i in range(count):
            change[n] += excitation_law(functions[i], time[n], 0.0, 0.0, pump[n], p[i])
    return change


@njit(cache=True)
def _rates(t, x, u, values, functions, p, count, acts, z, dz, rate):
    """Write the rates of both levels [m/s] and of the laws' states."""
    out = values[0] * np.sqrt(max(x[0], 0.0)), values[1] * np.sqrt(max(x[1], 0.0))
    rate[0] = values[2] * u - out[0]
    rate[1] = out[0] - out[1]
    plain, spilt = (rate[0], rate[1]), 0.0
    for i in range(count):
        for j in range(2):
            if acts[i, j]:
                change = force_law(functions[i], t, x[j], plain[j], p[i], z[i, j], dz[i, j])
                rate[j] += change
                spilt -= change if j == 0 else 0.0
    rate[1] += values[5] * max(spilt, 0.0)


@njit(cache=True)
def _levels(time, pump, values, functions, p, count, acts, states):
    """Levels and their rates (2, body, n) at the samples, by Runge and Kutta."""
    found = np.zeros((2, 2, time.size))
    x, rate = values[3:5].copy(), np.zeros((4, 2))
    z, dz = np.zeros((p.shape[0], 2, STATES)), np.zeros((4, p.shape[0], 2, STATES))
    for n in range(time.size):
        _rates(time[n], x, pump[n], values, functions, p, count, acts, z, dz[0], rate[0])
        found[0, :, n], found[1, :, n] = x, rate[0]
        if n == time.size - 1:
            break
        h = (time[n + 1] - time[n]) / STEPS
        for k in range(STEPS):
            t, u = time[n] + k * h, pump[n]
            _rates(t, x, u, values, functions, p, count, acts, z, dz[0], rate[0])
            for s in range(1, 4):
                part = h if s == 3 else 0.5 * h
                xs, zs = x + part * rate[s - 1], z + part * dz[s - 1]
                _rates(t + part, xs, u, values, functions, p, count, acts, zs, dz[s], rate[s])
            x = np.maximum(x + h * (rate[0] + 2.0 * rate[1] + 2.0 * rate[2] + rate[3]) / 6.0, 0.0)
            z = z + h * (dz[0] + 2.0 * dz[1] + 2.0 * dz[2] + dz[3]) / 6.0
    return found


@force
def spill(t, x, v, p, z, dz):
    """Return what spills [m/s] at the level x [m]: -p[0] (x - p[1]) above the brim p[1]."""
    return -p[0] * max(0.0, x - p[1])


OVERFLOW = Effect(
    name="overflow",
    site="force",
    law=spill,
    parameters=(
        Parameter("spill_rate", "1/s", 0.0, "spill over the height above the brim", null=0.0, low=0.0, high=2.0),
        Parameter("brim", "m", 10.0, "level from which on the tank spills", low=0.0),
    ),
    meaning="a tank that spills over its brim: what is pumped in beyond that is lost, or falls into the next tank",
    equation="-spill_rate max(0, x - brim)",
    bodies=("upper",),
    differentiable=False,  # what is lost changes the levels that decide about it
    natural={"spill_rate": (3.0, 10.0, 30.0), "brim": (2.0, 2.5, 3.0)},
    cite="M. Schoukens, P. Mattson, T. Wigren, J.-P. Noel, Cascaded tanks benchmark (2016)",
)

LOWER_OVERFLOW = replace(
    OVERFLOW,
    name="lower_overflow",
    parameters=(
        Parameter("lower_spill_rate", "1/s", 0.0, "spill over the height above the brim", null=0.0, low=0.0, high=2.0),
        Parameter("lower_brim", "m", 10.0, "level from which on the lower tank spills", low=0.0),
    ),
    meaning="the lower tank spills over its brim into the reservoir: its level stops rising",
    equation="-lower_spill_rate max(0, x - lower_brim)",
    bodies=("lower",),
    natural={"lower_spill_rate": (3.0, 10.0, 30.0), "lower_brim": (2.0, 2.5, 3.0)},
)


@force
def head(t, x, v, p, z, dz):
    """Return the additional outflow [m/s] at the level x [m]: -p[1] (sqrt(x + p[0]) - sqrt(x)), 0 of an empty tank."""
    return -p[1] * (math.sqrt(x + p[0]) - math.sqrt(x)) if x > 0.0 else 0.0


OUTLET_HEAD = Effect(
    name="outlet_head",
    site="force",
    law=head,
    parameters=(
        Parameter("outlet_head", "m", 0.0, "height of the lower tank's bottom above its outlet", null=0.0, low=0.0),
    ),
    meaning="the lower tank empties through a pipe that ends below its bottom",
    equation="-outflow_lower (sqrt(x + outlet_head) - sqrt(x))",
    confused=("channel_offset",),
    bodies=("lower",),
    borrowed=("outflow_lower",),
    cite="Munson, Fundamentals of Fluid Mechanics (2013), section 3.6: Torricelli's theorem",
)


@excitation
def threshold(t, phase, amplitude, x, p):
    """Return the change of the pump's input x: it becomes max(0, x - p[0])."""
    return max(0.0, x - p[0]) - x


PUMP_THRESHOLD = Effect(
    name="pump_threshold",
    site="excitation",
    law=threshold,
    parameters=(Parameter("pump_threshold", "N", 0.0, "input below which the pump lifts no water", null=0.0),),
    meaning="a pump that needs some voltage before it lifts any water",
    equation="max(0, u - pump_threshold) - u",
    confused=("preload", "channel_offset"),
    cite="Karassik et al., Pump Handbook (2008): static head",
)


@sensor
def curved(record, p):
    """Return the record with levels x [m] read as x + c x (x / RANGE - 1): right at 0 and at the end of the range."""
    x = record["displacement"].values
    return record.assign(displacement=record["displacement"].copy(data=x + p["curvature"] * x * (x / RANGE - 1.0)))


SENSOR_CURVATURE = Effect(
    name="sensor_curvature",
    site="sensor",
    law=curved,
    parameters=(Parameter("curvature", "1", 0.0, "share of the square in the sensor's reading", null=0.0),),
    meaning="a level sensor whose reading grows faster at high levels than at low ones",
    equation="x + curvature x (x / 10 m - 1)",
    confused=("outlet_head",),
    cite="McConnell & Varoto, Vibration Testing: Theory and Practice (2008)",
)
