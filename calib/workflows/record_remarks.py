"""What the calibrated model says of the records of a study."""

from collections.abc import Iterator

from calib.execution.pool import Failure
from calib.objective import Objective, gross_errors
from calib.records import OK, is_response
from calib.report.response_description import gross_errors_text
from calib.study import CalibrationStudy, Evaluation
from calib.workflows.amplitudes import implausible_amplitudes

MAX_FREE_TRIGGER_SHARE = 0.5  # of the distance: a free trigger is recommended where it leaves less


def record_remarks(study: CalibrationStudy, best: Evaluation | Failure | None) -> list[str]:
    """Name what the calibrated model shows to be wrong with the records, in sentences.

    Records of an implausible amplitude, those that fit far better if their start is left open, and points of frequency
    responses that are gross errors.

    best : the best trial, evaluated
    """
    if not isinstance(best, Evaluation) or best.score.status != OK:
        return []
    objective = study.objective
    tables = [name for name, stated in study.definition.get("records", {}).items() if "table" in stated]
    remarks = implausible_amplitudes(objective, best.records, tables)
    for name in objective.scored:
        check = _gross_errors if is_response(objective.references[name].record) else _free_trigger
        remarks += check(objective, name, best)
    return remarks


def _gross_errors(objective: Objective, name: str, best: Evaluation) -> Iterator[str]:
    frequencies = objective.references[name].record["frequency"].values
    gross = gross_errors(objective.aligned(name, best.records[name])["trust"].values)
    if gross.size:
        yield gross_errors_text(name, frequencies.size, (gross + 1).tolist(), frequencies[gross].tolist())


def _free_trigger(objective: Objective, name: str, best: Evaluation) -> Iterator[str]:
    reference, cost = objective.references[name], best.score.cost
    if not reference.excitation.periodic or "trigger" in reference.nuisance:
        return
    freed = objective.with_free_trigger(name)(best.records).cost
    if freed < MAX_FREE_TRIGGER_SHARE * cost:
        yield (
            f"were {name} to start at another instant of its period, the distance would be {freed:.2g} instead "
            f'of {cost:.2g}: give it nuisance = ["trigger"] unless its start is known'
        )
