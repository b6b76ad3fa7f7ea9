"""The view of a study in Optuna's journal file."""

import json
import os
import time
import warnings
from collections.abc import Generator, Iterator, Sequence
from pathlib import Path
from typing import Any

from optuna.storages import BaseStorage, JournalStorage
from optuna.storages.journal import JournalFileBackend, JournalFileSymlinkLock
from optuna.storages.journal._storage import JournalOperation  # private, but what the lines of a file are told by
from optuna.trial import FrozenTrial, TrialState

from calib.store.mirrored import NUMBER, MirroredTrial

JOURNAL = "optuna.log"
STALE_LOCK_AGE = 2.0  # s, for which only the lock of a dead process stays the same
STUDY_OPERATIONS = (
    JournalOperation.CREATE_STUDY,
    JournalOperation.DELETE_STUDY,
    JournalOperation.SET_STUDY_USER_ATTR,
    JournalOperation.SET_STUDY_SYSTEM_ATTR,
)


def whole_journal(path: Path) -> JournalStorage:
    """Optuna storage of a journal with all its trials."""
    return JournalStorage(_File(path))


class JournalPlace:
    """Optuna's journal file, written without holding its trials in memory.

    An unfinished last line is cut off, the lock of a dead process deleted, and a damaged file set aside.

    Parameters
    ----------
    path : of the file, made where it is missing
    """

    shared = False  # with the views of other ledgers

    def __init__(self, path: Path):
        _unlock(path)
        self._path, self._file = path, _Studies(path)
        self.storage: BaseStorage = JournalStorage(self._file)

    def mirrored(self, study: int) -> Iterator[MirroredTrial]:
        """Yield the trials of an Optuna study as they are now in the file."""
        if self._file.has_other_writers:
            return map(MirroredTrial.of, self.whole().get_all_trials(study, deepcopy=False))
        return iter(self._file.trials.pop(study, []))

    def whole(self) -> BaseStorage:
        """Storage that knows the trials too."""
        return whole_journal(self._path)

    def add(self, study: int, trials: Sequence[FrozenTrial]) -> None:
        """Add finished trials to an Optuna study."""
        for trial in trials:
            self.storage.create_new_trial(study, trial)
        self._file.forget_trials()
        self.storage = JournalStorage(self._file)

    def close(self) -> None:
        """Close the storage."""
        self.storage.remove_session()


class _File(JournalFileBackend):
    """A journal that is not synced at every trial: what a power failure loses is restored from the ledger."""

    def __init__(self, path: Path):
        # absolute: Optuna's lock is a symbolic link, and spins for ever on a relative name
        self._mirror, self._guard = str(path.absolute()), JournalFileSymlinkLock(str(path.absolute()))
        super().__init__(self._mirror, self._guard)

    def append_logs(self, logs: list[dict[str, Any]]) -> None:
        """Add lines to the file."""
        text = "".join(json.dumps(log, separators=(",", ":")) + "\n" for log in logs)
        self._guard.acquire()
        try:
            with open(self._mirror, "ab") as file:
                file.write(text.encode())
        finally:
            self._guard.release()


class _Studies(_File):
    """A journal of which Optuna is told what concerns studies, and trials that were added since `forget_trials`.

    Attributes
    ----------
    trials : study -> its trials when the file was opened
    has_other_writers : whether there are lines that calib does not write, such as those of a trial that Optuna ran
    """

    def __init__(self, path: Path):
        super().__init__(path)
        self.trials = dict[int, list[MirroredTrial]]()
        self.has_other_writers = False
        self._told = list[dict[str, Any]]()
        try:
            self._read(path)
        except (KeyError, TypeError, ValueError):
            aside = path.with_name(path.name + ".damaged")
            os.replace(path, aside)
            warnings.warn(f"{path} was damaged; it is now {aside.name}, and a new one is made", stacklevel=2)
            self.trials, self._told, self.has_other_writers = {}, [], False
            path.touch()

    def _read(self, path: Path) -> None:
        end = 0
        with open(path, "rb") as file:
            for line in file:
                if not line.endswith(b"\n"):
                    return os.truncate(path, end)
                end += len(line)
                self._take(json.loads(line))
        return None

    def _take(self, log: dict[str, Any]) -> None:
        if log["op_code"] in STUDY_OPERATIONS:
            self._told.append(log)
        elif log["op_code"] == JournalOperation.CREATE_TRIAL and "state" in log:
            value, state = log.get("value"), TrialState(log["state"])
            trial = MirroredTrial(log.get("user_attrs", {}).get(NUMBER), value, state)
            self.trials.setdefault(log["study_id"], []).append(trial)
        else:
            self.has_other_writers = True

    def append_logs(self, logs: list[dict[str, Any]]) -> None:
        """Add lines to the file."""
        super().append_logs(logs)
        self._told += logs

    def read_logs(self, log_number_from: int) -> Generator[dict[str, Any], None, None]:
        """Yield what is told from this number on."""
        yield from self._told[log_number_from:]

    def forget_trials(self) -> None:
        """Tell a new storage nothing of the trials added so far."""
        self._told = [log for log in self._told if log["op_code"] in STUDY_OPERATIONS]


def _unlock(path: Path) -> None:
    """Wait for the lock of another process; that of a dead one, which stays the same, is deleted."""
    lock, known, since = path.with_name(path.name + ".lock"), (0, 0), 0.0
    while lock.is_symlink():
        try:
            status = lock.lstat()
        except FileNotFoundError:
            break
        identity = status.st_ino, status.st_mtime_ns
        if identity != known:
            known, since = identity, time.monotonic()  # the clock of modification times may be set back
        if time.monotonic() - since > STALE_LOCK_AGE:
            lock.unlink(missing_ok=True)
        else:
            time.sleep(0.05)
