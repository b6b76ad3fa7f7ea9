"""Records as the posterior distribution of a study predicts them: draws of it simulated, piece by piece."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from calib.confidence.bands import PREDICTIVE, predicted_bands
from calib.confidence.document import PredictedChannelResult, PredictedRecordResult
from calib.confidence.posterior import Posterior
from calib.confidence.predictive import MIN_PREDICTIVE_TRUST, PREDICTIVE_DRAWS, PredictedChannel
from calib.diagnosis.noise import RESIDUAL, STATED, Noise
from calib.execution.pool import Failure
from calib.objective import Objective
from calib.records import OK, is_response
from calib.records.response import SIGMA_SOURCE, complex_amplitude
from calib.store.chunks import Chunks
from calib.study import Evaluation
from calib.study_file import StudyFile
from calib.workflows.evaluations import CALIBRATED, Case, Evaluations, held_out_references
from calib.workflows.predicted_amplitudes import noise_of_amplitudes, read_amplitudes, with_amplitude_channel
from calib.workflows.residual import beside_simulation

PREDICTIVE_STAGE = "predictive"
PREDICTIONS_FORMAT_VERSION = 2  # of the pieces: those of another are made anew
MAX_PREDICTED_SAMPLES = 4000  # of a record, from its begin on  [count]
MAX_PREDICTED_BODIES = 12  # of a record  [count]
MIN_DRAWS = 20  # that a record, and a point of a frequency response, needs for bands  [count]
NOISE_SOURCES = {RESIDUAL: "neighbouring samples of the residual"}  # the others say themselves what they are


@dataclass(frozen=True, eq=False)
class PredictedRecord:
    """A record beside what the posterior distribution predicts of it.

    Attributes
    ----------
    measured : the record, with the samples and bodies that are predicted; a frequency response with its `amplitude`
    held_out : whether it was not calibrated on
    period : of the motion [s], None without one
    channels : (body, channel) -> prediction; of those that are compared
    noise : (body, channel) -> noise
    trust : (n,) in a velocity; small beside an impact
    result : what confidence.json says of it
    """

    measured: xr.Dataset
    held_out: bool
    period: float | None
    channels: Mapping[tuple[str, str], PredictedChannel]
    noise: Mapping[tuple[str, str], Noise]
    trust: np.ndarray
    result: PredictedRecordResult


PredictedRecords = Mapping[str, PredictedRecord | PredictedRecordResult]  # by name; without bands: why not


@dataclass(frozen=True, eq=False)
class _Compared:
    """A record that is to be predicted, with its noise.

    Attributes
    ----------
    case : on which it is simulated
    objective : that aligns its simulations
    noise : of the rows (body, channel) that are predicted; empty where it cannot be predicted
    period : of the motion [s], None without one
    reason : why it cannot be predicted; "" where it can
    bodies_left_out : that are compared and not predicted
    """

    name: str
    case: Case
    objective: Objective
    noise: Mapping[tuple[str, str], Noise]
    period: float | None
    reason: str
    bodies_left_out: int = 0

    @property
    def measured(self) -> xr.Dataset:
        """The record with the samples that are predicted, and all bodies."""
        record = self.objective.references[self.name].record
        if is_response(record):
            return with_amplitude_channel(record).isel(point=slice(MAX_PREDICTED_SAMPLES))
        return record.isel(time=slice(MAX_PREDICTED_SAMPLES))

    def piece(self, answer: Evaluation | Failure) -> dict[str, np.ndarray]:
        """What is kept of a simulation: status, whether the motion is of another kind, rows (row, n), trust (n,)."""
        if isinstance(answer, Failure):
            return {"status": np.array(answer.status)}
        simulated = answer.records[self.name]
        status = simulated.attrs.get("status", OK)
        if status != OK:
            return {"status": np.array(status)}
        if self.objective.references[self.name].is_swept:
            return self._piece_of_response(simulated)
        aligned = self.objective.aligned(self.name, simulated).isel(time=slice(MAX_PREDICTED_SAMPLES))
        rows = np.array([aligned[channel].sel(body=body).values for body, channel in self.noise])
        wrong = self.name in answer.score.wrong
        return {
            "status": np.array(OK if np.isfinite(rows).all() else "not finite"), "wrong": np.array(wrong),
            "rows": rows, "trust": aligned["trust"].values,
        }  # fmt: skip

    def _piece_of_response(self, simulated: xr.Dataset) -> dict[str, np.ndarray]:
        """Amplitudes at the measured points, NaN where no stable motion reaches."""
        if not np.isfinite(complex_amplitude(simulated)).all():
            return {"status": np.array("not finite")}
        measured = self.measured
        bodies = measured.body.values.tolist()
        rows = read_amplitudes(simulated, measured)[[bodies.index(body) for body, _ in self.noise]]
        return {
            "status": np.array(OK if np.isfinite(rows).any() else "no stable motion"), "wrong": np.array(False),
            "rows": rows, "trust": np.ones(rows.shape[1]),
        }  # fmt: skip


def predicted_records(
    file: StudyFile,
    evaluations: Evaluations,
    sample: Posterior,
    best: Mapping[str, float],
    folder: Path,
    on_progress: Callable[[int, int], None] = lambda done, foreseen: None,
) -> PredictedRecords:
    """Simulate the first draws of a posterior distribution, which are in random order, on each record.

    Each simulation is kept in a piece until `folder` has the predictions: an interrupted run goes on.

    Parameters
    ----------
    best : values of the best point, about whose simulation the noise of a record is estimated where it is not stated
    on_progress : called with the number of simulations that are done, and of all

    Returns
    -------
    by name; of a record that cannot be predicted only what confidence.json says
    """
    draws = sample.points[:PREDICTIVE_DRAWS]
    compared = _compared(file, evaluations, best)
    pieces = _simulated(file, evaluations, [one for one in compared if one.noise], draws, folder, on_progress)
    return {
        one.name: _predicted(one, pieces[one.name])
        if one.noise
        else PredictedRecordResult(one.name, bool(one.case.record), 0, 0, 0, (), one.reason)
        for one in compared
    }


def _simulated(
    file: StudyFile,
    evaluations: Evaluations,
    records: Sequence[_Compared],
    draws: np.ndarray,
    folder: Path,
    on_progress: Callable[[int, int], None],
) -> dict[str, list[dict[str, np.ndarray]]]:
    """Pieces of each record by its name, one for each draw (draw, dim)."""
    cases = dict.fromkeys(one.case for one in records)
    tasks = [(case, k) for k in range(len(draws)) for case in cases]
    pieces: dict[tuple[str, int], dict[str, np.ndarray]] = {}
    with Chunks(folder / PREDICTIVE, _definition(file, draws)) as chunks:
        for number, one in enumerate(records):
            kept = chunks.finished(f"{k}-{number}" for k in range(len(draws)))
            pieces |= {(one.name, int(key.partition("-")[0])): arrays for key, arrays in kept.items()}
        missing = [
            (case, k) for case, k in tasks if any((one.name, k) not in pieces for one in records if one.case == case)
        ]
        done = len(tasks) - len(missing)
        on_progress(done, len(tasks))
        values = [(case, file.study.space.values(draws[k])) for case, k in missing]
        for index, answer in evaluations.each(values, PREDICTIVE_STAGE):
            case, k = missing[index]
            for number, one in enumerate(records):
                if one.case == case:
                    pieces[one.name, k] = one.piece(answer)
                    chunks.write(f"{k}-{number}", pieces[one.name, k])
            done += 1
            on_progress(done, len(tasks))
    return {one.name: [pieces[one.name, k] for k in range(len(draws))] for one in records}


def bands_of_records(records: PredictedRecords) -> dict[str, xr.Dataset]:
    """Bands of the records that are predicted, by name."""
    return {
        name: predicted_bands(one.measured, one.channels, one.trust, one.period)
        for name, one in records.items()
        if isinstance(one, PredictedRecord)
    }


def predictive_groups(records: PredictedRecords, seed: int) -> dict[str, xr.Dataset]:
    """Groups of ArviZ: draws of the samples, noise included, and what was measured.

    `posterior_predictive` has the records that were calibrated on, `predictions` those held out, each channel as
    RECORD.CHANNEL (chain, draw, body, time), and beside it the curve without noise as RECORD.CHANNEL.curve;
    `observed_data` has the samples that were measured. A frequency response has points in the place of time.
    """
    rng = np.random.default_rng(seed)
    groups: dict[str, dict[str, xr.DataArray]] = {}
    for name, one in records.items():
        if not isinstance(one, PredictedRecord):
            continue
        group = groups.setdefault("predictions" if one.held_out else "posterior_predictive", {})
        for channel in dict.fromkeys(channel for _, channel in one.channels):
            rows = [row for row in one.channels if row[1] == channel]
            key = f"{name}.{channel}".replace("/", "_")
            along = "point" if is_response(one.measured) else "time"
            dims = (f"{key}.body", f"{name}.{along}".replace("/", "_"))
            at = {dims[0]: [body for body, _ in rows], dims[1]: one.measured[along].values}
            curves = np.stack([one.channels[row].curves for row in rows], axis=1)[None]
            size = curves.shape[-1]
            kicks = [[one.noise[row].drawn(rng, size) for row in rows] for _ in range(curves.shape[1])]
            units = {"units": one.measured[channel].attrs.get("units", "1")}
            drawn = {**at, "chain": [0], "draw": np.arange(curves.shape[1])}
            group[key] = xr.DataArray(curves + np.array(kicks)[None], drawn, ("chain", "draw", *dims), attrs=units)
            group[f"{key}.curve"] = xr.DataArray(curves, drawn, ("chain", "draw", *dims), attrs=units)
            values = one.measured[channel].sel(body=at[dims[0]]).values
            groups.setdefault("observed_data", {})[key] = xr.DataArray(values, at, dims, attrs=units)
    return {name: xr.Dataset(variables) for name, variables in groups.items()}


def forget_pieces(folder: Path) -> None:
    """Delete the simulations that were kept in case of an interruption."""
    with Chunks(folder / PREDICTIVE, {}) as chunks:
        chunks.clear()


def predicted_results(records: PredictedRecords) -> tuple[PredictedRecordResult, ...]:
    """What confidence.json says of the predictions."""
    return tuple(one.result if isinstance(one, PredictedRecord) else one for one in records.values())


def predicted_simulations(file: StudyFile) -> int:
    """Number of evaluations that the predictions take."""
    return PREDICTIVE_DRAWS * (1 + len(held_out_references(file)))


def _definition(file: StudyFile, draws: np.ndarray) -> dict[str, Any]:
    header = file.study.header
    drawn = hashlib.sha256(np.ascontiguousarray(draws).tobytes()).hexdigest()
    return {"version": PREDICTIONS_FORMAT_VERSION, "study": header.definition, "code": dict(file.study.code),
            "draws": drawn}  # fmt: skip


def _compared(file: StudyFile, evaluations: Evaluations, best: Mapping[str, float]) -> list[_Compared]:
    """Records that are to be predicted, with their noise: those calibrated on, and those held out."""
    held = held_out_references(file)
    answers = evaluations.at(best, [Case(False), *(Case(False, name) for name in held)])
    objective = file.study.objective
    found = [_with_noise(name, Case(False), objective, answers[CALIBRATED]) for name in objective.scored]
    for name, reference in held.items():
        found.append(_with_noise(name, Case(False, name), objective.on({name: reference}), answers[name]))
    return found


def _with_noise(name: str, case: Case, objective: Objective, answer: Evaluation | Failure) -> _Compared:
    def unusable(reason: str) -> _Compared:
        return _Compared(name, case, objective, {}, None, reason)

    if isinstance(answer, Failure):
        return unusable(f"the best point cannot be simulated ({answer.status}: {answer.reason})")
    simulated = answer.records[name]
    if simulated.attrs.get("status", OK) != OK:
        return unusable(f"the best point cannot be simulated ({simulated.attrs['status']})")
    if objective.references[name].is_swept:
        return _with_noise_of_amplitudes(name, case, objective, noise_of_amplitudes(objective, name, simulated))
    beside = beside_simulation(objective, name, simulated)
    if beside is None:
        return unusable("its motion is irregular, or it has too few samples, or the simulation lacks a channel of it")
    part, _ = beside
    rows = [k for k, used in enumerate(part.used) if used.any()]
    compared = list(dict.fromkeys(part.rows[k][0] for k in rows))
    bodies = compared[:MAX_PREDICTED_BODIES]
    noise = {part.rows[k]: _of_predicted(part.noise[k]) for k in rows if part.rows[k][0] in bodies}
    if not noise:
        return unusable("the excitation prescribes all that is compared")
    period = None if part.period is None else part.cycle * part.period
    return _Compared(name, case, objective, noise, period, "", len(compared) - len(bodies))


def _with_noise_of_amplitudes(
    name: str, case: Case, objective: Objective, noise: Mapping[tuple[str, str], Noise]
) -> _Compared:
    """A frequency response with the noise of the amplitude of each body."""
    own = {row: _of_predicted(one) for row, one in list(noise.items())[:MAX_PREDICTED_BODIES]}
    reason = "" if own else "the excitation prescribes all that is compared"
    return _Compared(name, case, objective, own, None, reason, len(noise) - len(own))


def _of_predicted(noise: Noise) -> Noise:
    """Return the noise of those samples of a record that are predicted."""
    profile = np.asarray(noise.profile)
    return replace(noise, profile=profile[:MAX_PREDICTED_SAMPLES]) if profile.ndim else noise


def _predicted(one: _Compared, pieces: Sequence[Mapping[str, np.ndarray]]) -> PredictedRecord | PredictedRecordResult:
    held_out = bool(one.case.record)
    good = [piece for piece in pieces if str(piece["status"]) == OK]
    failed, wrong = len(pieces) - len(good), sum(bool(piece["wrong"]) for piece in good)
    if len(good) < min(MIN_DRAWS, len(pieces)):
        reason = f"{failed} of {len(pieces)} draws fail"
        return PredictedRecordResult(one.name, held_out, len(pieces), failed, wrong, (), reason)
    curves = np.array([piece["rows"] for piece in good])
    reached = np.isfinite(curves[:, 0])  # the same of all rows
    curves = np.where(reached.sum(axis=0) < min(MIN_DRAWS, len(pieces)), np.nan, curves)
    trust = np.median([piece["trust"] for piece in good], axis=0)
    measured = one.measured.sel(body=list(dict.fromkeys(body for body, _ in one.noise)))
    left_out = one.objective.references[one.name].abscissa.size - trust.size
    levels = {row: noise.sigma * noise.profile for row, noise in one.noise.items()}
    channels = {row: PredictedChannel(curves[:, k], level) for k, (row, level) in enumerate(levels.items())}
    told = tuple(
        _channel_result(body, channel, channels[body, channel], noise, measured, trust)
        for (body, channel), noise in one.noise.items()
    )
    result = PredictedRecordResult(
        one.name, held_out, len(pieces), failed, wrong, told, "", left_out, one.bodies_left_out,
        1.0 - float(reached.mean()), int(np.isnan(curves[:, 0]).all(axis=0).sum()),
    )  # fmt: skip
    return PredictedRecord(measured, held_out, one.period, channels, one.noise, trust, result)


def _channel_result(
    body: str, channel: str, own: PredictedChannel, noise: Noise, measured: xr.Dataset, trust: np.ndarray
) -> PredictedChannelResult:
    values = measured[channel].sel(body=body).values
    reliable = (channel != "velocity") | (trust >= MIN_PREDICTIVE_TRUST)
    counted = np.isfinite(values) & np.isfinite(own.median) & reliable
    sources = {**NOISE_SOURCES, STATED: str(measured.attrs.get(SIGMA_SOURCE, STATED))}
    share = own.inside(np.where(counted, values, 0.0), counted)
    return PredictedChannelResult(
        body, channel, None if np.isnan(share) else share, int(counted.sum()), noise.sigma,
        measured[channel].attrs.get("units", "1"), sources.get(noise.source, noise.source),
    )  # fmt: skip
