"""Laws with internal states beside a free force: whether the force depends on the history of the motion.

A function of the state cannot follow hysteresis: over a closed path it has another value on the way back only where the
velocity differs. Where the free force that was found depends on the velocity, laws with internal states act in its
place: they are scored, refitted with all other parameters, and compared by what they predict.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.diagnosis.candidate import Candidate, candidates
from calib.diagnosis.criteria import CRITERIA
from calib.diagnosis.discovery.formulas import FormulaTrial
from calib.diagnosis.discovery.free_force import VELOCITY
from calib.diagnosis.discovery.left_out import LeftOutMisfit, left_out_misfit
from calib.diagnosis.discovery.trial import ForceTrial
from calib.diagnosis.fit import Fit
from calib.diagnosis.refit import Fitter
from calib.diagnosis.screening import screened
from calib.diagnosis.search import chi2_of_a_rival
from calib.diagnosis.suspect import Screened, is_testable, leading_variants
from calib.modelling.effect import Effect
from calib.objective import Reference


@dataclass(frozen=True, eq=False)
class HistoryTrial:
    """A law with internal states in the place of a free force, refitted inside the simulator.

    Attributes
    ----------
    candidate : the law, with the values of its form
    fit : the model with it
    left_out : misfit of the records that were left out in turn; None where none can be
    """

    candidate: Candidate
    fit: Fit
    left_out: LeftOutMisfit | None

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.candidate.name

    @property
    def predictive_deviance(self) -> float:
        """Predictive deviance of the left-out records; infinite where there are none."""
        return np.inf if self.left_out is None else self.left_out.deviance

    @property
    def values(self) -> dict[str, float]:
        """Values of the parameters of the law, by name."""
        return {p.name: float(self.fit.point.values[p.name]) for p in self.candidate.effect.parameters}

    @property
    def fitted(self) -> list[str]:
        """Names of its parameters that are fitted, those of its form too."""
        return [p.name for p in self.candidate.effect.parameters if p.name in self.fit.names]

    def errors(self) -> dict[str, float]:
        """Standard error of each parameter that is fitted, by name."""
        return dict(zip(self.fitted, map(float, self.fit.error(self.fitted)), strict=True))

    def surpasses(self, trial: ForceTrial, formula: FormulaTrial | None) -> bool:
        """Whether it predicts left-out records better than a free force and fits all as well, and so with its formula.

        As well by quasi-AIC with effective parameters: a few numbers predict with less uncertainty than a function. Of
        a law and a formula that predict as well as each other, the one with fewer numbers is taken.
        """
        if self.left_out is None or trial.left_out is None:
            return False
        better = self.left_out.is_better(trial.left_out)
        if formula is not None and formula.left_out is not None and not self.left_out.is_better(formula.left_out):
            tied = not formula.left_out.is_better(self.left_out)
            better = better and tied and len(self.fitted) < formula.formula.length
        dispersion = trial.fitted.dispersion
        own = self.fit.chi2 / dispersion + 2.0 * len(self.fitted)
        return better and own <= trial.chi2 / dispersion + 2.0 * trial.fitted.effective_parameters + CRITERIA.aic_tie


def history_trials(
    fitter: Fitter,
    null: Fit,
    chosen: ForceTrial,
    effects: Sequence[Effect],
    references: Mapping[str, Reference],
    seed: int,
    on_stage: Callable[[str], None] = lambda text: None,
) -> tuple[HistoryTrial, ...]:
    """Refit laws with internal states, their form too, in the place of a free force, ordered.

    Those that attain as little as the free force, and that have a significant score test or none.

    Parameters
    ----------
    null : the calibrated model
    chosen : the free force
    effects : of which those that are force laws with internal states count
    references : by name, those that are not held out
    seed : of the noise that is drawn for the threshold
    """
    laws = [e for e in effects if e.site == "force" and e.law.states and e.place != "interface"]
    if not laws or chosen.place.gap or VELOCITY not in chosen.all_arguments:
        return ()
    on_stage(f"{chosen.body}: laws with internal states")
    here = [replace(effect, bodies=(chosen.body,)) for effect in laws]
    own, _ = candidates(fitter.model, here, references, fitter.space.names)
    fitter.effort.foresee(fitter.expected_simulations(len(own), len(laws)))
    suspects, threshold = screened(fitter, null, own, seed)
    leaders = leading_variants(s for s in suspects if _may_act(s, threshold))
    rival = chi2_of_a_rival([], null, threshold, chosen.chi2)
    trials = []
    for suspect in leaders:
        if not fitter.effort.suffices():
            break
        candidate = suspect.candidate
        formed, sizes = replace(candidate, form=tuple(candidate.bounds)), candidate.within_scale(_begin(suspect))
        fit = fitter.fit(null.point, (*null.candidates, formed), candidate.values(sizes), rival=rival)
        if fit.names and fit.chi2 < rival:
            trials.append(HistoryTrial(formed.at(fit.point.values), fit, left_out_misfit(fitter.evidence, fit)))
    return ordered(trials)


def ordered(trials: Sequence[HistoryTrial]) -> tuple[HistoryTrial, ...]:
    """Order laws by what they predict, but of those that tie with the best the fewest numbers first."""
    best = min(trials, key=lambda trial: trial.predictive_deviance, default=None)

    def rank(trial: HistoryTrial) -> tuple[bool, int, float]:
        beaten = (
            best is None or best.left_out is None or trial.left_out is None or best.left_out.is_better(trial.left_out)
        )
        return beaten, 0 if beaten else len(trial.fitted), trial.predictive_deviance

    return tuple(sorted(trials, key=rank))


def _may_act(suspect: Screened, threshold: float) -> bool:
    """Whether a law is significant, or cannot be scored; not one whose special cases are not."""
    return abs(suspect.z) > threshold if is_testable(suspect) else not suspect.deferred


def _begin(suspect: Screened) -> np.ndarray:
    """Sizes (p,) at which a fit begins: those that the score test estimates, or typical ones."""
    sizes = suspect.candidate.sizes
    return suspect.size if is_testable(suspect) or not len(sizes) else sizes[len(sizes) // 2]
