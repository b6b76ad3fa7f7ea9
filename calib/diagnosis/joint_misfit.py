"""The misfit that a model leaves where it is refitted to all records at once, those held out included."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.excess import gross_excess_by_row, significant
from calib.diagnosis.fit import Fit
from calib.diagnosis.score import Projection

JOINT_RANK_TOLERANCE = 1e-8  # singular value over the largest, of columns of unit length  [1]


@dataclass(frozen=True)
class JointMisfit:
    """Chi-square of a model refitted to all records at once, to first order about its fit.

    Attributes
    ----------
    excess_chi2 : chi-square beyond the degrees of freedom, by which models are compared: that of gross errors is in it,
        as their bounded loss has it
    chi2_std : standard deviation of the chi-square of noise alone
    values : of the parameters of the model, by name, in SI
    gross_chi2 : the part of it that gross errors have, beyond their noise: no model comes near them
    """

    excess_chi2: float
    chi2_std: float
    values: Mapping[str, float]
    gross_chi2: float = 0.0

    @property
    def is_significant(self) -> bool:
        """Whether the model leaves more than noise in all records together."""
        return significant(self.excess_chi2 - self.gross_chi2, self.chi2_std)


def joint_misfit(
    fit: Fit, several: Sequence[tuple[Evidence, Mapping[str, SimulatedRows], Mapping[str, np.ndarray]]]
) -> JointMisfit | None:
    """Refit a model to all records of several pieces of evidence: one step of Gauss and Newton.

    None where derivatives of a record are unknown.

    Parameters
    ----------
    fit : the model
    several : evidence, simulations, and record -> (n, k) derivatives by the parameters `fit.names`, then by those of
        that record alone
    """
    count = len(fit.names)
    slopes, residuals, records, degrees, counted = [], [], [], 0.0, 0.0
    for evidence, simulations, columns in several:
        if set(columns) != set(evidence.names):
            return None
        residual, nuisances = evidence.residual(simulations), evidence.tangents(simulations)
        counted += evidence.counted()
        for part in evidence.parts:
            own, slope = evidence.of(part.name), columns[part.name]
            alone = Projection(np.column_stack([slope[:, count:], nuisances[own]]))
            slopes.append(alone(slope[:, :count]))
            residuals.append(alone(residual[own]))
            records.append((part, simulations[part.name]))
            degrees -= alone.rank
    together, residual = np.vstack(slopes), np.concatenate(residuals)
    length = np.maximum(np.linalg.norm(together, axis=0), 1e-300)
    moves, _, rank, _ = np.linalg.lstsq(together / length, residual, rcond=JOINT_RANK_TOLERANCE)
    remaining = residual - together @ (moves / length)
    values = {name: fit.value(name) + float(move) for name, move in zip(fit.names, moves / length, strict=True)}
    pieces = np.split(remaining, np.cumsum([own.size for own in residuals])[:-1])
    gross = sum(float(gross_excess_by_row(*record, own).sum()) for record, own in zip(records, pieces, strict=True))
    excess = float(remaining @ remaining) - (degrees + counted - int(rank))
    return JointMisfit(excess, math.sqrt(2.0 * counted), values, gross)
