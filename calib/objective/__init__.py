"""How far simulated records are from measured ones."""

from calib.objective.alignment import trusted
from calib.objective.objective import Objective
from calib.objective.reach import FeatureValue
from calib.objective.terms import Feature, Reference, Score, Term

__all__ = ["Feature", "FeatureValue", "Objective", "Reference", "Score", "Term", "trusted"]
