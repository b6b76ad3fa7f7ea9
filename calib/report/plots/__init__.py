"""Figures: each function draws one with matplotlib and knows nothing of pages."""
