"""Runs of an FMU with a fault, in child processes."""

from impact_fmu.peer import DRIVE

from calib.modelling.model import Model
from calib.modelling.simulator import Request

SHORT = Request(periods=1, samples=20, settle=0)


def status_with(model: Model, fault: float) -> str:
    """Status of a run whose FMU has a fault of this number."""
    return model.run({"fault": fault}, DRIVE, SHORT).attrs["status"]
