"""One study as one page that opens offline and prints."""

from calib.report.page import render

__all__ = ["render"]
