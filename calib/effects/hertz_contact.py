"""A curved stop that yields: Hertz's contact with a damper in proportion, in the place of Newton's impact."""

from collections.abc import Mapping

from calib.modelling.effect import Effect
from calib.modelling.laws import stop
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Simulator, StoppedSimulator


@stop
def yielding(simulator: StoppedSimulator, p: Mapping[str, float]) -> Simulator:
    """Return the simulator with a contact that sets in softly, and loses as much at any speed, for its rigid stop."""
    return simulator.compliant("gonthier")


EFFECT = Effect(
    name="hertz_contact",
    site="stop",
    law=yielding,
    parameters=(
        Parameter("contact_time", "s", 0.0, "duration of a loss-free impact at 1 m/s", null=0.0, low=0.0),
        Parameter("contact_exponent", "1", 1.5, "of the penetration in the force", low=1.0, high=1.5),
    ),
    meaning="a curved stop that yields, softly at first: an impact takes time; the restitution is what it loses",
    equation="max(0, k d^n (1 + a d' / v0)), d penetration, v0 closing speed; k by contact_time, a by restitution",
    confused=("compliant_contact", "gap_offset", "rate_restitution", "velocity_lowpass", "plot_scale", "channel_gain"),
    changes=(("gonthier",),),
    differentiable=False,
    natural={"contact_time": (0.01, 0.03, 0.1)},
    cite="Gonthier, McPhee, Lange & Piedboeuf, Multibody System Dynamics 11 (2004) 209",
)
