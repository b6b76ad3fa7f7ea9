"""Optimisers in the unit cube: each asks for points, is told their outcomes, and knows nothing else of calib."""
