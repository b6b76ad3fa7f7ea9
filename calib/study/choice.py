"""Which optimiser a study takes that names none: emulators where simulations are few and slow."""

from collections.abc import Iterable
from dataclasses import dataclass
from statistics import median

from calib.records import OK
from calib.store import Trial

MAX_COSTLY_BUDGET = 150  # trials: an emulator of more takes longer and gains less
MIN_COSTLY_SECONDS = 10.0  # s of a trial: emulators, which take up to a second an evaluation, are then a tenth of it
SECONDS_DIGITS = 6  # of a trial's time in the ledger


@dataclass(frozen=True)
class CostlyChoice:
    """That a study's simulations are few and slow.

    Attributes
    ----------
    budget : trials with which the search began
    seconds : median wall-clock time of the screen's trials that ended ok  [s]
    """

    budget: int
    seconds: float

    @property
    def remark(self) -> str:
        """Why emulators search, a sentence without its full stop; the same whatever time was measured."""
        return (
            f"emulators search (optimiser surrogate): the budget of {self.budget} is at most {MAX_COSTLY_BUDGET}, and "
            f"the median trial of the screen took {MIN_COSTLY_SECONDS:g} s or more; a name in [optimiser] decides"
        )

    @property
    def note(self) -> str:
        """The same with the time measured."""
        return f"{self.remark} (here {self.seconds:.3g} s)"


def costly_choice(budget: int, trials: Iterable[Trial]) -> CostlyChoice | None:
    """Whether simulations are few and slow: a function of the ledger alone, so that a resumed study chooses the same.

    Parameters
    ----------
    budget : trials with which the present segment of the ledger began
    trials : of the study; the times of the screen's count that ended ok
    """
    seconds = [
        round(trial.seconds, SECONDS_DIGITS) for trial in trials if trial.phase == "screen" and trial.status == OK
    ]
    if budget > MAX_COSTLY_BUDGET or not seconds or median(seconds) < MIN_COSTLY_SECONDS:
        return None
    return CostlyChoice(budget, median(seconds))
