"""Motions over a grid or a list of parameter values."""

from calib.sweep.plan import NONE, Sweep, latin_hypercube
from calib.sweep.run import run

__all__ = ["NONE", "Sweep", "latin_hypercube", "run"]
