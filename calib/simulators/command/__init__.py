"""Any external program as a simulator."""

from calib.simulators.command.command import Command

__all__ = ["Command"]
