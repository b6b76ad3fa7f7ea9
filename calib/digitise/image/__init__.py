"""Curves out of the picture of a figure."""

from calib.digitise.image.picture import read_picture
from calib.digitise.image.trace import Traced, Wanted, traced

__all__ = ["Traced", "Wanted", "read_picture", "traced"]
