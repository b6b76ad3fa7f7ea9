"""Stand-ins for evidence of which every simulation is reliable, and for models of known chi-square."""

from types import SimpleNamespace

import numpy as np


def everywhere(samples):
    """Evidence of so many residuals; models are compared in all of them."""
    evidence = SimpleNamespace(counted=lambda: float(samples))
    evidence.where_reliable = lambda simulated: evidence
    return evidence


def model(chi2, chi2_where_reliable=None, **attributes):
    """Model of no parameter, of this chi-square; of another one where the simulations are reliable."""
    nothing, over = np.zeros((0, 0)), chi2 if chi2_where_reliable is None else chi2_where_reliable
    known = {"point": SimpleNamespace(simulated={}), "columns": nothing, "nuisances": nothing, **attributes}
    return SimpleNamespace(chi2=chi2, chi2_over=lambda evidence: over, **known)
