"""The residual of a calibration beside the noise of its records, where that is known."""

import math
from collections.abc import Sequence

import numpy as np
import xarray as xr

from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.evidence import pairs_compared
from calib.diagnosis.excess import significant
from calib.diagnosis.gathering import gathered
from calib.diagnosis.noise import MIN_LEVEL, RESIDUAL
from calib.diagnosis.part import Part
from calib.execution.pool import Failure
from calib.objective import Objective
from calib.records import OK, STATE, prescribed
from calib.records.cycles import IRREGULAR, kind_of_motion
from calib.study import Evaluation
from calib.study.result import ChannelResidual

MAX_FLOOR_RATIO = 1.5  # of a noise level over the least one, up to which it is that, and the noise is not known  [1]


def residuals_beside_noise(
    objective: Objective, evaluation: Evaluation | Failure | None
) -> tuple[ChannelResidual, ...]:
    """Compare the residual of each channel with its noise: stated in the record, or seen from cycle to cycle.

    None of a motion of another kind than measured, of irregular motions, of few samples, of noise that is not known.

    evaluation : of the calibrated model on all records of the objective
    """
    if not isinstance(evaluation, Evaluation) or evaluation.score.status != OK or evaluation.score.wrong:
        return ()
    found: list[ChannelResidual] = []
    for name in objective.scored:
        beside = beside_simulation(objective, name, evaluation.records[name])
        if beside is not None:
            found += _compared(*beside)
    return tuple(found)


def beside_simulation(objective: Objective, name: str, simulated: xr.Dataset) -> tuple[Part, SimulatedRows] | None:
    """A record with its noise as a diagnosis has it, and its simulation on the time base of the record.

    None of irregular motions, of few samples, and where the simulation has not all channels.

    simulated : of the reference `name`, of status ok
    """
    reference, rows = objective.references[name], pairs_compared(objective)
    cycle = 1 if reference.is_swept else _cycle(reference.record)
    if cycle is None or reference.abscissa.size < CRITERIA.min_noise_samples:
        return None
    view = _rows(objective, name, rows[name], simulated)
    if view is None:
        return None
    return gathered({name: reference}, rows, {name: cycle}, {name: view}).parts[0], view


def _cycle(measured: xr.Dataset) -> int | None:
    """Periods of the excitation after which a measured motion repeats; None where it is irregular."""
    if not any(channel in measured for channel in STATE):  # of a force, say: the kind of motion is not known
        return 1
    motion = kind_of_motion(measured)
    return None if motion.kind == IRREGULAR else motion.period or 1


def _rows(
    objective: Objective, name: str, pairs: Sequence[tuple[str, str]], simulated: xr.Dataset
) -> SimulatedRows | None:
    """Rows of a simulated record on the time base of the measured one; None where a channel is missing."""
    compared = objective.compared(name, simulated)
    if not all(channel in compared.variables for _, channel in pairs):
        return None
    bodies = [str(body) for body in compared.body.values]
    rows = np.array([compared[channel].values[bodies.index(body)] for body, channel in pairs])
    usable = bool(pairs) and bool(np.isfinite(rows).all())
    return SimulatedRows(rows, compared["trust"].values, given=prescribed(simulated)) if usable else None


def _compared(part: Part, view: SimulatedRows) -> list[ChannelResidual]:
    found = []
    for (body, channel), noise, measured, row, weight in zip(
        part.rows, part.noise, part.measured, view.rows, part.weight, strict=True
    ):
        counted = float((weight**2).sum())
        least = MIN_LEVEL * float(np.sqrt(np.mean(measured**2)))
        if noise.source == RESIDUAL or counted < CRITERIA.min_noise_samples or noise.sigma <= MAX_FLOOR_RATIO * least:
            continue
        white = noise.whitened(measured - row, weight)
        chi2 = float(white @ white)
        excess, std = chi2 - CRITERIA.max_variance_ratio * counted, math.sqrt(2.0 * counted)
        ratio = math.sqrt(chi2 / counted)
        source, is_noise = part.source_of(noise), not significant(excess, std)
        found.append(ChannelResidual(part.name, body, channel, ratio, source, is_noise))
    return found
