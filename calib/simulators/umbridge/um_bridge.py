"""The simulator `umbridge`: a model of UM-Bridge as a simulator."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.modelling.laws import BoundLaw
from calib.modelling.simulator import Request
from calib.modelling.simulator_check import check_driven
from calib.records import MIN_SECTION_PERIODS, STATE, failed, make
from calib.records.excitation import Excitation
from calib.simulators.umbridge.client import Client, EvaluationFailed
from calib.simulators.umbridge.options import (
    OutputChannel,
    block_values,
    check_inputs,
    filled,
    named_in,
    output_channels,
    output_times,
    scaled_parameters,
    seconds,
    taken_excitation,
    told,
)

WHOLE = 1e-6  # of a period: by so much an answer may miss whole periods


class UmBridge:
    """A model that a UM-Bridge server offers over HTTP (extra `calib[umbridge]`).

    UM-Bridge knows vectors of numbers: the options say which number is what. Names of the excitation and the request
    stand for what a record states, in SI: "excitation.frequency" [Hz], "excitation.amplitude", "excitation.phase"
    [rad], "request.periods", "request.samples", "request.settle" and, as whole vectors, "request.times" and, of a
    recorded input, "excitation.time" and "excitation.value".

    Attributes
    ----------
    url : of the server, such as "http://localhost:4242"
    model : its name there
    parameters : nominal values, each with the unit in which the model takes it: `{ stiffness = "4 kN/m", loss = 0.02 }`
    inputs : the input vectors: `[["stiffness", "loss"], ["excitation.frequency", 9.81], "request.times"]`, of names of
        parameters, of the names above and of numbers; a vector of its own is a name alone
    outputs : for each body its channels and the index of their output vector: `{ mass = { displacement = 0 } }`, or
        `{ output = 0, first = 200, unit = "mm" }` for a vector in another unit, or one that holds several channels
    excitation : what the records have to be driven by, `{ quantity = "force", place = "mass" }`; built_in = true where
        the model is told nothing of it. Without it, only free decays are simulated
    config : of the model; a text that is one of the names above is replaced by what it stands for
    times : when the samples of an answer are: "requested" (default), at the times that "request.times" names; as an
        output vector says, `{ output = 2, unit = "ms" }`; or `{ start = "0 s", step = "1 ms" }`. Of these two the last
        whole periods are recorded, interpolated linearly
    section : periods of the stroboscopic section that are requested, at least
    timeout : of one evaluation, such as "5 min"; default: that of the study. What the server computes goes on
    wait : for a server that is away, before an evaluation fails
    """

    name = "umbridge"
    sites = frozenset[str]()
    incidental = frozenset({"timeout", "wait"})  # options without influence on records

    def __init__(
        self,
        url: str,
        model: str,
        parameters: Mapping[str, str | float],
        inputs: Sequence[Any],
        outputs: Mapping[str, Mapping[str, Any]],
        excitation: Mapping[str, Any] | None = None,
        config: Mapping[str, Any] | None = None,
        times: Any = "requested",
        section: int = MIN_SECTION_PERIODS,
        timeout: str | float | None = None,
        wait: str | float = "30 s",
    ) -> None:
        self._scaled = scaled_parameters(parameters)
        self.parameters = tuple(scaled.parameter for scaled in self._scaled)
        check_inputs(inputs, [p.name for p in self.parameters])
        self._blocks = list(inputs)
        if not isinstance(config or {}, Mapping):
            raise CalibError(f"config: expected a table, got {config!r}")
        self._config = dict(config or {})
        self._outputs = output_channels(outputs)
        self._times = output_times(times)
        self.bodies = tuple(outputs)
        entries = [entry for block in inputs for entry in ([block] if isinstance(block, str) else block)]
        self._named = [*named_in(entries), *named_in(self._config)]
        self.excitations = taken_excitation(excitation, self._named, self.bodies)
        if isinstance(section, bool) or not isinstance(section, int) or section < 1:
            raise CalibError(f"section: expected a whole number of periods from 1 on, got {section!r}")
        self._section = section
        limit = None if timeout is None else seconds(timeout, "timeout")
        if limit == 0.0:
            raise CalibError(f"timeout: expected a time above 0 s, got {timeout!r}")
        self._client = Client(url, model, limit, seconds(wait, "wait"))
        self._client.check()
        if not any(named_in(self._config)):
            self._check_sizes()

    def run(
        self, values: Mapping[str, float], excitation: Excitation, laws: Sequence[BoundLaw], request: Request
    ) -> xr.Dataset:
        """Evaluate the model at `values` (SI); what goes wrong on the way is a failed record.

        The step budget counts samples.

        Raises
        ------
        CalibError : an excitation that it cannot take, or of which it lacks something that the model is told
        """
        self.check(excitation, request)
        attrs: dict[str, Any] = {"source": self.name, **excitation.attributes}
        periods = max(request.periods, self._section)
        times = _times(excitation, request, periods)
        for name, value in values.items():
            if not math.isfinite(value):
                return failed(self.bodies, "impossible value", f"{name} is {value}", **attrs)
        if times.size > request.step_budget:
            reason = f"{times.size} samples are more than {request.step_budget}"
            return failed(self.bodies, "step budget", reason, **attrs)
        scaled = {one.parameter.name: values[one.parameter.name] / one.factor for one in self._scaled}
        given = told(excitation, request, periods, times)
        inputs = [block_values(block, scaled, given) for block in self._blocks]
        try:
            answer = self._client.evaluate(inputs, filled(self._config, given))
            stamps, channels = self._series(answer, times)
            return self._record(stamps, channels, excitation, request, times, attrs)
        except EvaluationFailed as failure:
            return failed(self.bodies, failure.status, failure.reason, **attrs)

    def check(self, excitation: Excitation, request: Request) -> None:
        """Refuse an excitation that the model is not told of, or that lacks what it is told, and impossible times.

        Raises
        ------
        CalibError : with what it takes
        """
        check_driven(self.name, excitation, self.excitations)
        given = told(excitation, request, 1, _times(excitation, request, 1))
        missing = [name for name in self._named if name not in given]
        if missing:
            raise CalibError(
                f"the model is told {', '.join(missing)}, which this record's excitation lacks; use another record, or "
                "mend inputs and config"
            )

    def _check_sizes(self) -> None:
        """Check the numbers in the input vectors that are lists against those that the model takes.

        Raises
        ------
        CalibError : they differ, or the server does not tell
        """
        try:
            sizes = self._client.input_sizes(self._config)
        except EvaluationFailed as failure:
            raise CalibError(
                f"inputs: the model does not tell their sizes ({failure.reason}); mend config"
            ) from failure
        own = [len(block) for block in self._blocks if not isinstance(block, str)]
        taken = [n for n, block in zip(sizes, self._blocks, strict=False) if not isinstance(block, str)]
        if len(sizes) != len(self._blocks) or own != taken:
            raise CalibError(
                f"inputs: model {self._client.model!r} takes {len(sizes)} vectors of {', '.join(map(str, sizes))} "
                f"numbers, got {len(self._blocks)} of "
                f"{', '.join(b if isinstance(b, str) else str(len(b)) for b in self._blocks) or '-'}"
            )

    def _series(self, answer: Sequence[Sequence[float]], times: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Times (n,) [s] of an answer, and its channels (body, n) in SI.

        Raises
        ------
        EvaluationFailed : an output vector is missing, of a wrong size, or holds what is no finite number
        """
        stated, stamps = self._times, times
        if stated is not None and stated.output is not None:
            stamps = stated.factor * _vector(answer, stated.output)
        count = None if stated is not None and stated.step else stamps.size
        channels: dict[str, list[np.ndarray]] = {}
        for output in self._outputs:
            channels.setdefault(output.channel, []).append(output.factor * _samples(answer, output, count))
        sizes = {rows.size for bodies in channels.values() for rows in bodies}
        if len(sizes) > 1 or min(sizes) < 2:
            found = ", ".join(map(str, sorted(sizes)))
            raise EvaluationFailed("wrong size", f"channels of {found} samples; all have the same number, at least two")
        if stated is not None and stated.step:
            stamps = stated.start + stated.step * np.arange(sizes.pop())
        if not (np.diff(stamps) > 0.0).all():
            raise EvaluationFailed("wrong size", "the times of the answer do not increase")
        return stamps, {name: np.array(bodies) for name, bodies in channels.items()}

    def _record(
        self,
        stamps: np.ndarray,
        channels: Mapping[str, np.ndarray],
        excitation: Excitation,
        request: Request,
        times: np.ndarray,
        attrs: Mapping[str, Any],
    ) -> xr.Dataset:
        units = {output.channel: output.si for output in self._outputs}
        if not excitation.harmonic:
            _check_range(stamps, times)
            sampled = {name: _interpolated(times, stamps, values) for name, values in channels.items()}
            return make(times, self.bodies, sampled, units, **attrs)
        period = excitation.as_harmonic.period
        first = math.ceil(stamps[0] / period - WHOLE)
        last = math.floor(stamps[-1] / period + 1.0 / request.samples + WHOLE)  # of the samples, one is period - step
        if last - first < request.periods:
            raise EvaluationFailed(
                "wrong size",
                f"the answer lasts from {stamps[0]:.6g} to {stamps[-1]:.6g} s, not {request.periods} whole periods",
            )
        recorded = np.arange(request.periods * request.samples) * period / request.samples
        phases = (last - request.periods) * period + recorded
        section = {
            name: _interpolated(period * np.arange(first, last), stamps, channels[name])
            for name in STATE
            if name in channels
        }
        sampled = {name: _interpolated(phases, stamps, values) for name, values in channels.items()}
        return make(recorded, self.bodies, sampled, units, section=section, **attrs)


def _times(excitation: Excitation, request: Request, periods: int) -> np.ndarray:
    """Requested times (n,) [s]: of a harmonic excitation, those of `periods`.

    Raises
    ------
    CalibError : a free decay without times, fewer than two, or not increasing
    """
    if excitation.harmonic:
        return np.arange(periods * request.samples) / (excitation.as_harmonic.frequency * request.samples)
    return request.output_times(excitation.as_samples.time if excitation.recorded else None)


def _vector(answer: Sequence[Sequence[float]], index: int) -> np.ndarray:
    if index >= len(answer):
        raise EvaluationFailed("wrong size", f"the answer has {len(answer)} output vectors, none with index {index}")
    try:
        vector = np.array(answer[index], dtype=float)
    except (TypeError, ValueError) as error:
        raise EvaluationFailed("bad answer", f"output vector {index} holds what is no number") from error
    if not np.isfinite(vector).all():
        raise EvaluationFailed("diverged", f"output vector {index} holds a number that is not finite")
    return vector


def _samples(answer: Sequence[Sequence[float]], output: OutputChannel, count: int | None) -> np.ndarray:
    """Samples (n,) of a channel, of which there are `count` where this is known."""
    vector = _vector(answer, output.output)
    where = f"output vector {output.output}"
    if output.first is None:
        if count is not None and vector.size != count:
            raise EvaluationFailed("wrong size", f"{where} has {vector.size} samples, expected {count}")
        return vector
    end = vector.size if count is None else output.first + count
    if vector.size < end or output.first >= end:
        raise EvaluationFailed(
            "wrong size", f"{where} has {vector.size} numbers, expected samples from {output.first} to {end}"
        )
    return vector[output.first : end]


def _interpolated(times: np.ndarray, stamps: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values (body, n) at `times` of those (body, m) at `stamps`."""
    return np.array([np.interp(times, stamps, row) for row in values])


def _check_range(stamps: np.ndarray, times: np.ndarray) -> None:
    reach = WHOLE * (times[-1] - times[0])
    if stamps[0] > times[0] + reach or stamps[-1] < times[-1] - reach:
        raise EvaluationFailed(
            "wrong size",
            f"the answer lasts from {stamps[0]:.6g} to {stamps[-1]:.6g} s, not {times[0]:.6g} to {times[-1]:.6g} s",
        )
