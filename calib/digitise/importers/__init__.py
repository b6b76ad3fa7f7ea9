"""Curves out of the files that other digitising tools leave behind."""

from calib.digitise.importers.read import SUFFIXES, Imported, read

__all__ = ["SUFFIXES", "Imported", "read"]
