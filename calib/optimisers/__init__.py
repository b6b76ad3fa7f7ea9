"""Optimisers in the unit cube: each asks for points, receives their outcomes, and imports nothing else of calib."""
