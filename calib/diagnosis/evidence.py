"""All records of a diagnosis: residuals in units of the noise, free of what nuisances absorb."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.noise import STATED, Remainder, from_residual
from calib.diagnosis.noise_profile import noise_profiles
from calib.diagnosis.part import Part
from calib.objective import Objective, compared_rows, row_weights

INITIAL_RANK_TOLERANCE = 1e-9  # singular value over the largest, below which an initial state is not moved  [1]


def pairs_compared(objective: Objective) -> dict[str, Sequence[tuple[str, str]]]:
    """(body, channel) pairs of each reference that a diagnosis compares."""
    return {
        name: compared_rows(reference, objective.terms_of(name)) for name, reference in objective.references.items()
    }


@dataclass(frozen=True, eq=False)
class Evidence:
    """All records of a diagnosis."""

    parts: tuple[Part, ...]

    @property
    def names(self) -> list[str]:
        """Names of the records."""
        return [part.name for part in self.parts]

    def residual(self, simulated: Mapping[str, SimulatedRows]) -> np.ndarray:
        """Measured less simulated, in units of the noise (N,)."""
        return np.concatenate([part.white(part.measured - simulated[part.name].rows) for part in self.parts])

    def difference(self, one: Mapping[str, SimulatedRows], other: Mapping[str, SimulatedRows]) -> np.ndarray:
        """Simulation `other` less simulation `one`, in units of the noise (N,)."""
        return np.concatenate([part.white(other[part.name].rows - one[part.name].rows) for part in self.parts])

    def carried(self, columns: np.ndarray, other: "Evidence") -> np.ndarray:
        """Convert columns (N, k) from units of the noise of `other`, of the same samples, to units of this noise."""
        blocks = []
        for part, old in zip(self.parts, other.parts, strict=True):
            plain = old.restored(columns[other.of(old.name)])
            whitened = np.column_stack([part.whitened(plain[:, :, k]) for k in range(columns.shape[1])])
            blocks.append(part.shrunk(whitened, 1.0))
        return np.concatenate(blocks)

    def tangents(self, simulated: Mapping[str, SimulatedRows]) -> np.ndarray:
        """Change of the simulations with each nuisance of each record, in units of the noise (N, k)."""
        return block_diag(*(part.tangents(simulated[part.name]) for part in self.parts))

    def clock_changes(self) -> np.ndarray:
        """Change of the rows with the rate of each clock that is uncertain, in units of the noise (N, k)."""
        changes = [(part, part.clock) for part in self.parts if part.clock is not None]
        columns = np.zeros((sum(part.measured.size for part in self.parts), len(changes)))
        for column, (part, change) in zip(columns.T, changes, strict=True):
            column[self.of(part.name)] = part.white(change)
        return columns

    def by_sweep(self, columns: np.ndarray) -> np.ndarray:
        """Columns (N, k) as changes of each sweep of each frequency response alone (N, k * sweep)."""
        return block_diag(*(part.by_sweep(columns[self.of(part.name)]) for part in self.parts))

    def initial_moves(
        self, simulated: Mapping[str, SimulatedRows], residual: np.ndarray
    ) -> dict[str, dict[str, float]]:
        """Changes of initial states that are nuisances, by record, which fit a residual (N,) best, to first order."""
        changes = {}
        for part in self.parts:
            view = simulated[part.name]
            if view.start is None:
                continue
            tangents = part.tangents(view)
            scale = np.linalg.norm(tangents, axis=0)
            scale[scale == 0.0] = 1.0
            own = residual[self.of(part.name)]
            moves = np.linalg.lstsq(tangents / scale, own, rcond=INITIAL_RANK_TOLERANCE)[0] / scale
            changes[part.name] = dict(zip(view.start.state, moves.tolist(), strict=False))
        return changes

    def segments(self) -> np.ndarray:
        """Number (N,) of the segment that each residual belongs to."""
        numbers, first = [], 0
        for part in self.parts:
            own = part.segments()
            numbers.append(own + first)
            first += int(own.max()) + 1
        return np.concatenate(numbers)

    def rows(self) -> np.ndarray:
        """Number (N,) of the row, among those of all records, that each residual belongs to."""
        lengths = [part.time.size for part in self.parts for _ in part.rows]
        return np.repeat(np.arange(len(lengths)), lengths)

    def of_row(self, columns: np.ndarray, number: int) -> np.ndarray:
        """Columns (N, k) of what changes one row alone, that of this number among those of all records."""
        alone = np.zeros_like(columns)
        for part in self.parts:
            if 0 <= number < len(part.rows):
                alone[self.of(part.name)] = part.of_row(columns[self.of(part.name)], number)
            number -= len(part.rows)
        return alone

    def counted(self) -> float:
        """Number of residuals, each counted by its squared weight."""
        return float(sum((part.weight**2).sum() for part in self.parts))

    def of(self, name: str) -> slice:
        """Positions of the residuals of a record among all."""
        begin = 0
        for part in self.parts:
            if part.name == name:
                return slice(begin, begin + part.measured.size)
            begin += part.measured.size
        raise KeyError(name)

    def only(self, names: Sequence[str]) -> "Evidence":
        """Return some of the records."""
        return Evidence(tuple(part for part in self.parts if part.name in names))

    def with_weights(self, simulations: Sequence[Mapping[str, SimulatedRows]]) -> "Evidence":
        """Return the same evidence, compared only where all these simulations are reliable."""
        parts = []
        for part in self.parts:
            trust = np.prod([views[part.name].trust for views in simulations], axis=0)
            parts.append(_weighted(part, trust))
        return Evidence(tuple(parts))

    def with_remainder(self, residual: np.ndarray) -> "Evidence":
        """Return the evidence with uncertain clocks beside the residual (N,) of a model, which may mask them."""
        return Evidence(tuple(part.with_remainder(residual[self.of(part.name)]) for part in self.parts))

    def with_reestimated_noise(self, left: Mapping[str, Remainder]) -> "Evidence":
        """Return the evidence with the noise of rows without cycles re-estimated from what is `left`."""
        parts = []
        for part in self.parts:
            remainder, noises = left[part.name], list(part.noise)
            profiles = noise_profiles(part.rows, part.measured, part.weight, remainder) if part.is_swept else None
            for index, known in enumerate(part.noise):
                if not known.repeated:
                    samples = part.weight[index], part.measured[index], known.sigma if known.source == STATED else None
                    profile = known.profile if profiles is None or known.source == STATED else profiles[index]
                    estimate = from_residual(remainder.rows[index], *samples, remainder.absorbed[index], profile)
                    noises[index] = estimate.within(remainder.whole[index], part.weight[index])
            parts.append(replace(part, noise=tuple(noises)))
        return Evidence(tuple(parts))


def clocks_differ(one: Evidence, other: Evidence) -> bool:
    """Whether the uncertainty of a clock counts in one of two sets of the same records and not in the other."""
    shares = [abs(p.clock_share - q.clock_share) for p, q in zip(one.parts, other.parts, strict=True)]
    return max(shares, default=0.0) > CRITERIA.max_noise_change


def _weighted(part: Part, trust: np.ndarray) -> Part:
    """Return the record with the weights of simulations of this reliability (n,)."""
    return replace(part, weight=row_weights(part.rows, part.used, trust))
