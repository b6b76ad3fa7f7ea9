"""Simulators: each turns values, an excitation and laws into a record; none knows another."""
