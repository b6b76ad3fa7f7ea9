"""Readers of the output files of external programs."""

from calib.simulators.command.readers.columns import Columns
from calib.simulators.command.readers.registry import check_options, reader, reader_code

__all__ = ["Columns", "check_options", "reader", "reader_code"]
