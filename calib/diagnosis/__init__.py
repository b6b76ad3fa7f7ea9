"""Diagnosis: from the residual of a calibrated study to the effect that is missing in its model."""
