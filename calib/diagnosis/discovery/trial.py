"""A model with free forces at one place, fitted and judged by what it predicts."""

from dataclasses import dataclass

import numpy as np

from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.discovery.free_force import DISPLACEMENT, VELOCITY
from calib.diagnosis.discovery.left_out import LeftOutMisfit
from calib.diagnosis.discovery.penalised import PenalisedFit
from calib.diagnosis.discovery.place import ForcePlace

OF_DISPLACEMENT, OF_VELOCITY, OF_STATE = (DISPLACEMENT,), (VELOCITY,), (DISPLACEMENT, VELOCITY)  # arguments
Arguments = tuple[tuple[str, ...], ...]  # of the additive functions of a model
SURFACE_RANK = 2  # that a surface over both arguments has beyond its number of functions, as a complexity  [1]


@dataclass(frozen=True, eq=False)
class ForceTrial:
    """A model with free forces at one place, fitted and judged by what it predicts.

    Attributes
    ----------
    place : where they act
    arguments : of each of the additive functions
    fitted : the model
    left_out : misfit of the records that were left out in turn; None where none can be
    """

    place: ForcePlace
    arguments: Arguments
    fitted: PenalisedFit
    left_out: LeftOutMisfit | None

    @property
    def body(self) -> str:
        """Name of the place."""
        return self.place.name

    @property
    def all_arguments(self) -> tuple[str, ...]:
        """Arguments of all functions, each once."""
        return tuple(dict.fromkeys(argument for own in self.arguments for argument in own))

    @property
    def chi2(self) -> float:
        """Chi-square of the model."""
        return self.fitted.fit.chi2

    @property
    def values(self) -> dict[str, float]:
        """Values of the parameters of the model."""
        return {name: self.fitted.fit.value(name) for name in self.fitted.fit.names}

    @property
    def predictive_deviance(self) -> float:
        """Predictive deviance of the left-out records; infinite where there are none."""
        return np.inf if self.left_out is None else self.left_out.deviance

    @property
    def complexity(self) -> int:
        """Rank of the model by its functions: of one argument, additive, a surface."""
        return len(self.arguments) + SURFACE_RANK * (OF_STATE in self.arguments)

    def predicts_better(self, other: "ForceTrial") -> bool:
        """Whether it predicts left-out records better than another."""
        if self.left_out is None or other.left_out is None:
            return False
        return self.left_out.is_better(other.left_out)

    def stands_for(self, other: "ForceTrial") -> bool:
        """Whether it has some of the functions of another at the same place, and the others fit no record better.

        They do by more than a tie in quasi-AIC, with the effective parameters. A function that is nil in the fit to all
        records may predict better for no more reason than the uncertainty that it brings.
        """
        if self.body != other.body or not set(self.arguments) < set(other.arguments):
            return False
        dispersion = min(self.fitted.dispersion, other.fitted.dispersion)
        own, its = (t.chi2 / dispersion + 2.0 * t.fitted.effective_parameters for t in (self, other))
        return own - its <= CRITERIA.aic_tie


def described(arguments: Arguments, place: ForcePlace) -> str:
    """Arguments of additive functions at a place in words."""
    if arguments == (OF_STATE,):
        return f"surface over {place.in_words(DISPLACEMENT)} and {place.in_words(VELOCITY)}"
    return " + ".join(f"function of {place.in_words(own[0])}" for own in arguments)
