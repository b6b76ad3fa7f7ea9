"""What is left of the bond between layer and beam."""

from collections.abc import Mapping

from calib.modelling.effect import Effect
from calib.modelling.laws import structure
from calib.modelling.parameter import Parameter


@structure
def bonded(present: tuple[float, ...], p: Mapping[str, float]) -> tuple[float, ...]:
    """Return the stiffness of the layer with what the bond adds to it."""
    (stiffness,) = present
    return (stiffness * (1.0 + p["bond"]),)


EFFECT = Effect(
    name="glue_bond",
    site="structure",
    law=bonded,
    parameters=(Parameter("bond", "1", 0.0, "stiffness of the bond over that of the layer", null=0.0, low=0.0),),
    meaning="glue that holds on near the edges: the layer's frequency is up, also without contact",
    equation="layer_stiffness (1 + bond)",
    confused=("added_mass", "cubic_stiffness"),
    changes=(("layer_stiffness",),),
)
