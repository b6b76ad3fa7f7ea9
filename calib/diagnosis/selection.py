"""One cause after the other: who is suspected, who explains it, what cannot be told apart."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy import stats

from calib.diagnosis.candidate import Candidate
from calib.diagnosis.constancy import Constancy, constancies
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.prediction import Prediction, predicted
from calib.diagnosis.refit import LEVEL, Fit, Fitter
from calib.diagnosis.score import Signature, Tested, deviate, tested, threshold

APART = 6.0  # sums of squares, the price of parameters added, that differ by less do not tell two models apart
REFITS = 8  # leaders that are refitted
WORTH = 0.3  # of the largest fall of the sum of squares: candidates that promise less are no leaders
CAUSES = 3  # that are named at most
STARTS = 2  # sizes from which a candidate without derivative is refitted
BENT = 0.25  # of what a derivative promises: a fit that brings so much more or less is of something far from linear
PROMISING = 0.5  # of the threshold's square: what such a size has to promise
HALF = 0.5  # of the excess that causes must explain to be named
GROSS = 0.5  # of the variance of the noise's sum of squares, which is as much as its mean: more is mostly not noise
MARKED = 3.0  # standard deviations by which a sum of squares must exceed the noise to be a misfit
NIBBLE = 0.25  # of what is left: a further cause that explains less is none
CRUMB = 0.01  # of what the calibrated model leaves: what so little is left or gained says nothing of a cause
ABSORBED = 0.9999  # share of a signature beyond which calibration takes all of it

Known = dict[int, tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class Suspect:
    """A candidate beside the evidence.

    Attributes
    ----------
    candidate : the effect with its free parameters
    test : the score test; None where there is no derivative
    absorbed : share of the signature that calibration takes over
    detectable : (p,) smallest sizes that would reach the threshold  [units of the parameters]
    raw, signature : derivatives (N, p) by its parameters; what calibration leaves of them; None where there are none
    fit : the model with it, refitted; None where that was not worth the while
    reason : why there is no derivative, or why it is out
    drop : by which the refit lowers the sum of squares (the test's promise where there is none)
    """

    candidate: Candidate
    test: Tested | None
    absorbed: float
    detectable: np.ndarray
    raw: np.ndarray | None
    signature: Signature | None
    fit: Fit | None = None
    reason: str = ""
    drop: float = 0.0

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.candidate.name

    @property
    def z(self) -> float:
        """Normal deviate: of the test, or of the refit where there is no derivative that is relied on."""
        if self.test is not None and not (self.reason and self.fit is not None):
            return self.test.z
        return float(deviate(self.drop, len(self.candidate.free)))

    @property
    def size(self) -> np.ndarray:
        """Sizes (p,), of the refit where there is one."""
        if self.fit is not None:
            return np.array([self.fit.value(name) for name in self.candidate.free])
        null = self.candidate.null
        return np.where(np.isfinite(null), null, 0.0) + self.test.size if self.test is not None else null

    @property
    def error(self) -> np.ndarray:
        """Standard errors (p,) of the sizes."""
        if self.fit is not None and self.fit.names:
            return self.fit.error(self.candidate.free)
        return self.test.error if self.test is not None else np.full(len(self.candidate.free), np.inf)

    @property
    def half_width(self) -> np.ndarray:
        """Half widths (p,) of the 95 % intervals of the sizes."""
        if self.fit is not None and self.fit.names:
            return self.fit.half_width(self.candidate.free)
        return float(stats.norm.isf(0.5 * (1.0 - LEVEL))) * self.error

    @property
    def parameters(self) -> int:
        """How many parameters were fitted for it."""
        return len(self.candidate.free) + len(self.candidate.form)

    @property
    def price(self) -> float:
        """What its parameters are worth: two each, as Akaike has it."""
        return 2.0 * self.parameters


Named = list[tuple[Suspect, tuple[Suspect, ...]]]  # causes with their rivals


@dataclass(frozen=True, eq=False)
class Round:
    """One search for a cause.

    Attributes
    ----------
    base : the model so far
    suspects : all candidates, the strongest first
    threshold : of |z|
    chosen : the suspect that explains most, None where none passes
    rivals : suspects that cannot be told from the chosen one, which is the simplest of them
    excess : by which the base's sum of squares exceeds what noise leaves, where refitted suspects are compared
    prediction : of the chosen suspect, or of the one that was rejected; None where it was not or cannot be tested
    rejected : the suspect that explains most where it is no cause, None where it is one or there is none
    rejection : why it is none
    untried : suspects that were to be refitted when the budget was spent
    """

    base: Fit
    suspects: tuple[Suspect, ...]
    threshold: float
    chosen: Suspect | None
    rivals: tuple[Suspect, ...]
    excess: float
    prediction: Prediction | None = None
    rejected: Suspect | None = None
    rejection: str = ""
    untried: tuple[str, ...] = ()

    def without_cause(self, why: str) -> "Round":
        """Return the same search with no cause found."""
        return replace(self, chosen=None, rivals=(), rejected=self.chosen, rejection=why)

    @property
    def margin(self) -> float:
        """By how much more the best rival lowers the sum of squares than the best that was told from it, or nothing."""
        alike = {rival.name for rival in self.rivals}
        others = (s.drop for s in self.suspects if s.fit is not None and s.name not in alike)
        return max(rival.drop for rival in self.rivals) - max(others, default=0.0)


@dataclass(frozen=True, eq=False)
class Selection:
    """What the search came to.

    Attributes
    ----------
    rounds : searches one after the other; the last has no chosen one unless there were enough, or the budget was spent
    null, final : the calibrated model, and the one with the causes
    causes : that are in the final model
    alternatives : of each cause, suspects that cannot be told from it beside the others, itself included
    excess : by how much the calibrated model's sum of squares exceeds what noise leaves, with its standard deviation
    left : the same of the final model
    constancy : how much the size of each cause differs among the channels of the records
    cut_short : whether the budget was spent before all that might change the answer was tried
    """

    rounds: tuple[Round, ...]
    null: Fit
    final: Fit
    causes: tuple[Suspect, ...]
    alternatives: tuple[tuple[Suspect, ...], ...]
    excess: float
    left: float
    blur: float
    constancy: tuple[Constancy, ...] = ()
    cut_short: bool = False

    def without_causes(self) -> "Selection":
        """Return the same search with the calibrated model as its answer."""
        return replace(self, final=self.null, causes=(), alternatives=(), left=self.excess, constancy=())

    @property
    def share(self) -> float:
        """Share of the excess that the causes explain; 1 where there is none  [1]."""
        return (self.excess - self.left) / self.excess if self.marked else 1.0

    @property
    def marked(self) -> bool:
        """Whether the calibrated model's sum of squares exceeds the noise at all."""
        return self.excess > MARKED * self.blur

    @property
    def explained(self) -> bool:
        """Whether the causes leave no more than noise or a crumb; where what is left is gross, at least explain half.

        Where noise is the larger part of what is left it is known so well that the right causes would leave nothing
        beside it; a gross misfit is only ever explained in part.
        """
        little = max(MARKED * self.blur, CRUMB * self.excess)
        return self.left < little or (self.gross and self.share >= HALF)

    @property
    def varying(self) -> tuple[Constancy, ...]:
        """Causes whose sizes differ among the channels of the records: each acts like an effect, and is none.

        Several that do may imitate any other: together they are a flexible model. One cause that leaves nothing but
        noise speaks for itself. What is left beside the noise may bias sizes (`_bias`).
        """
        if len(self.causes) < 2 and not self.gross:
            return ()
        left = self.left if self.gross else 0.0
        return tuple(c for c in self.constancy if c.z > self.rounds[0].threshold and c.variation > _bias(left, c.chi2))

    @property
    def constant(self) -> bool:
        """Whether each cause has one size in all channels of all records."""
        return not self.varying

    @property
    def inconstancy(self) -> float:
        """Largest normal deviate by which the size of a cause differs among the channels of the records."""
        return max((c.z for c in self.constancy), default=0.0)

    @property
    def gross(self) -> bool:
        """Whether what the causes leave is mostly not noise."""
        return self.left > GROSS * self.blur**2

    @property
    def material(self) -> bool:
        """Whether the causes explain enough to be named, with one size each."""
        return self.explained and self.constant

    @property
    def margin(self) -> float:
        """Fall of the sum of squares that the answer rests on: an error that moves less of it does not change it.

        Of each cause what it explains, and explains more than the best that was told from it; the excess where there is
        no cause; nothing where causes gave way to others. Of causes that explain enough, but not everywhere alike, what
        shows that.
        """
        if self.explained and not self.constant:
            return (max(c.z for c in self.varying) - self.rounds[0].threshold) ** 2
        chosen = [r for r in self.rounds if r.chosen is not None]
        if [r.chosen.name for r in chosen] != [cause.name for cause in self.causes]:
            return 0.0
        margins = [r.margin for r in chosen]
        return max(0.0, min(margins if self.material and margins else [self.left, *margins]))

    @property
    def rivals(self) -> tuple[Suspect, ...]:
        """Suspects that cannot be told from a cause: from the last one that there are such of."""
        several = [alike for alike in self.alternatives if len(alike) > 1]
        return several[-1] if several else self.alternatives[-1] if self.alternatives else ()

    @property
    def classes(self) -> tuple[tuple[str, ...], ...]:
        """Names of causes that act together, in each of the ways that cannot be told apart: one at a time exchanged."""
        names = tuple(cause.name for cause in self.causes)
        ways = [
            (*names[:index], rival.name, *names[index + 1 :])
            for index, alike in enumerate(self.alternatives)
            for rival in alike
        ]
        return tuple(dict.fromkeys([names, *ways])) if names else ()


def select(
    fitter: Fitter,
    null: Fit,
    candidates: Sequence[Candidate],
    seed: int,
    on_stage: Callable[[str], None] = lambda text: None,
) -> Selection:
    """Search for causes one after the other, at most three; then look for each earlier one again beside the others.

    Where a cause brings the residual down to the noise that is stated, its memory is judged anew, and what follows is
    looked for in that noise. Where causes found in this way leave more than noise, one of them may be a compromise
    between two: then the best pair is tried in their place.
    """
    rounds, base, causes, known = [], null, [], {}
    for number in range(CAUSES):
        if number and fitter.effort.spent:
            break
        left = [c for c in candidates if c.name not in {cause.name for cause in causes}]
        on_stage(f"suspects {number + 1}")
        excess, blur = _excess(fitter.evidence, base), _blur(fitter.evidence)
        found = search(fitter, base, left, seed + number, excess / blur, known)
        ahead = None if found.chosen is None else fitter.sharpened(found.chosen.fit)
        if ahead is not None:
            found = replace(found, prediction=_prediction(fitter.evidence, base, ahead, found.chosen))
            why = _rejection(fitter.evidence, null, base, ahead, found, further=number > 0)
            found = found.without_cause(why) if why else found
        rounds.append(found)
        if found.chosen is None:
            break
        base = ahead
        causes.append(replace(found.chosen, fit=base))
        heard = fitter.evidence.heard(base.point.seen)
        if heard is not None:
            known.update({key: (heard.carried(raw, fitter.evidence), doubts) for key, (raw, doubts) in known.items()})
            fitter.evidence = heard
            null, base = fitter.fit(null.point), fitter.fit(base.point, base.found)
    named = [(cause, r.rivals) for cause, r in zip(causes, rounds, strict=False)]
    if len(named) > 1 and not fitter.effort.spent:
        named, base = _beside_the_others(fitter, null, named, base, candidates, seed, known)
    blur = _blur(fitter.evidence)
    if MARKED * blur < _excess(fitter.evidence, base) < GROSS * blur**2 and not fitter.effort.spent:
        on_stage("pairs")
        pair = _paired(fitter, null, rounds[0].suspects)
        if pair is not None and _worth(*pair) > _worth(named, base) + APART:
            named, base = _beside_the_others(fitter, null, *pair, candidates, seed, {}, last=True)
    common = fitter.evidence.with_weights([null.point.seen, base.point.seen])
    return Selection(
        rounds=tuple(rounds),
        null=null,
        final=base,
        causes=tuple(replace(cause, candidate=cause.candidate.at(base.point.values), fit=base) for cause, _ in named),
        alternatives=tuple(rivals for _, rivals in named),
        excess=null.judged(common) - _expected(common, null),
        left=base.judged(common) - _expected(common, base),
        blur=_blur(common),
        constancy=constancies(fitter.evidence, base) if named else (),
        cut_short=fitter.effort.spent,
    )


def _prediction(evidence: Evidence, base: Fit, ahead: Fit, cause: Suspect) -> Prediction | None:
    """Cross-validate a cause; None where that cannot be done, or no derivative tells how."""
    own = (*cause.candidate.free, *cause.candidate.form)
    index = [ahead.names.index(name) for name in own if name in ahead.names]
    if len(index) < len(own) or not ahead.columns[:, index].any(axis=0).all():
        return None
    return predicted(evidence, base, ahead, own)


def _rejection(evidence: Evidence, null: Fit, base: Fit, ahead: Fit, found: Round, further: bool) -> str:
    """Why the chosen suspect of a search, in the model `ahead`, is no cause; "" where it is one.

    further : whether there are causes before it
    """
    cause, test = found.chosen, found.prediction
    if further and _nibbles(evidence, null, base, cause):
        return "it explains a negligible share of what the calibrated model leaves"
    if _indistinct(ahead, cause):
        return "its interval beside all other parameters holds the size at which it is absent"
    if test is not None and test.fails:
        return (
            f"it does not predict what had no part in its fit ({', '.join(test.folds)} left out in turn): the sum of "
            f"squares there falls by {test.reduction:.3g} +- {test.error:.2g}"
        )
    if further and _varies(evidence, ahead, cause, found.threshold):
        return "its size differs among the channels of the records, and a large misfit is left"
    return ""


def _nibbles(evidence: Evidence, null: Fit, base: Fit, cause: Suspect) -> bool:
    """Whether what was found beside the causes of `base` explains too little to be another one.

    It has to explain a hundredth of what the calibrated model left: below, it mends the form of the causes before it,
    of which nobody knows more than that they explain the rest; and a quarter of what is left, where that is more than
    noise: below, it nibbles at something else.
    """
    left, clear = _excess(evidence, base), MARKED * _blur(evidence)
    whole = _excess(evidence, null)
    return (whole > clear and cause.drop < CRUMB * whole) or (left > clear and cause.drop < NIBBLE * left)


def _indistinct(fit: Fit, cause: Suspect) -> bool:
    """Whether the size of a cause, beside all other parameters of the model with it, may be its null.

    Its joint 95 % interval holds the null - of several parameters, that of each - and so does the one that the fall of
    the sum of squares gives, in units of what is left: where a size is far from linear, the first is too wide (Hauck
    and Donner, J. Am. Stat. Assoc. 72 (1977) 851). Where no derivative tells the interval there is none to judge by.
    """
    names, null = cause.candidate.free, cause.candidate.null
    half = fit.half_width(names)
    known = np.isfinite(half) & np.isfinite(null)
    size = np.array([fit.value(name) for name in names])
    if not known.all() or (np.abs(size - null) >= half).any():
        return False
    return bool(cause.drop / fit.inflation(names) < stats.chi2.ppf(LEVEL, len(names)))


def _varies(evidence: Evidence, ahead: Fit, cause: Suspect, limit: float) -> bool:
    """Whether a further cause, in the model `ahead`, has another size in each channel, where a gross misfit is left.

    limit : of the normal deviate from which sizes differ
    """
    left = _excess(evidence, ahead)
    if left < GROSS * _blur(evidence) ** 2:
        return False
    [constancy] = [c for c in constancies(evidence, ahead) if c.effect == cause.name]
    return constancy.z > limit and constancy.variation > _bias(left, constancy.chi2)


def _bias(left: float, chi2: float) -> float:
    """By how much what is left of the excess may bias the size of an effect of this chi-square, relative to it.

    A remainder of chi-square R moves a size, whose effect has the chi-square W, by sqrt(R / W) of itself at most
    (the inequality of Cauchy and Schwarz).
    """
    return float(np.sqrt(max(0.0, left) / max(chi2, 1e-300)))


def _paired(fitter: Fitter, null: Fit, suspects: Sequence[Suspect]) -> tuple[Named, Fit] | None:
    """The two causes that together promise most at the calibrated model, fitted; None where there are no two.

    What they promise is linear: the fall of the sum of squares along both signatures.
    """
    able = [s for s in suspects if s.test is not None and not s.reason and s.signature.columns.any()]
    residual, best = null.absorbing(null.residual), (0.0, None)
    for one, other in combinations(able, 2):
        columns = np.column_stack([one.signature.columns, other.signature.columns])
        columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        score = columns.T @ residual
        theta = np.linalg.lstsq(columns.T @ columns, score, rcond=1e-6)[0]
        split = len(one.candidate.free)
        right = all(_sign(s.candidate) * part[0] >= 0.0 for s, part in ((one, theta[:split]), (other, theta[split:])))
        promise = float(score @ theta) - one.price - other.price
        if one.name != other.name and right and promise > best[0]:
            best = promise, (one, other)
    if best[1] is None:
        return None
    found = tuple(s.candidate for s in best[1])
    fit = fitter.fit(null.point, found, {name: x for c in found for name, x in c.absent().items()})
    if not fit.names:
        return None
    return [(replace(s, fit=fit), (s,)) for s in best[1]], fitter.sharpened(fit)


def _worth(named: Named, final: Fit) -> float:
    """Minus the sum of squares that causes leave, less their price."""
    return -final.square - sum(cause.price for cause, _ in named)


def _expected(evidence: Evidence, fit: Fit) -> float:
    return evidence.counted() - fit.columns.shape[1] - fit.nuisances.shape[1]


def _excess(evidence: Evidence, fit: Fit) -> float:
    """By how much the sum of squares exceeds what noise leaves."""
    return fit.square - _expected(evidence, fit)


def _blur(evidence: Evidence) -> float:
    """Standard deviation of the sum of squares of noise alone."""
    return float(np.sqrt(2.0 * evidence.counted()))


def search(
    fitter: Fitter,
    base: Fit,
    candidates: Sequence[Candidate],
    seed: int,
    excess: float,
    known: Known,
    reached: float = np.inf,
) -> Round:
    """Find the candidate that explains most of what the model `base` leaves.

    Parameters
    ----------
    excess : of its sum of squares, in standard deviations; candidates without derivative are tried where it shows, or
        where others are above the threshold
    known : derivatives of candidates and their doubts by id, from an earlier search; those found here are added
    reached : sum of squares that one of the candidates is known to reach
    """
    other = set(known)  # whose derivatives are of another model: they are taken anew of those that may lead at this one
    suspects, limit = scored(fitter, base, candidates, seed, known)
    guilty = _guilty(suspects, limit)
    promised = max((s.test.drop for s in guilty), default=0.0)
    old = [s for s in guilty if id(s.candidate) in other and s.test.drop >= 0.5 * WORTH * promised]
    if old:
        for suspect in old:
            del known[id(suspect.candidate)]
        suspects, limit = scored(fitter, base, candidates, seed, known)
        guilty = _guilty(suspects, limit)
        promised = max((s.test.drop for s in guilty), default=0.0)
    leaders = [s for s in _best_variants(guilty) if s.test.drop >= WORTH * promised][:REFITS]
    if guilty or excess > MARKED:
        leaders += [s for s in suspects if s.reason and not s.candidate.effect.noise and s.absorbed < ABSORBED]
    refitted, best, left = [], reached, _excess(fitter.evidence, base)
    untried: list[str] = []
    for number, suspect in enumerate(leaders):
        fitter.effort.foresee(fitter.expected(len(guilty), 2 * len(leaders) - number))  # another search may follow
        if number and fitter.effort.spent:
            untried.append(suspect.name)
            continue
        alike = (2.0 * APART + limit**2) * max(1.0, best / base.residual.size)  # as far as a rival may be behind
        found = _refitted(fitter, base, suspect, limit, best + alike)
        if found.fit is not None:
            refitted.append(found)
            best = min(best, found.fit.square)
    if refitted:
        common = fitter.evidence.with_weights([base.point.seen, *(s.fit.point.seen for s in refitted)])
        before = base.judged(common)
        left = before - _expected(common, base)
        refitted = [replace(s, drop=before - s.fit.judged(common)) for s in refitted]
    again = {id(s.candidate): s for s in refitted}
    rivals = _rivals(fitter, [s for s in refitted if _possible(s, limit)], limit)
    if rivals:  # what cannot be told apart is compared again, each with the form that suits it best
        formed = {id(s.candidate): _formed(fitter, s, before, common) for s in rivals}
        again |= formed
        rivals = _rivals(fitter, list(formed.values()), limit)
    everyone = [again.get(id(s.candidate), s) for s in suspects]
    everyone.sort(key=lambda s: -(s.drop if s.fit is not None else (s.test.drop if s.test is not None else 0.0)))
    chosen = min(rivals, key=lambda s: (s.price, -s.drop), default=None)  # the simplest speaks for all
    return Round(base, tuple(everyone), limit, chosen, rivals, left, untried=tuple(dict.fromkeys(untried)))


def _guilty(suspects: Sequence[Suspect], limit: float) -> list[Suspect]:
    """Suspects above the threshold of |z| whose sizes have a possible sign; the suspects' order is kept."""
    relied = [s for s in suspects if s.test is not None and not s.reason and abs(s.z) > limit]
    return [s for s in relied if not _sign(s.candidate) * s.test.size[0] < 0.0]


def _best_variants(suspects: Sequence[Suspect]) -> list[Suspect]:
    """Keep the strongest variant of each effect; the suspects come in that order."""
    kept: dict[str, Suspect] = {}
    for suspect in suspects:
        kept.setdefault(suspect.name, suspect)
    return list(kept.values())


def _rivals(fitter: Fitter, able: Sequence[Suspect], limit: float) -> tuple[Suspect, ...]:
    """Suspects within reach of the one that explains most for its price, one of each effect, the best first.

    A simpler one is within reach too where what the further parameters of the best bring is below the threshold of |z|:
    beside it they would be no cause either. Where the best leaves more than noise, sums of squares of rivals differ by
    that much more without telling them apart (quasi-likelihood, Burnham & Anderson 2002, section 2.5).
    """
    ordered = sorted(able, key=lambda s: s.price - s.drop)
    if not ordered:
        return ()
    best = ordered[0]
    over = max(1.0, best.fit.square / max(1.0, _expected(fitter.evidence, best.fit)))

    def reaches(other: Suspect) -> bool:
        behind, further = best.drop - other.drop, best.parameters - other.parameters
        near = behind + other.price - best.price <= APART * over
        return near or (further > 0 and deviate(behind / over, further) <= limit)

    return tuple(_best_variants([s for s in ordered if reaches(s)]))


def scored(
    fitter: Fitter, base: Fit, candidates: Sequence[Candidate], seed: int, known: Known | None = None
) -> tuple[list[Suspect], float]:
    """Test all candidates on what the model `base` leaves: suspects, the strongest first, and the threshold of |z|.

    known : derivatives (N, p) of candidates and their doubts (p,) by id, which are not taken again; those found here
        are added
    """
    known = {} if known is None else known
    fresh = [c for c in candidates if not c.effect.rough and id(c) not in known]
    reasons = {id(c): "it has no derivative where it is absent" for c in candidates if c.effect.rough}
    raw = {id(c): known[id(c)][0] for c in candidates if id(c) in known}
    doubts = {id(c): known[id(c)][1] for c in candidates if id(c) in known}
    for candidate, own in zip(fresh, fitter.suspected(base.point, fresh), strict=True):
        lost = next((slope.reason for slope in own if slope.column is None), None)
        if lost is not None:
            reasons[id(candidate)] = lost
            continue
        raw[id(candidate)] = np.column_stack([slope.column for slope in own])
        doubts[id(candidate)] = np.array([slope.doubt for slope in own])
        unreliable = next((slope.reason for slope in own if not slope.reliable), "")
        if unreliable:
            reasons[id(candidate)] = unreliable
        else:
            known[id(candidate)] = raw[id(candidate)], doubts[id(candidate)]
    absorbing, segments = base.absorbing, fitter.evidence.segments()
    residual = absorbing(base.residual)
    signatures = {key: Signature.of(columns, absorbing, doubts[key]) for key, columns in raw.items()}
    smooth = [c for c in candidates if id(c) in signatures and id(c) not in reasons]
    limit = threshold([signatures[id(c)] for c in smooth], segments, seed, [_sign(c) for c in smooth])
    suspects = []
    for candidate in candidates:
        signature, reason = signatures.get(id(candidate)), reasons.get(id(candidate), "")
        if signature is None:
            none = np.full(len(candidate.free), np.inf)
            suspects.append(Suspect(candidate, None, 0.0, none, None, None, reason=reason))
            continue
        test = tested(residual, signature, segments)
        own = raw[id(candidate)]
        suspects.append(Suspect(candidate, test, signature.absorbed, limit * test.error, own, signature, reason=reason))
    suspects.sort(key=lambda s: -(s.test.drop if s.test is not None else 0.0))
    return suspects, limit


def _sign(candidate: Candidate) -> int:
    """Sign that the size of a candidate with one parameter must have, 0 where both make sense."""
    if len(candidate.free) != 1:
        return 0
    if candidate.low[0] == candidate.null[0]:
        return 1
    return -1 if candidate.high[0] == candidate.null[0] else 0


def _refitted(fitter: Fitter, base: Fit, suspect: Suspect, limit: float, rival: float) -> Suspect:
    """Fit all parameters with the suspect in the model, from its estimated size or from several.

    A candidate without derivative is first tried at several sizes: the change of the records from nothing to that size,
    scaled to fit the residual best, has to promise as much as the threshold asks for. So is one whose fit does not
    bring what the derivative promised: between nothing and its size it is far from linear, and its fit may have ended
    beside its best; a further fit begins only at a size that promises more than that reached. Where the motion fails at
    the estimated size, which a gross misfit makes large, the fit begins at nothing and goes as far as it can.

    rival : sum of squares at which the suspect would still be an alternative
    """
    candidate = suspect.candidate

    def fitted(start: np.ndarray, columns: np.ndarray | None = None) -> Fit:
        sizes = candidate.values(np.clip(start, candidate.low, candidate.high))
        return fitter.fit(base.point, (*base.found, candidate), sizes, columns, rival)

    fits, drop = [], 0.0
    if not suspect.reason:
        columns = np.column_stack([base.columns, suspect.raw])
        fits.append(fitted(candidate.null + suspect.test.size, columns))
        if not fits[0].names:
            fits[0] = fitter.fit(base.point, (*base.found, candidate), candidate.absent(), columns, rival)
        drop = base.square - fits[0].square
    if suspect.reason or abs(drop - suspect.test.drop) > BENT * suspect.test.drop:
        tried = [fitter.begun(base, candidate, np.clip(x, candidate.low, candidate.high)) for x in candidate.sizes]
        tried = sorted((t for t in tried if t is not None), key=lambda pair: -pair[0])
        least = max(PROMISING * limit**2, drop)
        fits += [fitted(sizes) for promise, sizes in tried[:STARTS] if promise > least]
    best = min(fits, key=lambda fit: fit.square, default=None)
    return suspect if best is None else replace(suspect, fit=best, drop=base.square - best.square)


def _formed(fitter: Fitter, suspect: Suspect, before: float, common: Evidence) -> Suspect:
    """Return the suspect with its form fitted too, where that brings more than its parameters are worth.

    What an effect is tried at is a guess of its form: what a poor one leaves would be taken for a further cause.

    before : sum of squares of the model without the suspect, over the evidence `common`
    """
    candidate, fit = suspect.candidate, suspect.fit
    if not candidate.bounds or not fit.names:
        return suspect
    formed = replace(candidate, form=tuple(candidate.bounds))
    best = fitter.fit(fit.point, tuple(formed if c is candidate else c for c in fit.found))
    if not best.names:
        return suspect
    better = replace(suspect, candidate=formed.at(best.point.values), fit=best, drop=before - best.judged(common))
    return better if better.drop - better.price > suspect.drop - suspect.price else suspect


def _possible(suspect: Suspect, limit: float) -> bool:
    """Whether a refitted suspect has a size that makes sense and explains enough to be a cause."""
    if suspect.fit is None or not suspect.fit.names:
        return False
    size, null = suspect.size, suspect.candidate.null
    sign = _sign(suspect.candidate)
    if sign and not (size[0] - null[0]) * sign > 0.0:
        return False
    return deviate(suspect.drop, len(suspect.candidate.free)) > limit


def _beside_the_others(
    fitter: Fitter,
    null: Fit,
    named: Named,
    final: Fit,
    candidates: Sequence[Candidate],
    seed: int,
    known: Known,
    last: bool = False,
) -> tuple[Named, Fit]:
    """Take out each cause but the last in turn and search again: what stood for two causes gives way to one of them.

    The first cause was chosen while the later ones were missing, and may have explained part of theirs (sequential
    replacement: Miller, Subset Selection in Regression, 2002, section 3). It is dropped where the others explain as
    much without it, and exchanged where another explains more beside them; the last is then looked for again as well,
    or anyway.
    """
    kept, exchanged, latest = list(named), last, named[-1][0]
    for cause, own in named:
        if cause is latest and not exchanged:
            break
        index = [c is cause for c, _ in kept].index(True)
        as_it_was = cause, own if cause is latest else (cause,)
        others = tuple(c.candidate for c, _ in kept if c is not cause)
        without = _without(fitter, null, final, cause, others) if others else null
        if not without.names:  # no motion without it
            kept[index] = as_it_was
            continue
        taken = {candidate.name for candidate in others}
        excess = _excess(fitter.evidence, without) / _blur(fitter.evidence)
        rest = [c for c in candidates if c.name not in taken]
        found = search(fitter, without, rest, seed, excess, known, reached=final.square)
        worth = without.square - final.square
        alike = cause.name in {rival.name for rival in found.rivals}
        if alike or (found.chosen is not None and found.chosen.drop - found.chosen.price > worth - cause.price):
            exchanged = exchanged or found.chosen.name != cause.name
            final = fitter.sharpened(found.chosen.fit)
            kept[index] = found.chosen, found.rivals
        elif worth < found.threshold**2:
            kept, final = [pair for pair in kept if pair[0] is not cause], without
        else:
            kept[index] = as_it_was
    return kept, final


def _without(fitter: Fitter, null: Fit, final: Fit, cause: Suspect, others: Sequence[Candidate]) -> Fit:
    """Fit the other causes alone, from the calibrated values beside all, or else from those beside none."""
    own = cause.candidate.absent()
    rest = {name: value for name, value in final.point.values.items() if name not in own}
    sizes = {name: final.value(name) for candidate in others for name in candidate.values(candidate.null)}
    fit = fitter.fit(replace(final.point, values=rest), others, sizes)
    return fit if fit.names else fitter.fit(null.point, others, sizes)
