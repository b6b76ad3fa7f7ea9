"""How far simulated records are from measured ones."""

from calib.objective.alignment import trusted
from calib.objective.misfit import MISFIT, Squares, compared_rows, misfit, record_misfit, row_weights, squares_of
from calib.objective.objective import Objective
from calib.objective.reach import FeatureValue
from calib.objective.terms import Feature, Reference, Score, Term

__all__ = [
    "MISFIT",
    "Feature",
    "FeatureValue",
    "Objective",
    "Reference",
    "Score",
    "Squares",
    "Term",
    "compared_rows",
    "misfit",
    "record_misfit",
    "row_weights",
    "squares_of",
    "trusted",
]
