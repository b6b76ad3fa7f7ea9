"""The simulator `fmu`: an FMU of FMI 2.0 or 3.0, run by fmpy."""

from calib.simulators.fmu.fmu import Fmu

__all__ = ["Fmu"]
