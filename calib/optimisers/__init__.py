"""Optimisers in the unit cube: each asks for points, learns their outcomes, and knows nothing else of calib."""
