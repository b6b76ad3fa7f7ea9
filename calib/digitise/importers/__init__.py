"""Curves from the files of other digitising tools."""

from calib.digitise.importers.read import SUFFIXES, Imported, read

__all__ = ["SUFFIXES", "Imported", "read"]
