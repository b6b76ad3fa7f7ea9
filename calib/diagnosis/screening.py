"""Score tests of all candidates on what a model leaves."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib.diagnosis.candidate import Candidate
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.excess import chi2_std, excess_chi2, significant
from calib.diagnosis.fit import Fit
from calib.diagnosis.refit import Fitter
from calib.diagnosis.score import Signature, score_test, threshold
from calib.diagnosis.signature import Slope, Step
from calib.diagnosis.suspect import Scored, Screened, Untestable

DEFERRED = "not tested: no simpler effect is near the threshold, and the model has no misfit"
NO_DERIVATIVE = "it has no derivative where it is absent, so no score test; it is judged by the samples themselves"


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Derivatives of the simulations by the free parameters of a candidate.

    Attributes
    ----------
    columns : (N, p) per unit of each parameter, in units of the noise
    relative_error : (p,) of each  [1]
    steps : with which they were taken, by the parameter's name
    """

    columns: np.ndarray
    relative_error: np.ndarray
    steps: Mapping[str, Step]


KnownDerivatives = dict[int, Derivatives]  # by the id of the candidate


def screened(
    fitter: Fitter,
    base: Fit,
    candidates: Sequence[Candidate],
    seed: int,
    known: KnownDerivatives | None = None,
    staged: bool = True,
) -> tuple[list[Screened], float]:
    """Test all candidates on the residual of the model `base`: suspects, the strongest first, and the threshold of |z|.

    Those that generalise others cost most, and change the records similarly to simpler ones: they are tested where any
    of these is near the threshold, or where the model has a misfit.

    Parameters
    ----------
    known : derivatives that are not recomputed; those that are computed here are added
    staged : whether those that generalise others wait for the simpler ones
    """
    known = {} if known is None else known
    simple = [c for c in candidates if not (staged and c.effect.generalises)]
    derivatives, reasons = _derivatives(fitter, base, simple, known)
    suspects, limit = _scored(fitter, base, simple, seed, derivatives, reasons)
    general = [c for c in candidates if staged and c.effect.generalises]
    if general and _shows(fitter, base, suspects, limit):
        more, why = _derivatives(fitter, base, general, known)
        suspects, limit = _scored(fitter, base, candidates, seed, {**derivatives, **more}, {**reasons, **why})
    else:
        suspects += [Untestable(c, DEFERRED, deferred=True) for c in general]
    return suspects, limit


def _shows(fitter: Fitter, base: Fit, suspects: Sequence[Screened], limit: float) -> bool:
    """Whether a suspect is near the threshold `limit` of |z|, or the model `base` has a misfit."""
    strongest = max((abs(s.z) for s in suspects if s.is_testable), default=0.0)
    misfit = significant(excess_chi2(fitter.evidence, base), chi2_std(fitter.evidence))
    return misfit or strongest > CRITERIA.min_general_share * limit


def _scored(
    fitter: Fitter,
    base: Fit,
    candidates: Sequence[Candidate],
    seed: int,
    derivatives: KnownDerivatives,
    reasons: Mapping[int, str],
) -> tuple[list[Screened], float]:
    """Score candidates by their derivatives; suspects, the strongest first, and the threshold of |z|."""
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
            taken = {p.name: s.taken for p, s in zip(candidate.parameters, slopes, strict=True) if s.taken}
            derivatives[key] = Derivatives(np.column_stack(columns), errors, taken)
            if not reason:
                known[key] = derivatives[key]
                continue
        reasons[key] = reason
    return derivatives, reasons


def _unreliable(slopes: Sequence[Slope]) -> str:
    """Why slopes are missing or unreliable; "" where they are reliable."""
    missing = next((slope.reason for slope in slopes if slope.column is None), None)
    return next((slope.reason for slope in slopes if not slope.reliable), "") if missing is None else missing
