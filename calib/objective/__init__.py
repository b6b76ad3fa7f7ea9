"""The distance of simulated records from measured ones."""

from calib.objective.alignment import trusted
from calib.objective.gross_errors import gross_errors, without_gross_errors
from calib.objective.initial_state import Released, initial_state, simulations, with_initial_state
from calib.objective.misfit import MISFIT, Squares, compared_rows, misfit, record_misfit, row_weights, squares_of
from calib.objective.objective import Objective
from calib.objective.prepared_reference import CLOCK_RATE
from calib.objective.scalar_features import FeatureValue
from calib.objective.terms import INITIAL_STATE, Feature, Reference, Score, Term

__all__ = [
    "CLOCK_RATE",
    "INITIAL_STATE",
    "MISFIT",
    "Feature",
    "FeatureValue",
    "Objective",
    "Reference",
    "Released",
    "Score",
    "Squares",
    "Term",
    "compared_rows",
    "gross_errors",
    "initial_state",
    "misfit",
    "record_misfit",
    "row_weights",
    "simulations",
    "squares_of",
    "trusted",
    "with_initial_state",
    "without_gross_errors",
]
