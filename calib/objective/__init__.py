"""How far simulated records are from measured ones."""

from calib.objective.alignment import trusted
from calib.objective.initial_state import Released, simulations
from calib.objective.objective import Objective
from calib.objective.reach import FeatureValue
from calib.objective.terms import INITIAL_STATE, Feature, Reference, Score, Term

__all__ = [
    "INITIAL_STATE",
    "Feature",
    "FeatureValue",
    "Objective",
    "Reference",
    "Released",
    "Score",
    "Term",
    "simulations",
    "trusted",
]
