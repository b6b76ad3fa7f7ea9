"""A gap of another shape: part of its height is a shift."""

from collections.abc import Mapping

from calib.modelling.effect import Effect
from calib.modelling.laws import structure
from calib.modelling.parameter import Parameter


@structure
def shifted(present: tuple[float, ...], p: Mapping[str, float]) -> tuple[float, ...]:
    """Return the height of the gap's cubics and its shift [m], whose sum does not change."""
    height, shift = present
    return height - p["interface_shift"], shift + p["interface_shift"]


EFFECT = Effect(
    name="interface_shift",
    site="structure",
    law=shifted,
    parameters=(Parameter("interface_shift", "m", 0.0, "part of the gap that is a shift", null=0.0, low=0.0),),
    meaning="the gap is wide up to its ends: impacts are fast but smooth, the layer's amplitude is smaller",
    equation="g_max - interface_shift, s + interface_shift",
    group="contact",
    confused=("gap_offset", "squeeze_film", "linear_drag", "coulomb_friction"),
    changes=(("g_max", "s"),),
    cite="Parameter estimation for finite element analyses of stationary oscillations "
    "of a vibro-impacting system, section 4 and Fig. 8",
)
