"""The kind of the motion that a period map settles to, with its evidence."""

import math
from dataclasses import dataclass, field

import numpy as np

from calib.dynamics.escape import EscapeTime
from calib.modelling.orbit import Orbit
from calib.records import OK

QUASI_PERIODIC, CHAOTIC, FAILED = "quasi-periodic", "chaotic", "failed"
NEUTRAL_EXPONENT = 1e-3  # indistinguishable from zero: some 1/n of a torus over n = 3200 periods  [1/period]


@dataclass(frozen=True, eq=False)
class OrbitKind:
    """Kind of the motion that a map settles to from a state, with its evidence.

    Attributes
    ----------
    kind : "no contact" (period-1, at a stop it never touches), "period-1" (2, ...), "quasi-periodic", "chaotic",
        "undecided" or "failed"
    evidence : one sentence with the numbers
    orbit : the kept cycles; of a failed motion, the piece that failed
    state : (dimension,) the last one; of a failed motion, the one that the piece that failed begins with
    dropped : periods before the kept ones
    period : periods of the excitation after which the motion returns, 0 where it does not
    impacts : in one return, the mean rounded where it varies; -1 where it does not return
    exponent : largest one; of a periodic motion from its multipliers; NaN where unknown, -inf where a phase of contact
        wipes all differences out  [1/period]
    error : standard error of the exponent, 0 for a periodic motion  [1/period]
    zero_one : K of the 0-1 test, NaN where it was not needed  [1]
    status, reason : of the orbit
    visited : (n, dimension) states at the section, one a period, by which an irregular motion was judged
    laminar : whether it is undecided because it is in a laminar phase, near an unstable cycle
    runs, share : from starts that differ imperceptibly, and the share of them that led to this motion; 0 where it was
        found by Newton's method, or from a neighbouring value of a sweep, alone  [1]
    sightings : independent ones of a regular motion, by runs and by Newton's method; 3 are enough for it to be certain
    coexisting : the other motions that were met
    escape : lifetime of the irregular motion that leads to this one or lies beside it; None where there is none
    certain : whether another rounding would have led to the same kind
    run_state : (dimension,) the last state of the run from the given start, which may stay irregular where a stable
        motion beside it gives the kind; None where that is `state`
    """

    kind: str
    evidence: str
    orbit: Orbit
    state: np.ndarray
    dropped: int
    period: int = 0
    impacts: int = -1
    exponent: float = math.nan
    error: float = math.nan
    zero_one: float = math.nan
    status: str = OK
    reason: str = ""
    visited: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    laminar: bool = False
    runs: int = 1
    share: float = 1.0
    sightings: int = 3
    coexisting: tuple["OrbitKind", ...] = ()
    escape: EscapeTime | None = None
    certain: bool = True
    run_state: np.ndarray | None = None

    @property
    def regular(self) -> bool:
        """Whether the motion is a stable periodic or a quasi-periodic one."""
        return self.kind == QUASI_PERIODIC or bool(self.period and not self.exponent > NEUTRAL_EXPONENT)

    @property
    def impacts_per_period(self) -> float:
        """Impacts per period of the excitation over the kept cycles, in whole returns; NaN without any cycle."""
        if not len(self.orbit.states):
            return math.nan
        whole = self.period if 0 < self.period <= len(self.orbit.states) else 1
        return mean_impacts(self.orbit, whole)

    @property
    def contact(self) -> float:
        """Share of the kept cycles spent in permanent contact [1]."""
        return self.orbit.contact

    @property
    def label(self) -> str:
        """Impacts over periods of one return, such as "3/2"; the kind where the motion does not return."""
        return f"{self.impacts}/{self.period}" if self.period else self.kind


def mean_impacts(orbit: Orbit, period: int) -> float:
    """Impacts per period of the excitation, over the whole returns."""
    whole = len(orbit.states) // period * period
    return float((orbit.impacts[:, 0] < whole).sum()) / whole
