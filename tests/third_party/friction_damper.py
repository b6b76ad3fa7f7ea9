"""A friction device moved to and fro: a simulator of its force by a third party."""

import numpy as np
from numba import njit

from calib.errors import CalibError
from calib.modelling.laws import at_site
from calib.modelling.parameter import Parameter
from calib.records import failed, make, prescription
from calib.simulators.oscillator.prescribed import law_accelerations, prescribed_motion


class FrictionDamper:
    """Elastic slip: a spring in series with a slider that holds up to `slip_forward` and `slip_backward`.

    The motion is prescribed, the record holds the force it takes. A law of the gap gives the device play: half the
    clearance through which it moves without force, in series with spring and slider. Laws of force are per unit of
    `law_mass`, and act against the motion as on a free body; the device itself has no inertia.
    """

    name = "friction_damper"
    bodies = ("device",)
    places = {"body": ("device",)}
    excitations = frozenset({("displacement", "device")})
    sites = frozenset({"force", "gap"})
    parameters = (
        Parameter("stiffness", "N/m", 1e6, "stiffness of the device before it slips", low=0.0),
        Parameter("slip_forward", "N", 1e4, "force at which it slips forwards", low=0.0),
        Parameter("slip_backward", "N", 1e4, "force at which it slips backwards", low=0.0),
        Parameter("law_mass", "kg", 1000.0, "mass that makes forces of laws per unit mass"),
    )

    def run(self, values, excitation, laws, request):
        """Return the record of the force at the times asked for, or at the samples of the motion."""
        if (excitation.quantity, excitation.place) not in self.excitations or not excitation.recorded:
            raise CalibError(
                f"the damper takes a recorded displacement of 'device', got {excitation.quantity} at {excitation.place}"
            )
        attrs = {"place": excitation.place, "quantity": excitation.quantity, "prescribed": prescription(self.bodies)}
        for name, value in values.items():
            if not np.isfinite(value):
                return failed(self.bodies, "impossible value", f"{name} is {value}", **attrs)
        if values["stiffness"] <= 0.0:
            return failed(self.bodies, "impossible value", "the device needs a stiffness", **attrs)
        times = excitation.time if request.times is None else np.asarray(request.times)
        motion = prescribed_motion(excitation, 1.0, laws, times)
        budget = request.step_budget - motion.time.size
        accelerations = law_accelerations(motion, laws, budget) if budget > 0 else None
        if accelerations is None:
            return failed(self.bodies, "step budget", f"more than {request.step_budget} steps are needed", **attrs)
        play = max(0.0, sum(law.function(0.0, law.p) for law in at_site(laws, "gap")))
        slip = values["slip_forward"], values["slip_backward"]
        force = _elastic_slip(motion.x, values["stiffness"], *slip, play) - values["law_mass"] * accelerations
        at = np.searchsorted(motion.time, times - 1e-6 * (times[1] - times[0]))
        channels = {"displacement": motion.x[None, at], "velocity": motion.v[None, at], "force": force[None, at]}
        return make(times, self.bodies, channels, **attrs)


@njit(cache=True)
def _elastic_slip(x, stiffness, forward, backward, play):
    """Force (n,) [N] along the displacements x (n,) [m]; the slider starts where the motion does."""
    force, slider = np.zeros(x.size), x[0]
    for i in range(x.size):
        stretch = x[i] - slider
        elastic = stiffness * (max(0.0, stretch - play) + min(0.0, stretch + play))
        force[i] = min(max(elastic, -backward), forward)
        if elastic > forward:
            slider = x[i] - play - forward / stiffness
        elif elastic < -backward:
            slider = x[i] + play + backward / stiffness
    return force
