"""The command line."""

from calib.cli.commands import main

__all__ = ["main"]
