"""Frequency responses over their levels: equivalent damping and resonance frequency as functions of the amplitude."""
