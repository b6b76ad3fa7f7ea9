"""Curves out of the picture of a figure."""

from calib.digitise.image.picture import read_picture
from calib.digitise.image.trace import CurveRequest, Trace, traced

__all__ = ["Trace", "CurveRequest", "read_picture", "traced"]
