"""Dynamics of any simulator through its period map: kinds of motion, exponents, multipliers, branches, basins."""
