"""A suspect: a candidate without a score test, with one, or refitted."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TypeGuard, TypeVar

import numpy as np
import scipy

from calib.diagnosis.candidate import Candidate
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.fit import Fit
from calib.diagnosis.score import ScoreTest, Signature, deviate


@dataclass(frozen=True, eq=False)
class _OfCandidate:
    """The properties that every suspect has by its candidate.

    Attributes
    ----------
    candidate : the effect with its free parameters
    """

    candidate: Candidate

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.candidate.name

    @property
    def generalises(self) -> tuple[str, ...]:
        """Names of the effects that it contains as special cases."""
        return self.candidate.effect.generalises

    @property
    def parameter_count(self) -> int:
        """Number of its parameters that are fitted."""
        return len(self.candidate.free) + len(self.candidate.form)

    @property
    def aic_penalty(self) -> float:
        """Penalty of its parameters in AIC: two each (Akaike 1974)."""
        return 2.0 * self.parameter_count


@dataclass(frozen=True, eq=False)
class Untestable(_OfCandidate):
    """A suspect without a score test: simulations have no derivative by its parameters.

    Attributes
    ----------
    reason : why there is none
    deferred : whether it was not simulated, because simpler effects show nothing
    """

    reason: str
    deferred: bool = False
    predicted_reduction = known_reduction = z = absorbed = 0.0
    is_testable = False

    @property
    def size(self) -> np.ndarray:
        """Sizes (p,) at which the effect is absent  [units of the parameters]."""
        return self.candidate.null

    @property
    def error(self) -> np.ndarray:
        """Standard errors (p,): infinite, for the sizes are unknown."""
        return np.full(len(self.candidate.free), np.inf)

    @property
    def detectable(self) -> np.ndarray:
        """Smallest sizes (p,) that would reach the threshold: unknown."""
        return np.full(len(self.candidate.free), np.inf)

    @property
    def signature_columns(self) -> np.ndarray:
        """Signature (0, 0): there is none."""
        return np.zeros((0, 0))

    @property
    def half_width(self) -> np.ndarray:
        """Half widths (p,) of the 95 % intervals of the sizes: infinite."""
        return _half_width(self.error)

    def refitted(self, fit: Fit, chi2_reduction: float) -> "Refitted":
        """Return the suspect with the model that was refitted with it, and the reduction of chi-square."""
        return Refitted(self.candidate, self, fit, chi2_reduction)


@dataclass(frozen=True, eq=False)
class Scored(_OfCandidate):
    """A suspect with a score test.

    Attributes
    ----------
    test : the score test
    derivatives : (N, p) by its parameters, in units of the noise
    signature : their part that calibration does not absorb
    detectable : (p,) smallest sizes that would reach the threshold  [units of the parameters]
    reason : why its derivatives are not reliable; "" where they are
    """

    test: ScoreTest
    derivatives: np.ndarray
    signature: Signature
    detectable: np.ndarray
    reason: str = ""
    deferred = False

    @property
    def is_testable(self) -> bool:
        """Whether its score test is reliable."""
        return not self.reason

    @property
    def z(self) -> float:
        """Normal deviate of the score test."""
        return self.test.z

    @property
    def predicted_reduction(self) -> float:
        """Reduction of chi-square that the score test predicts."""
        return self.test.chi2_reduction

    @property
    def known_reduction(self) -> float:
        """Reduction of chi-square, as the score test predicts it."""
        return self.test.chi2_reduction

    @property
    def absorbed(self) -> float:
        """Share of the derivatives that calibration absorbs  [1]."""
        return self.signature.absorbed

    @property
    def size(self) -> np.ndarray:
        """Sizes (p,) by the score test  [units of the parameters]."""
        null = self.candidate.null
        return np.where(np.isfinite(null), null, 0.0) + self.test.size

    @property
    def error(self) -> np.ndarray:
        """Standard errors (p,) of the sizes."""
        return self.test.error

    @property
    def signature_columns(self) -> np.ndarray:
        """Signature (N, p)."""
        return self.signature.columns

    @property
    def half_width(self) -> np.ndarray:
        """Half widths (p,) of the 95 % intervals of the sizes."""
        return _half_width(self.error)

    def refitted(self, fit: Fit, chi2_reduction: float) -> "Refitted":
        """Return the suspect with the model that was refitted with it, and the reduction of chi-square."""
        return Refitted(self.candidate, self, fit, chi2_reduction)


@dataclass(frozen=True, eq=False)
class Refitted(_OfCandidate):
    """A suspect with which the model was refitted.

    Attributes
    ----------
    screened : the suspect before the refit
    fit : the model with it
    chi2_reduction : by the refit
    """

    screened: Untestable | Scored
    fit: Fit
    chi2_reduction: float

    @property
    def reason(self) -> str:
        """Why there is no reliable score test; "" where there is one."""
        return self.screened.reason

    @property
    def is_testable(self) -> bool:
        """Whether it has a reliable score test."""
        return self.screened.is_testable

    @property
    def z(self) -> float:
        """Normal deviate: of the score test, or of the refit where there is no reliable one.

        The latter by the quasi-likelihood: the model error that the refit leaves lowers it as it does that of scores.
        """
        if self.screened.is_testable:
            return self.screened.z
        dispersion = max(1.0, self.fit.chi2 / max(1, int(np.count_nonzero(self.fit.residual))))
        return float(deviate(self.chi2_reduction / dispersion, len(self.candidate.free)))

    @property
    def predicted_reduction(self) -> float:
        """Reduction of chi-square that the score test predicts; 0 without one."""
        return self.screened.predicted_reduction

    @property
    def known_reduction(self) -> float:
        """Reduction of chi-square by the refit."""
        return self.chi2_reduction

    @property
    def absorbed(self) -> float:
        """Share of the derivatives that calibration absorbs  [1]."""
        return self.screened.absorbed

    @property
    def detectable(self) -> np.ndarray:
        """Smallest sizes (p,) that would reach the threshold  [units of the parameters]."""
        return self.screened.detectable

    @property
    def signature_columns(self) -> np.ndarray:
        """Signature (N, p)."""
        return self.screened.signature_columns

    @property
    def size(self) -> np.ndarray:
        """Sizes (p,) of the refit, of one that could not begin those before it  [units of the parameters]."""
        return np.array([self.fit.value(n) for n in self.candidate.free]) if self.fit.names else self.screened.size

    @property
    def error(self) -> np.ndarray:
        """Standard errors (p,) of the sizes."""
        return self.fit.error(self.candidate.free) if self.fit.names else self.screened.error

    @property
    def half_width(self) -> np.ndarray:
        """Half widths (p,) of the 95 % intervals of the sizes."""
        return self.fit.half_width(self.candidate.free) if self.fit.names else self.screened.half_width

    def refitted(self, fit: Fit, chi2_reduction: float) -> "Refitted":
        """Return the suspect with another fit."""
        return replace(self, fit=fit, chi2_reduction=chi2_reduction)

    def within(self, fit: Fit) -> "Refitted":
        """Return the suspect as a cause of another model, with the form that it has there."""
        return replace(self, candidate=self.candidate.at(fit.point.values), fit=fit)


def _half_width(error: np.ndarray) -> np.ndarray:
    """Half widths (p,) of the 95 % intervals of sizes of these standard errors (p,)."""
    return float(scipy.stats.norm.isf(CRITERIA.tail_probability)) * error


Screened = Untestable | Scored
Suspect = Untestable | Scored | Refitted
S = TypeVar("S", Untestable, Scored, Refitted, Screened, Suspect)
Cause = tuple[Refitted, tuple[Refitted, ...]]  # a suspect that is a cause, and its rivals, itself included


def is_testable(suspect: Screened) -> TypeGuard[Scored]:
    """Whether a suspect has a reliable score test."""
    return suspect.is_testable


def leading_variants(suspects: Iterable[S]) -> list[S]:
    """The first variant of each effect, the best where suspects come in the order of what they explain."""
    leading: dict[str, S] = {}
    for suspect in suspects:
        leading.setdefault(suspect.name, suspect)
    return list(leading.values())


def cosine(one: Suspect, other: Suspect) -> float | None:
    """Cosine of the angle between what two suspects change in the records beyond calibration; None where unknown."""
    bases = []
    for suspect in (one, other):
        columns = suspect.signature_columns
        length = np.linalg.norm(columns, axis=0)
        if not length.any():
            return None
        bases.append(np.linalg.qr(columns[:, length > 0.0] / length[length > 0.0])[0])
    return min(1.0, float(np.linalg.norm(bases[0].T @ bases[1], 2)))
