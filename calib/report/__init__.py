"""One study as one page that opens offline and prints."""

from calib.report.page import render, write

__all__ = ["render", "write"]
