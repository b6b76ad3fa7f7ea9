"""Emulators: fast approximations, with their uncertainty, of what simulations return over the unit cube."""
