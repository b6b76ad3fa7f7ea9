"""A mirror of the ledger as an Optuna study, for optuna-dashboard."""

import io
import json
import os
import re
import time
import uuid
import warnings
from collections.abc import Callable, Iterable
from dataclasses import asdict
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import optuna
from optuna.artifacts import ArtifactMeta, FileSystemArtifactStore
from optuna.artifacts._upload import ARTIFACTS_ATTR_PREFIX  # private, see `_artifact`
from optuna.distributions import FloatDistribution
from optuna.storages import BaseStorage, JournalStorage, get_storage
from optuna.storages.journal import JournalFileBackend, JournalFileSymlinkLock
from optuna.study import StudyDirection
from optuna.trial import FrozenTrial, TrialState

from calib.store.header import Header
from calib.store.plain import plain
from calib.store.trial import Trial

JOURNAL, ARTIFACTS = "optuna.log", "artifacts"
MAX_LAG_TRIALS, MAX_LAG_SECONDS = 16, 2.0  # trials, s: by which the view may be behind the ledger
PASSWORD = re.compile(r"(?<=:)[^:/@]+(?=@)")  # of a URL
STALE_LOCK_AGE = 2.0  # s, at which a journal's lock can only be that of a dead process


def storage(folder: str | Path, view: str = "journal") -> BaseStorage:
    """Optuna storage that holds the view of the study in `folder`: its journal file, or the URL `view`."""
    if view == "journal":
        return JournalStorage(_Journal(Path(folder).resolve() / JOURNAL))
    return get_storage(view)


def address_without_password(view: str) -> str:
    """Address of a view, its password replaced by asterisks."""
    return PASSWORD.sub("***", view)


class _Journal(JournalFileBackend):
    """Optuna's journal file, not synced at every trial: what a power failure loses is restored from the ledger."""

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


class OptunaView:
    """Finished trials of one ledger in an Optuna study, added in batches; the ledger does not depend on it.

    Failed trials are in state FAIL, without a value. User attributes: number (asking number), phase, status, reason,
    kind, terms, seconds. A trial's picture is an artifact of it.

    Parameters
    ----------
    folder, view : where the journal and the artifacts lie; "journal" or an Optuna URL
    header : of the ledger; its definition's `windows` give the parameters, {name: {"low", "high", "scale"}}
    """

    def __init__(self, folder: Path, view: str, header: Header):
        if view == "journal":
            _mend_journal(folder / JOURNAL)
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        self._ledger = header.id
        self._windows: dict[str, FloatDistribution] = {
            name: FloatDistribution(w["low"], w["high"], log=w["scale"] == "log")
            for name, w in header.definition["windows"].items()
        }
        self._pictures = FileSystemArtifactStore(folder / ARTIFACTS)
        (folder / ARTIFACTS).mkdir(exist_ok=True)
        self._storage = storage(folder, view)
        self._study = self._own_study(header.name)
        self._waiting: list[FrozenTrial] = []
        self._flushed = time.monotonic()

    @property
    def name(self) -> str:
        """Name of the Optuna study: the study's own, with the ledger's id where another ledger has taken that."""
        return self._storage.get_study_name_from_id(self._study)

    def _own_study(self, name: str) -> int:
        """Number of this ledger's study in the storage, made where there is none."""
        taken = {study.study_name: study for study in self._storage.get_all_studies()}
        for study in taken.values():
            if study.user_attrs.get("ledger") == self._ledger:
                return study._study_id  # private, but the only number that a storage answers to
        if name in taken:
            name = f"{name} {self._ledger[:8]}"
        number = self._storage.create_new_study([StudyDirection.MINIMIZE], name)
        self._storage.set_study_user_attr(number, "ledger", self._ledger)
        return number

    def catch_up(self, trials: Iterable[Trial], picture: Callable[[Trial], bytes | None]) -> None:
        """Add the trials that are missing in the view; mark those that a killed process left running as failed."""
        present = set()
        for mirrored in self._storage.get_all_trials(self._study, deepcopy=False):
            if mirrored.state == TrialState.RUNNING:
                self._storage.set_trial_state_values(mirrored._trial_id, TrialState.FAIL)
            present.add(mirrored.user_attrs.get("number"))
        for trial in trials:
            if trial.number not in present:
                self._waiting.append(self._frozen(trial, picture(trial)))
        self.flush()

    def add(self, trial: Trial, picture: bytes | None = None) -> None:
        """Take a finished trial, with a picture of it (PNG)."""
        self._waiting.append(self._frozen(trial, picture))
        if len(self._waiting) >= MAX_LAG_TRIALS or time.monotonic() - self._flushed > MAX_LAG_SECONDS:
            self.flush()

    def flush(self) -> None:
        """Write the trials that wait."""
        while self._waiting:
            self._storage.create_new_trial(self._study, self._waiting[0])
            self._waiting.pop(0)
        self._flushed = time.monotonic()

    def _frozen(self, trial: Trial, picture: bytes | None) -> FrozenTrial:
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
                "number": trial.number,
                "phase": trial.phase,
                "status": trial.status,
                "reason": trial.reason,
                "kind": trial.kind,
                "terms": plain(trial.terms),
                "seconds": trial.seconds,
            },
            system_attrs={} if picture is None else self._artifact(trial.number, picture),
            intermediate_values={},
        )

    def _artifact(self, number: int, picture: bytes) -> dict[str, str]:
        """Store a picture; return the attribute by which Optuna and its dashboard find it.

        Optuna's own `upload_artifact` wants a trial that still runs; a mirrored one is never seen running.
        """
        key = str(uuid.uuid5(uuid.UUID(self._ledger), str(number)))
        self._pictures.write(key, io.BytesIO(picture))
        meta = ArtifactMeta(artifact_id=key, filename=f"{number:06d}.png", mimetype="image/png", encoding=None)
        return {ARTIFACTS_ATTR_PREFIX + key: json.dumps(asdict(meta))}

    def close(self) -> None:
        """Write the waiting trials and close the storage."""
        self.flush()
        self._storage.remove_session()


def _mend_journal(path: Path) -> None:
    """Cut off an unfinished last line, delete the lock of a dead process, and set a damaged file aside."""
    lock = path.with_name(path.name + ".lock")
    while lock.is_symlink():
        try:
            age = time.time() - lock.lstat().st_mtime
        except FileNotFoundError:
            break
        if age > STALE_LOCK_AGE:
            lock.unlink(missing_ok=True)
        else:
            time.sleep(0.05)
    if not path.exists():
        return
    content = path.read_bytes()
    whole = content.rfind(b"\n") + 1
    if whole < len(content):
        os.truncate(path, whole)
    try:
        for line in content[:whole].splitlines():
            json.loads(line)
    except ValueError:
        aside = path.with_name(path.name + ".damaged")
        os.replace(path, aside)
        warnings.warn(f"{path} was damaged; it is now {aside.name}, and a new one is made", stacklevel=2)
