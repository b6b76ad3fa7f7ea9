"""A mirror of the ledger as an Optuna study, for optuna-dashboard."""

import math
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Protocol

import optuna
from optuna.distributions import FloatDistribution
from optuna.exceptions import DuplicatedStudyError
from optuna.storages import BaseStorage
from optuna.study import StudyDirection
from optuna.trial import FrozenTrial, TrialState

from calib.store.address import JOURNAL_VIEW
from calib.store.header import Header
from calib.store.journal import JOURNAL, JournalPlace, whole_journal
from calib.store.ledger import TRIALS
from calib.store.mirrored import NUMBER, MirroredTrial
from calib.store.pictures import Pictures
from calib.store.plain import plain
from calib.store.trial import Trial

LEDGER, INODE = "ledger", "inode"  # attributes of an Optuna study: whose mirror it is
ID_CHARACTERS = 8  # of a ledger's id, in the name of its mirror where the study's own is taken
RELATIVE_ROUNDING = 1e-12  # relative: databases may round the last digit


class Place(Protocol):
    """Where Optuna studies are: a journal file or a database."""

    storage: BaseStorage

    @property
    def shared(self) -> bool:
        """Whether other ledgers have their mirrors there."""
        ...

    def whole(self) -> BaseStorage:
        """Return a storage that knows all trials."""
        ...

    def mirrored(self, study: int) -> Iterator[MirroredTrial]:
        """Yield the trials of an Optuna study."""
        ...

    def add(self, study: int, trials: Sequence[FrozenTrial]) -> None:
        """Add finished trials to an Optuna study."""
        ...

    def close(self) -> None:
        """Close files and connections."""
        ...


def storage(folder: str | Path, view: str = JOURNAL_VIEW) -> BaseStorage:
    """Optuna storage that holds the view of the study in `folder`: its journal file, or the URL `view`.

    Raises
    ------
    CalibError : the database cannot be used
    """
    if view == JOURNAL_VIEW:
        return whole_journal(Path(folder).resolve() / JOURNAL)
    from calib.store.database import connected  # SQLAlchemy takes half a second, and a journal needs none

    return connected(view)


def _place(folder: Path, view: str) -> Place:
    if view == JOURNAL_VIEW:
        return JournalPlace(folder / JOURNAL)
    from calib.store.database import DatabasePlace  # see above

    return DatabasePlace(view)


class OptunaView:
    """Finished trials of one ledger in an Optuna study; the ledger does not depend on it.

    Failed trials are in state FAIL, without a value. User attributes: number (asking number), phase, status, reason,
    kind, terms, seconds. A trial's picture is an artifact of it.

    Parameters
    ----------
    folder, view : of the study; "journal" or an Optuna URL
    header : of the ledger; its definition's `windows` give the parameters, {name: {"low", "high", "scale"}}
    pictures : of the ledger's trials
    """

    def __init__(self, folder: Path, view: str, header: Header, pictures: Pictures):
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        self._header, self._pictures = header, pictures
        self._inode = (folder / TRIALS).stat().st_ino
        self._windows: dict[str, FloatDistribution] = {
            name: FloatDistribution(w["low"], w["high"], log=w["scale"] == "log")
            for name, w in header.definition["windows"].items()
        }
        self._place = _place(folder, view)
        self._study = self._own_study()

    def _own_study(self) -> int:
        """Number of this ledger's study, made where there is none.

        In a database its name has the ledger's id where another ledger has taken that of the study, and a ledger in a
        folder that was copied is another one.
        """
        own, ledger = self._place.storage, self._header.id
        taken = {study.study_name: study for study in own.get_all_studies()}
        for study in taken.values():
            number, stated = study._study_id, study.user_attrs  # private, but all that a storage answers to
            if stated.get(LEDGER) == ledger and (
                not self._place.shared or stated.get(INODE, self._inode) == self._inode
            ):
                return number
        name, copies = self._header.name, 0
        while True:
            try:
                if name not in taken:
                    number = own.create_new_study([StudyDirection.MINIMIZE], name)
                    break
            except DuplicatedStudyError:
                pass  # another process has made it meanwhile
            copies += 1
            name = f"{self._header.name} {ledger[:ID_CHARACTERS]}" + (f" {copies}" if copies > 1 else "")
        own.set_study_user_attr(number, LEDGER, ledger)
        if self._place.shared:
            own.set_study_user_attr(number, INODE, self._inode)
        return number

    def missing(self, trials: Sequence[Trial]) -> list[Trial]:
        """Return the trials that the view lacks; where it contradicts the ledger, it is made anew and lacks all.

        Trials that a killed Optuna process left running are marked as failed.
        """
        present, running, contradicts = set[int](), False, False
        known = {trial.number: trial for trial in trials}
        for mirrored in self._place.mirrored(self._study):
            running |= mirrored.state == TrialState.RUNNING
            if mirrored.number is None:
                continue  # not one of calib's
            contradicts |= mirrored.number in present or not _agrees(mirrored, known.get(mirrored.number))
            present.add(mirrored.number)
        if contradicts:
            self._place.storage.delete_study(self._study)
            self._study = self._own_study()
            return list(trials)
        if running:
            whole = self._place.whole()
            for trial in whole.get_all_trials(self._study, deepcopy=False, states=(TrialState.RUNNING,)):
                whole.set_trial_state_values(trial._trial_id, TrialState.FAIL)
        return [trial for trial in trials if trial.number not in present]

    def add(self, trials: Sequence[Trial]) -> None:
        """Write finished trials, which the view lacks."""
        self._place.add(self._study, [self._frozen(trial) for trial in trials])

    def close(self) -> None:
        """Close files and connections."""
        self._place.close()

    def _frozen(self, trial: Trial) -> FrozenTrial:
        end = datetime.now(UTC).astimezone().replace(tzinfo=None)
        return FrozenTrial(
            number=-1,  # the storage numbers it
            trial_id=-1,
            state=TrialState.COMPLETE if trial.scored else TrialState.FAIL,
            value=trial.cost if trial.scored else None,
            datetime_start=end - timedelta(seconds=trial.seconds),
            datetime_complete=end,
            params={n: min(d.high, max(d.low, trial.values[n])) for n, d in self._windows.items()},
            distributions=dict(self._windows),
            user_attrs={
                NUMBER: trial.number,
                "phase": trial.phase,
                "status": trial.status,
                "reason": trial.reason,
                "kind": trial.kind,
                "terms": plain(trial.terms),
                "seconds": trial.seconds,
            },
            system_attrs=self._pictures.attribute(trial.number),
            intermediate_values={},
        )


def _agrees(mirrored: MirroredTrial, trial: Trial | None) -> bool:
    """Whether a mirrored trial is that of the ledger, or was so until its code changed."""
    if trial is None:
        return False
    shown = math.inf if mirrored.value is None else mirrored.value
    return any(math.isclose(shown, cost, rel_tol=RELATIVE_ROUNDING) for cost in (trial.cost, trial.former_cost))
