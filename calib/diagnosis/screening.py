"""Score tests of all candidates on what a model leaves."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.diagnosis.candidate import Candidate
from calib.diagnosis.fit import Fit
from calib.diagnosis.refit import Fitter
from calib.diagnosis.score import Signature, score_test, threshold
from calib.diagnosis.signature import Slope
from calib.diagnosis.suspect import Scored, Screened, Untestable

NO_DERIVATIVE = "it has no derivative where it is absent, so no score test; it is judged by the samples themselves"


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Derivatives of the simulations by the free parameters of a candidate.

    Attributes
    ----------
    columns : (N, p) per unit of each parameter, in units of the noise
    relative_error : (p,) of each  [1]
    """

    columns: np.ndarray
    relative_error: np.ndarray


KnownDerivatives = dict[int, Derivatives]  # by the id of the candidate


def screened(
    fitter: Fitter, base: Fit, candidates: Sequence[Candidate], seed: int, known: KnownDerivatives | None = None
) -> tuple[list[Screened], float]:
    """Test all candidates on the residual of the model `base`: suspects, the strongest first, and the threshold of |z|.

    Parameters
    ----------
    known : derivatives that are not recomputed; those that are computed here are added
    """
    derivatives, reasons = _derivatives(fitter, base, candidates, {} if known is None else known)
    projection, segments = base.projection, fitter.evidence.segments()
    residual = projection(base.residual)
    signatures = {key: Signature.of(d.columns, projection, d.relative_error) for key, d in derivatives.items()}
    testable = [c for c in candidates if id(c) in signatures and id(c) not in reasons]
    limit = threshold([signatures[id(c)] for c in testable], segments, seed, [c.sign for c in testable])
    suspects: list[Screened] = []
    for candidate in candidates:
        key, reason = id(candidate), reasons.get(id(candidate), "")
        if key not in signatures:
            suspects.append(Untestable(candidate, reason))
            continue
        signature, columns = signatures[key], derivatives[key].columns
        test = score_test(residual, signature, segments)
        suspects.append(Scored(candidate, test, columns, signature, limit * test.error, reason))
    suspects.sort(key=lambda s: -s.predicted_reduction)
    return suspects, limit


def _derivatives(
    fitter: Fitter, base: Fit, candidates: Sequence[Candidate], known: KnownDerivatives
) -> tuple[dict[int, Derivatives], dict[int, str]]:
    """Derivatives of the candidates, and why they are missing or unreliable, each by the id of the candidate."""
    new = [c for c in candidates if c.effect.differentiable and id(c) not in known]
    reasons = {id(c): NO_DERIVATIVE for c in candidates if not c.effect.differentiable}
    derivatives = {id(c): known[id(c)] for c in candidates if id(c) in known}
    for candidate, slopes in zip(new, fitter.candidate_slopes(base, new), strict=True):
        key, reason = id(candidate), _unreliable(slopes)
        columns = [slope.column for slope in slopes if slope.column is not None]
        if len(columns) == len(slopes):
            errors = np.array([slope.relative_error for slope in slopes])
            derivatives[key] = Derivatives(np.column_stack(columns), errors)
            if not reason:
                known[key] = derivatives[key]
                continue
        reasons[key] = reason
    return derivatives, reasons


def _unreliable(slopes: Sequence[Slope]) -> str:
    """Why slopes are missing or unreliable; "" where they are reliable."""
    missing = next((slope.reason for slope in slopes if slope.column is None), None)
    return next((slope.reason for slope in slopes if not slope.reliable), "") if missing is None else missing
