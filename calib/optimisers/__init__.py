"""Optimisers in the unit cube: each asks for points, receives their outcomes, and imports of calib only `execution`."""
