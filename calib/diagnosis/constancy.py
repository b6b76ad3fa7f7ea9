"""Whether sizes that are fitted to all records are the same in each channel of each record.

Several effects together may imitate one that nobody thought of, but hardly with the same sizes everywhere. This is the
score test of parameters' constancy (Nyblom 1989, J. Am. Stat. Assoc. 84, 223): each size is freed in each channel of
each record, and what that would explain of the residual is tested.
"""

import numpy as np

from calib.diagnosis.evidence import Evidence
from calib.diagnosis.refit import Fit
from calib.diagnosis.score import Signature, tested


def inconstancy(evidence: Evidence, fit: Fit) -> float:
    """Normal deviate by which the sizes of the effects in a fit differ among the channels of the records  [1].

    0 where there is but one channel that they act on.

    Parameters
    ----------
    evidence : that the fit was made to
    fit : with its derivatives
    """
    sizes = [fit.names.index(name) for c in fit.found for name in (*c.free, *c.form)]
    rows = evidence.rows()
    alone = rows[:, None] == np.arange(rows.max() + 1)
    columns = np.column_stack([fit.columns[:, [index]] * alone for index in sizes])
    absorbing = fit.absorbing
    signature = Signature.of(columns, absorbing, np.zeros(columns.shape[1]))
    # of a single column z has the sign of its size
    return abs(tested(absorbing(fit.residual), signature, evidence.segments()).z)
