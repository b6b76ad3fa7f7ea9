"""A study: points are asked for, simulated, scored, logged and told."""

from calib.study.confirmation import LEADERS, Confirmation, Leader, confirm, leaders
from calib.study.contracts import Optimiser, Outcome, Pool, StoreContract
from calib.study.evaluation import Evaluation, evaluate, outcome
from calib.study.reachability import Reach, missed, reach
from calib.study.search import BUDGET
from calib.study.study import INTERRUPTED, Result, Study

__all__ = [
    "BUDGET",
    "INTERRUPTED",
    "LEADERS",
    "Confirmation",
    "Evaluation",
    "Leader",
    "Optimiser",
    "Outcome",
    "Pool",
    "Reach",
    "Result",
    "StoreContract",
    "Study",
    "confirm",
    "evaluate",
    "leaders",
    "missed",
    "outcome",
    "reach",
]
