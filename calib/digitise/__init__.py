"""From a printed figure, or another tool's export of one, to a record."""

from calib.digitise.digitise import Digitised, digitise

__all__ = ["Digitised", "digitise"]
