"""The folder of one study."""

import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, Self

import xarray as xr

from calib.store.address import JOURNAL_VIEW
from calib.store.header import Header, StudyHeader
from calib.store.journal import JOURNAL
from calib.store.ledger import RESIDUALS, TRIALS, Ledger, write_errors_reported
from calib.store.lock import Lock
from calib.store.mirror import Mirror
from calib.store.optuna_view import OptunaView
from calib.store.pictures import ARTIFACTS, Pictures
from calib.store.record_files import Keep, RecordFiles
from calib.store.trial import Trial, best

RESULT_FILES = ("result.json", "report.html")  # that `calib.workflows.calibrate` makes of the trials
PROVENANCE = ("name", "digest", "id", "versions", "processor", "cpu", "blas")  # of the header, in a record file
Picture = Callable[[Trial, Mapping[str, xr.Dataset]], bytes]


class Store:
    """Ledger, kept records and Optuna view of a study, with one writer at a time.

    The ledger is authoritative: on opening, everything else is brought in line with it.

    Parameters
    ----------
    folder : created where it is missing
    view : "journal" for the file `optuna.log`, a URL that Optuna takes, or None
    keep : trials whose records are kept: "best" (the best one), "improving" (those better than all before) or "all"
    picture : draws a trial with its records as PNG; called for the trials whose records are kept
    """

    def __init__(
        self,
        folder: str | Path,
        view: str | None = JOURNAL_VIEW,
        keep: Keep = "improving",
        picture: Picture | None = None,
    ):
        self.folder = Path(folder).absolute()
        self._view_name, self._picture = view, picture
        self._lock, self._ledger, self._record_files = (
            Lock(self.folder),
            Ledger(self.folder),
            RecordFiles(self.folder, keep),
        )
        self._mirror: Mirror | None = None
        self._pictures: Pictures | None = None
        self.best: Trial | None = None

    @property
    def header(self) -> Header:
        """Header of the segment now in force."""
        return self._ledger.header

    def open(self, header: StudyHeader, fresh: bool = False) -> list[Trial]:
        """Open the folder for the study of `header` and return its trials, in the order they ended.

        Parameters
        ----------
        fresh : begin anew; present files are moved to a folder `before-<date>` inside

        Raises
        ------
        CalibError : folder of another study (with the differences), in use by another process, unreadable, not writable
        """
        with write_errors_reported(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
            self._lock.acquire()
        try:
            if fresh:
                self._set_aside()
            trials = self._ledger.open(header)
            self.best = best(trials)
            self._record_files.open(None if self.best is None else self.best.number)
            if self._view_name is not None:
                self._open_view(self._view_name, trials)
        except BaseException:
            self.close()
            raise
        return trials

    def _set_aside(self) -> None:
        names = [TRIALS, RESIDUALS, JOURNAL, ARTIFACTS, "records", *RESULT_FILES]
        present = [path for name in names if (path := self.folder / name).exists()]
        present += self.folder.glob("best*.nc")
        if not present:
            return
        aside = self.folder / f"before-{datetime.now(UTC):%Y%m%d-%H%M%S-%f}"
        with write_errors_reported(aside):
            aside.mkdir()
            for path in present:
                path.rename(aside / path.name)

    def _open_view(self, view: str, trials: list[Trial]) -> None:
        with write_errors_reported(self.folder / ARTIFACTS):
            self._pictures = Pictures(self.folder, self.header.id)
        recorded = self._record_files.numbers() if self._picture is not None else set()
        for trial in trials:
            if trial.number in recorded and trial.number not in self._pictures:
                self._draw(trial, self._record_files.read(trial.number))
        self._mirror = Mirror(view, partial(OptunaView, self.folder, view, self.header, self._pictures), trials)

    def append(self, trial: Trial, records: Mapping[str, xr.Dataset] | None = None) -> Trial:
        """Log a trial, write its `records` where they are to be kept, and add it to the view; return it as logged.

        Raises
        ------
        CalibError : disk full or not writable; the trials logged before are safe
        """
        improves = trial.scored and (self.best is None or trial.rank < self.best.rank)
        artifacts = records if records and trial.scored and self._record_files.wants(improves) else None
        if artifacts is not None:  # before the line: a logged trial is never evaluated again
            self._record_files.write(trial.number, artifacts, self._provenance(trial))
        trial = self._ledger.append(trial)
        if improves:
            self.best = trial
            self._record_files.promote(trial.number)
        if self._mirror is not None:
            if artifacts is not None:
                self._draw(trial, artifacts)
            self._mirror.add(trial)
        return trial

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Lock the folder once more: after `close`, while the result is judged.

        Raises
        ------
        CalibError : another process has taken the folder meanwhile
        """
        with write_errors_reported(self.folder):
            self._lock.acquire()
        try:
            yield
        finally:
            self._lock.release()

    def keep_confirmed(self, trial: Trial, records: Mapping[str, xr.Dataset]) -> None:
        """Make the records by the confirming simulator, of the trial with its confirmed score, the best ones.

        Raises
        ------
        CalibError : disk full or not writable
        """
        self._record_files.write_best(trial.number, records, {**self._provenance(trial), "confirmed": True})

    def begin_segment(self, budget: int) -> None:
        """Begin a new segment of the ledger; see `calib.store.ledger.Ledger`."""
        self._ledger.begin_segment(budget)

    def _provenance(self, trial: Trial) -> dict[str, Any]:
        header = {key: getattr(self.header, key) for key in PROVENANCE}
        score = {"total": trial.cost, "terms": {k: v for k, v in trial.terms.items() if v < float("inf")}}
        return {"trial": trial.number, "values": trial.values, "score": score, "kind": trial.kind, "study": header}

    def _draw(self, trial: Trial, records: Mapping[str, xr.Dataset]) -> None:
        """Draw a trial for the view; a study does not fail for a picture."""
        if self._picture is None or self._pictures is None:
            return
        try:
            self._pictures.write(trial.number, self._picture(trial, records))
        except Exception as error:
            warnings.warn(f"no picture of trial {trial.number}: {type(error).__name__}: {error}", stacklevel=3)

    def close(self) -> None:
        """Bring the view up to date, close the files and release the lock."""
        try:
            if self._mirror is not None:
                self._mirror.close()
        finally:
            self._mirror = None
            self._ledger.close()
            self._lock.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
