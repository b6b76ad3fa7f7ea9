"""A stop that yields: a compliant contact in the place of Newton's impact (Kelvin and Voigt)."""

from collections.abc import Mapping

from calib.modelling.effect import Effect
from calib.modelling.laws import stop
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Simulator, StoppedSimulator


@stop
def yielding(simulator: StoppedSimulator, p: Mapping[str, float]) -> Simulator:
    """Return the simulator with a spring and a damper, which push and do not pull, in the place of its rigid stop."""
    return simulator.compliant("kelvin_voigt")


EFFECT = Effect(
    name="compliant_contact",
    site="stop",
    law=yielding,
    parameters=(Parameter("contact_time", "s", 0.0, "duration of a loss-free impact", null=0.0, low=0.0),),
    meaning="a stop that yields: an impact takes time and penetrates; the restitution is then what the contact loses",
    equation="max(0, k d + c d'), d the penetration; k by contact_time, c by restitution",
    confused=(
        "hertz_contact",
        "gap_offset",
        "rate_restitution",
        "velocity_lowpass",
        "squeeze_film",
        "plot_scale",
        "channel_gain",
    ),
    changes=(("kelvin_voigt",),),
    differentiable=False,
    natural={"contact_time": (0.01, 0.03, 0.1)},
    cite="Goldsmith, Impact (1960); Hunt & Crossley, Journal of Applied Mechanics 42 (1975) 440",
)
