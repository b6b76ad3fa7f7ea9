"""What a view says of a trial."""

from typing import Any, NamedTuple

from optuna.trial import FrozenTrial, TrialState

NUMBER = "number"  # user attribute of a mirrored trial: its asking number


class MirroredTrial(NamedTuple):
    """A trial of an Optuna study.

    Attributes
    ----------
    number : asking number of the trial that it mirrors; None where it is none of calib's
    value : its cost, None where it failed
    state : as Optuna has it
    """

    number: Any
    value: float | None
    state: TrialState

    @classmethod
    def of(cls, trial: FrozenTrial) -> "MirroredTrial":
        """Return what matters of Optuna's own."""
        return cls(trial.user_attrs.get(NUMBER), trial.value, trial.state)
