"""What the templates of a run are given: parameters, excitation and request."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Request
from calib.records.excitation import Excitation
from calib.simulators.command.templates import Fields, TemplateText, ValueWithUnit, named_fields

EXCITATION_FIELDS = (
    "quantity", "place", "unit", "harmonic", "recorded", "periodic", "frequency", "period", "omega", "amplitude",
    "phase", "time", "value", "samples",
)  # fmt: skip
TOLD_BY = {
    "frequency": ("frequency", "period", "omega"),
    "amplitude": ("amplitude",),
    "phase": ("phase",),
    "value": ("value", "samples"),
    "place": ("place", "quantity"),
}  # what distinguishes two excitations -> fields of which a template has to name one, to tell them apart
REQUEST_FIELDS = ("periods", "samples", "settle", "step", "start", "end", "times", "step_budget")
KNOWN = {"excitation": EXCITATION_FIELDS, "request": REQUEST_FIELDS, "cores": ()}


def ignored_parts(templates: Sequence[TemplateText]) -> dict[str, str]:
    """Parts of an excitation that no template names, each with what to do where it matters."""
    named = named_fields(templates, "excitation")
    return {
        part: f"no template names {' or '.join(f'excitation.{field}' for field in fields)}: write it where it belongs, "
        "or in a comment of the deck where the program knows it from elsewhere"
        for part, fields in TOLD_BY.items()
        if named is not None and named.isdisjoint(fields)
    }


def output_times(excitation: Excitation, request: Request, settle: int) -> np.ndarray:
    """Instants (n,) [s] of the program's own time at which its motion is recorded, after `settle` periods.

    Raises
    ------
    CalibError : without a period nobody has said which
    """
    if excitation.harmonic:
        step = excitation.as_harmonic.period / request.samples
        return step * (settle * request.samples + np.arange(request.periods * request.samples))
    if not excitation.recorded:
        return request.output_times(None)
    recorded = excitation.as_samples.time
    return request.output_times(recorded[recorded >= 0.0])


def deck_values(
    parameters: Sequence[Parameter],
    values: Mapping[str, float],
    excitation: Excitation,
    request: Request,
    settle: int,
    cores: int,
) -> dict[str, object]:
    """Everything that a template may name; what does not apply, such as the frequency of a free decay, is undefined."""
    return {
        **{p.name: ValueWithUnit(values[p.name], p.unit, p.name) for p in parameters},
        "excitation": _excitation_fields(excitation),
        "request": _request_fields(excitation, request, settle),
        "cores": cores,
    }


def _excitation_fields(excitation: Excitation) -> Fields:
    fields = Fields(
        quantity=excitation.quantity,
        place=excitation.place,
        unit=excitation.unit,
        harmonic=excitation.harmonic,
        recorded=excitation.recorded,
        periodic=excitation.periodic,
        phase=ValueWithUnit(excitation.phase, "rad", "excitation.phase"),
    )
    if excitation.frequency is not None:
        fields["frequency"] = ValueWithUnit(excitation.frequency, "Hz", "excitation.frequency")
        fields["period"] = ValueWithUnit(1.0 / excitation.frequency, "s", "excitation.period")
        fields["omega"] = ValueWithUnit(2.0 * math.pi * excitation.frequency, "rad/s", "excitation.omega")
    if excitation.amplitude is not None:
        fields["amplitude"] = ValueWithUnit(excitation.amplitude, excitation.unit, "excitation.amplitude")
    if excitation.recorded:
        samples = excitation.as_samples
        fields["time"] = [ValueWithUnit(t, "s", "excitation.time") for t in samples.time.tolist()]
        fields["value"] = [ValueWithUnit(v, excitation.unit, "excitation.value") for v in samples.value.tolist()]
        fields["samples"] = [
            Fields(time=time, value=value) for time, value in zip(fields["time"], fields["value"], strict=True)
        ]
    return fields


def _request_fields(excitation: Excitation, request: Request, settle: int) -> Fields:
    times = output_times(excitation, request, settle)
    step = (times[-1] - times[0]) / (times.size - 1)
    fields = Fields(
        step=ValueWithUnit(float(step), "s", "request.step"),
        start=ValueWithUnit(float(times[0]), "s", "request.start"),
        end=ValueWithUnit(float(times[-1]), "s", "request.end"),
        times=[ValueWithUnit(t, "s", "request.times") for t in times.tolist()],
        step_budget=request.step_budget,
    )
    if excitation.harmonic:
        period = excitation.as_harmonic.period
        fields["end"] = ValueWithUnit((settle + request.periods) * period, "s", "request.end")
        fields |= {"periods": request.periods, "samples": request.samples, "settle": settle}
    return fields
