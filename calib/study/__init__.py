"""A calibration study: search, confirmation and result."""

from calib.execution.pool import Pool
from calib.study.confirmation import MAX_LEADERS, Confirmation, Leader, confirm, leaders
from calib.study.contracts import Optimiser, Outcome, StoreContract
from calib.study.evaluation import Evaluation, evaluate, outcome, simulated
from calib.study.initial_state import check_searched, check_solvable, check_stated
from calib.study.reachability import Reach, UnreachableFeature, reach
from calib.study.result import CalibrationResult, ConfidenceSummary, CorrelationSummary, ModelSummary, UndeterminedGroup
from calib.study.search import BUDGET_SPENT, SearchEnd
from calib.study.study import INTERRUPTED, CalibrationStudy, SearchResult

__all__ = [
    "BUDGET_SPENT",
    "CalibrationResult",
    "ConfidenceSummary",
    "CorrelationSummary",
    "UndeterminedGroup",
    "UnreachableFeature",
    "INTERRUPTED",
    "MAX_LEADERS",
    "Confirmation",
    "Evaluation",
    "Leader",
    "ModelSummary",
    "Optimiser",
    "Outcome",
    "Pool",
    "Reach",
    "SearchEnd",
    "SearchResult",
    "StoreContract",
    "CalibrationStudy",
    "check_searched",
    "check_solvable",
    "check_stated",
    "confirm",
    "evaluate",
    "leaders",
    "outcome",
    "reach",
    "simulated",
]
