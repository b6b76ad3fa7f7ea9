"""Diagnosis: from the residual of a calibrated study to the effect that its model lacks."""
