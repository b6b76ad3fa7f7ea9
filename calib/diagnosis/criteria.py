"""The thresholds by which a diagnosis decides."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Criteria:
    """Thresholds of the diagnosis.

    A chi-square is a sum of squared residuals in units of the noise; its excess is what it has beyond the degrees of
    freedom; N is the number of residuals. Where no source is given the value is a convention of this program, to which
    the tests on records with known causes are held.

    Attributes
    ----------
    significance_std : excess chi-square that is a misfit, in its standard deviations sqrt(2 N) where there is noise
        alone  [1]; three-sigma rule
    dominant_excess : excess chi-square from which a misfit is mostly error of the model, relative to the variance 2 N
        of the noise's chi-square  [1]; 0.5 is a reduced chi-square of 2
    negligible_share : reduction of chi-square that is no evidence of a further cause, relative to the excess chi-square
        of the calibrated model  [1]; convention
    min_over_remainder : rise of chi-square without a cause that is named, relative to the excess chi-square that all
        causes leave where that is a misfit  [1]; convention: at 2 the angle between what the cause changes and what the
        others leave has a cosine of 0.82 or more
    max_variation : standard deviation of the size of a cause among channels or records, relative to its mean, up to
        which the difference may be due to model error  [1]; convention: where a cause explains twice what it leaves,
        0.25 is typical
    model_error_cosine : of the angle between what a cause changes in a record and the model error there, root mean
        square  [1]; of the laws that no effect expresses those most similar to effects, 0.07 to 0.40 by law and
        laboratory (tests/benchmarks/bench_model_error.py)
    model_error_harmonics : highest harmonic of the excitation in which a model error of a steady motion is sought that
        the whole chi-square hides  [1]; convention
    max_model_error_cosine : of the angle between the model error beside a cause and what a similar effect would
        change further, up to which that may be chance  [1]; of the same laws 95 % are below 0.47 (four_dof) and 0.68
        (oscillator; same source): their mean
    min_change_chi2 : sum of squares of what a cause changes in a record, in units of the noise, from which on that
        record has information on it  [1]; the variance of one residual
    min_explained_share : least excess chi-square that the steps of converters explain where they replace causes,
        relative to that of the calibrated model; and that another suspect explains which may be the cause, relative to
        what the best explains  [1]; convention
    min_share_of_remainder : excess chi-square that a further cause explains at least, relative to what the causes
        before it leave  [1]; convention
    confidence_level : of intervals, and of the joint region that holds an absent effect  [1]; textbook value
    threshold_quantile : of the largest |z| of all candidates in noise alone, above which one is significant  [1]:
        family-wise error rate of 1 % (maxT of Westfall & Young, Resampling-Based Multiple Testing, 1993)
    aic_tie : difference in AIC that counts as a tie  [1]; models within 4 to 7 have considerably less support, not none
        (Burnham & Anderson, Model Selection and Multimodel Inference, 2002, section 2.6)
    max_causes : that are named  [count]; convention
    max_refits : suspects that are refitted in one search  [count]; convention
    max_pairs : pairs of suspects that are fitted to find the best  [count]; convention
    max_runners_up : suspects that are tried where held-out records refute the only cause  [count]; convention
    min_leader_share : predicted reduction of chi-square of a suspect that is refitted, relative to the largest  [1];
        convention
    min_signature_cosine : of the angle between what two suspects change in the records, from which on one is refitted
        where the other explains most  [1]; convention
    min_rescored_share : predicted reduction, relative to the largest, of a suspect whose derivatives are recomputed
        where they are of another model  [1]; half of `min_leader_share`
    min_general_share : |z| of a simpler suspect, relative to the threshold, from which on more general ones are tested
        [1]; the signatures of those in the library have a cosine of 0.85 or more with that of a simpler one
    max_absorbed_share : length of a signature that calibration absorbs, relative to the whole, from which on an effect
        without derivative is not refitted  [1]; convention
    max_nonlinearity : reduction of chi-square by a refit less the predicted one, relative to that, beyond which the
        refit is begun at other sizes too  [1]; convention
    min_trial_reduction : reduction of chi-square by a size at which a refit begins, relative to the squared threshold
        of |z|  [1]; convention
    max_starts : sizes at which the refit of a suspect begins that is not linear  [count]; convention
    min_outliers : samples that are removed as outliers: fewer may be chance  [count]; convention
    min_outlier_share : chi-square of the outliers, relative to the whole, from which they are named  [1]; convention
    min_quantisation_share : variance by a converter's steps, relative to that of the noise of a channel, from which
        they are named  [1]; convention
    min_noise_samples : of a record or a row that determine a level of the noise  [count]; convention
    max_variance_ratio : mean square of a residual, relative to the variance that the record states of its noise, up to
        which it is that noise, chance aside  [1]; a stated standard deviation may be 10 % off
    max_noise_change : of a standard deviation of the noise, relative, of one of its autocorrelations, or of the share
        of a variance that is due to a clock, up to which nothing is refitted  [1]; convention
    min_variance_ratio : mean square of a residual, relative to the variance of its noise, below which it cannot
        be a residual of such noise  [1]; convention
    min_variance_deficit_std : by which it has to be below, in standard deviations of the mean square of white noise
        [1]; convention
    max_solver_share : |z| by a finer solver, relative to the z on which the verdict rests, that does not change the
        verdict  [1]; convention
    max_solver_change : change of a channel by a finer solver, relative to its root mean square, that cannot change
        the kind of motion  [1]; convention
    """

    significance_std: float = 3.0
    dominant_excess: float = 0.5
    negligible_share: float = 0.01
    min_over_remainder: float = 2.0
    max_variation: float = 1.0 / 3.0
    model_error_cosine: float = 0.35
    model_error_harmonics: int = 10
    max_model_error_cosine: float = 0.58
    min_change_chi2: float = 1.0
    min_explained_share: float = 0.5
    min_share_of_remainder: float = 0.25
    confidence_level: float = 0.95
    threshold_quantile: float = 0.99
    aic_tie: float = 6.0
    max_causes: int = 3
    max_refits: int = 8
    max_pairs: int = 5
    max_runners_up: int = 3
    min_leader_share: float = 0.3
    min_signature_cosine: float = 0.95
    min_rescored_share: float = 0.15
    min_general_share: float = 0.85
    max_absorbed_share: float = 0.9999
    max_nonlinearity: float = 0.25
    min_trial_reduction: float = 0.5
    max_starts: int = 2
    min_outliers: int = 3
    min_outlier_share: float = 0.25
    min_quantisation_share: float = 0.25
    min_noise_samples: int = 32
    max_variance_ratio: float = 1.2
    max_noise_change: float = 0.02
    min_variance_ratio: float = 0.7
    min_variance_deficit_std: float = 5.0
    max_solver_share: float = 0.1
    max_solver_change: float = 0.01

    @property
    def tail_probability(self) -> float:
        """Probability beyond each end of an interval of the confidence level  [1]."""
        return 0.5 * (1.0 - self.confidence_level)


CRITERIA = Criteria()
