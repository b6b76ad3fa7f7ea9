"""A time step that is finer than the simulator's own."""

from collections.abc import Mapping

from calib.modelling.effect import Effect
from calib.modelling.laws import numerical
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import RefinableSimulator, Simulator


@numerical
def finer(simulator: RefinableSimulator, p: Mapping[str, float]) -> Simulator:
    """Return the simulator with its time step divided by the refinement."""
    return simulator.finer("time_step", p["refinement"])


EFFECT = Effect(
    name="time_step",
    site="numerical",
    law=finer,
    parameters=(Parameter("refinement", "1", 1.0, "by which it is divided", kind="numerical", null=1.0, low=1.0),),
    meaning="the step is too coarse for the motion: the phase curve is a band, and the error imitates damping",
    equation="time step / refinement",
    confused=("linear_drag", "rate_restitution"),
    changes=(("time_step",),),
    differentiable=False,
    natural={"refinement": (1.0, 3.0)},
    cite="Hairer, Norsett & Wanner, Solving Ordinary Differential Equations I (1993), chapter II",
)
