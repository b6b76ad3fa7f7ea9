"""The result of a calibration from its study, its trials and what was worked out at the best of them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from calib.objective import Score
from calib.records import OK
from calib.store import Trial
from calib.store.trial import failures
from calib.study.confirmation import Confirmation
from calib.study.result import (
    FAILED,
    CalibrationResult,
    ChannelResidual,
    ConfidenceSummary,
    ConfirmationSummary,
    FailureSummary,
    HeldOutSummary,
    LeaderSummary,
    ModelSummary,
    MotionSummary,
    ScoreSummary,
)
from calib.study.study import CalibrationStudy, SearchResult

NUISANCE_UNITS = {"trigger": "s", "offset": "m", "scale": "1", "shear": "s"}  # before the dot of its name


def summarised(
    study: CalibrationStudy,
    search: SearchResult,
    *,
    best: Trial | None = None,
    score: Score | None = None,
    confirmation: Confirmation | None = None,
    confidence: ConfidenceSummary | None = None,
    holdout: Mapping[str, HeldOutSummary] | None = None,
    residual: Sequence[ChannelResidual] = (),
    remarks: Sequence[str] = (),
    reproduced: bool | None = None,
    simulations: int | None = None,
    seconds: float = 0.0,
) -> CalibrationResult:
    """Put together what is known of a study; what is not known yet stays empty.

    Parameters
    ----------
    study : that was run
    search : as far as it has come
    best : the best trial, with its confirmed score where it was confirmed; None where none ended ok
    score : of the best point, for kind of motion and nuisances
    confirmation : of the leaders of the search, None where the simulator has no confirming one
    confidence : at the best point
    holdout : record -> what `held_out` or `not_simulated` returns
    residual, remarks : as in `CalibrationResult`
    reproduced : whether the best trial gave its logged score when it was evaluated again; None where it was not
    simulations : runs of the simulator, everything counted
    seconds : wall-clock time  [s]; it, and that of the confirmation, are all that differs between two runs of one study

    Returns
    -------
    the result as it is read back from its file: what is not finite is None
    """
    certainty = confidence or ConfidenceSummary("")
    names = () if best is None else tuple(best.values)
    result = replace(
        _of_search(study, search),
        status=FAILED if best is None else OK,
        values={} if best is None else best.values,
        units={name: study.model.parameters[name.partition("@")[0]].unit for name in names},
        intervals=certainty.interval,
        undetermined=certainty.undetermined,
        at_edge=tuple(sorted(certainty.at_edge)),
        score=ScoreSummary() if best is None else ScoreSummary(best.cost, best.terms),
        motion=_motion(best, score),
        nuisances={} if score is None else score.nuisances,
        nuisance_units=_nuisance_units(study, score, holdout or {}),
        holdout=holdout or {},
        confirmation=None if confirmation is None else _confirmation(confirmation),
        confidence=confidence,
        residual=tuple(residual),
        remarks=tuple(remarks),
        best_trial=None if best is None else best.number,
        reproduced=reproduced,
        simulations=simulations,
        seconds=seconds,
    )
    return CalibrationResult.from_dict(result.as_dict())


def _of_search(study: CalibrationStudy, search: SearchResult) -> CalibrationResult:
    """What the search says by itself."""
    return CalibrationResult(
        name=study.name,
        stopped=search.stopped,
        windows=study.space.windows,
        model=ModelSummary.of(study.model),
        unreachable=tuple(reach.summary() for reach in search.reach if not reach.reached),
        agreement=_agreement(search.agreement),
        trials=len(search.trials),
        failed=sum(trial.status != OK for trial in search.trials),
        failures=_failures(search.trials),
    )


def _motion(best: Trial | None, score: Score | None) -> MotionSummary:
    kind = None if best is None else best.kind
    return MotionSummary(kind) if score is None else MotionSummary(kind, score.evidence, tuple(score.wrong))


def _nuisance_units(
    study: CalibrationStudy, score: Score | None, holdout: Mapping[str, HeldOutSummary]
) -> dict[str, str]:
    """SI unit of each nuisance by name: of an initial state, that of the simulator's parameter."""
    known = {name: parameter.unit for name, parameter in study.model.parameters.items()} | NUISANCE_UNITS
    solved = [*(score.nuisances.values() if score else ()), *(held.nuisances for held in holdout.values())]
    names = dict.fromkeys(name for own in solved for name in own)
    return {name: known[name.partition(".")[0]] for name in names}


def _failures(trials: Sequence[Trial]) -> tuple[FailureSummary, ...]:
    """How many trials failed for which cause, the most frequent first, each with the reason of its first trial."""
    return tuple(FailureSummary(own[0].status, len(own), own[0].reason) for own in failures(trials))


def held_out(score: Score, misfit: float) -> HeldOutSummary:
    """How the best point predicts a record that was held out.

    Parameters
    ----------
    score : of the study's terms on that record alone
    misfit : as `calib.objective.MISFIT` has it  [1]
    """
    if score.status != OK:
        return not_simulated(score.status, score.reason)
    nuisances = {name: value for own in score.nuisances.values() for name, value in own.items()}
    return HeldOutSummary(misfit, score.cost, score.terms, score.kind, nuisances=nuisances)


def not_simulated(status: str, reason: str) -> HeldOutSummary:
    """Why a record that was held out could not be simulated at the best point."""
    return HeldOutSummary(status=status, reason=reason)


def _confirmation(confirmation: Confirmation) -> ConfirmationSummary:
    leaders = tuple(
        LeaderSummary(
            trial=leader.searched.number,
            searched=leader.searched.cost,
            confirmed=leader.confirmed.cost,
            status=leader.confirmed.status,
            reason=leader.confirmed.reason,
            kind=leader.confirmed.kind,
        )
        for leader in confirmation.leaders
    )
    return ConfirmationSummary(leaders, confirmation.chosen.searched.number, confirmation.changed, confirmation.seconds)


def _agreement(summary: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Return the optimiser's summary; "starts" and "agree" say how many starts ended at the best point."""
    if summary is None:
        return None
    return {"agree": summary["agree_in_point"], **summary} if "agree_in_point" in summary else dict(summary)
