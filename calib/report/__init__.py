"""The report of a study: plots, and the page that holds them."""

from calib.report.pages.page import render

__all__ = ["render"]
