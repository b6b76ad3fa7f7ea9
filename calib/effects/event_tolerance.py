"""A tolerance of the events that is finer than the simulator's own."""

from collections.abc import Mapping

from calib.modelling.effect import Effect
from calib.modelling.laws import numerical
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import RefinableSimulator, Simulator


@numerical
def finer(simulator: RefinableSimulator, p: Mapping[str, float]) -> Simulator:
    """Return the simulator with its tolerance of the events divided by the refinement."""
    return simulator.finer("event_tolerance", p["tolerance_refinement"])


EFFECT = Effect(
    name="event_tolerance",
    site="numerical",
    law=finer,
    parameters=(
        Parameter("tolerance_refinement", "1", 1.0, "by which it is divided", kind="numerical", null=1.0, low=1.0),
    ),
    meaning="impacts are located too coarsely: the phase curve is a band, and the error imitates restitution",
    equation="tolerance of the events / tolerance_refinement",
    confused=("linear_drag", "rate_restitution"),
    changes=(("event_tolerance",),),
    differentiable=False,
    natural={"tolerance_refinement": (1.0, 3.0)},
    cite="Hairer, Norsett & Wanner, Solving Ordinary Differential Equations I (1993), section II.6",
)
