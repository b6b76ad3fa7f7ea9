"""The misfit that a model leaves where it is refitted to all records at once, those held out included."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.excess import significant
from calib.diagnosis.score import Projection


@dataclass(frozen=True)
class JointMisfit:
    """Chi-square of a model refitted to all records at once, to first order about its fit.

    Attributes
    ----------
    excess_chi2 : chi-square beyond the degrees of freedom
    chi2_std : standard deviation of the chi-square of noise alone
    """

    excess_chi2: float
    chi2_std: float

    @property
    def is_significant(self) -> bool:
        """Whether the model leaves more than noise in all records together."""
        return significant(self.excess_chi2, self.chi2_std)


def joint_misfit(
    several: Sequence[tuple[Evidence, Mapping[str, SimulatedRows], Mapping[str, np.ndarray]]], count: int
) -> JointMisfit | None:
    """Refit a model to all records of several pieces of evidence: one step of Gauss and Newton.

    None where derivatives of a record are unknown.

    Parameters
    ----------
    several : evidence, simulations, and record -> (n, k) derivatives by the parameters of the model, which are the same
        for all records, then by those of that record alone
    count : of the first of these
    """
    slopes, residuals, degrees, counted = [], [], 0.0, 0.0
    for evidence, simulations, columns in several:
        if set(columns) != set(evidence.names):
            return None
        residual, nuisances = evidence.residual(simulations), evidence.tangents(simulations)
        counted += evidence.counted()
        for name in evidence.names:
            own = evidence.of(name)
            alone = Projection(np.column_stack([columns[name][:, count:], nuisances[own]]))
            slopes.append(alone(columns[name][:, :count]))
            residuals.append(alone(residual[own]))
            degrees -= alone.rank
    shared = Projection(np.vstack(slopes))
    remaining = shared(np.concatenate(residuals))
    degrees += counted - shared.rank
    return JointMisfit(float(remaining @ remaining) - degrees, math.sqrt(2.0 * counted))
