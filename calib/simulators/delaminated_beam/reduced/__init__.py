"""The reduced kernel: modes drift exactly, and are kicked by membrane and contact forces between the drifts.

A period is divided into equal steps, each of which may be divided again. In flight one step is

    half a kick by the membrane force, exact drift of each mode under the drive, half a kick,

and where contact is near, the drift goes in parts, after each of which the contact forces move the modes (see
`contact`).
"""

from calib.simulators.delaminated_beam.reduced.plan import Drift, ReducedPlan, ReducedState, ReducedTrace
from calib.simulators.delaminated_beam.reduced.stepping import DIVERGED, DONE, advance

__all__ = ["DIVERGED", "DONE", "Drift", "ReducedPlan", "ReducedState", "ReducedTrace", "advance"]
