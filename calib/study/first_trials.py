"""Whether the first trials of a run have all failed with one and the same exception."""

from collections.abc import Iterable, Mapping

from calib.errors import FirstTrialsFailed
from calib.execution.pool import RAISED, Failure
from calib.store import Trial

# Were an exception to spare 14 % of the windows or more, one of 20 points spread over them would end otherwise with
# a probability of 95 %.
MIN_FIRST_TRIALS = 20  # that have failed before a search is given up  [count]
TRIALS_PER_WORKER = 2  # of these at least: what fails on one worker alone is no fault of the code  [count]
NUMERICAL_ACCIDENTS = ("ZeroDivisionError", "OverflowError", "FloatingPointError", "LinAlgError")  # of some values


class FirstTrials:
    """The trials that a run asks for first, in asking order: on many workers those that fail soonest end first.

    Parameters
    ----------
    workers : evaluations side by side
    """

    def __init__(self, workers: int):
        self._least = max(MIN_FIRST_TRIALS, TRIALS_PER_WORKER * workers)
        self._asked: list[int] = []

    def ask(self, numbers: Iterable[int]) -> None:
        """Take in the asking numbers of trials that are evaluated next."""
        self._asked += numbers

    def check(self, trials: Mapping[int, Trial], number: int, failure: Failure) -> None:
        """Check, after the failure of trial `number`, that going on may give anything else.

        Trials that were stopped by a limit, that crashed, diverged or met a numerical accident may depend on their
        values: they are data.

        Raises
        ------
        FirstTrialsFailed : all of the first trials have ended, and failed with the same exception at the same place
        """
        asked = self._asked[: self._least]
        if len(asked) < self._least or number not in asked or failure.status != RAISED:
            return
        exception = failure.reason.partition(":")[0]
        causes = {(trials[n].status, trials[n].cause) if n in trials else None for n in asked}
        if exception in NUMERICAL_ACCIDENTS or len(causes) > 1:
            return
        reason = " ".join(failure.reason.split())
        raise FirstTrialsFailed(
            f"each of the first {len(asked)} trials failed with the same exception, and the search was stopped before "
            f"it spends its budget on others: {reason}. Mend what that line belongs to (`calib run --dry-run` "
            "tries it once), and give the same command again: the trials are kept, and those by code that has changed "
            "are evaluated anew. Where nothing was wrong with the code, the same command goes on with other points, "
            "and --fresh begins anew"
        )
