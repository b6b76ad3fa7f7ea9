"""Mass that the model does not include."""

from collections.abc import Mapping

from calib.modelling.effect import Effect
from calib.modelling.laws import structure
from calib.modelling.parameter import Parameter


@structure
def heavier(present: tuple[float, ...], p: Mapping[str, float]) -> tuple[float, ...]:
    """Return the mass with what is added to it."""
    (mass,) = present
    return (mass * (1.0 + p["added_mass"]),)


EFFECT = Effect(
    name="added_mass",
    site="structure",
    law=heavier,
    parameters=(Parameter("added_mass", "1", 0.0, "what is added, over the mass", null=0.0, low=-0.999),),
    meaning="a sensor, its cable, or air that moves along: the frequency is lower at all amplitudes",
    equation="layer_mass (1 + added_mass), or mass (1 + added_mass)",
    confused=("glue_bond", "detuning_drift"),
    changes=(("layer_mass",), ("mass",)),
    cite="Ewins, Modal Testing (2000)",
)
