"""The view kept in step with the ledger, by a thread for which no study waits."""

import threading
import warnings
from collections.abc import Callable, Iterable
from contextlib import closing

from calib.execution.interrupt import uninterrupted
from calib.store.address import address_without_password, failure_reason
from calib.store.optuna_view import OptunaView
from calib.store.trial import Trial

FIRST_PAUSE, MAX_PAUSE = 1.0, 60.0  # s, before a view that failed is tried again; doubled each time
MAX_SILENCE = 30.0  # s without progress, after which the end of a study waits for its view no longer
MAX_BATCH = 64  # trials written at once


class Mirror:
    """The trials of a ledger in a view, which may fail, hang and come back: it is made good as soon as it answers.

    What is there already is looked up whenever the view is opened, so that every trial is there once. A view that is
    out of reach is tried again after a pause, and a last time in the end. Its failure is said once.

    Parameters
    ----------
    view : its address
    connect : opens it
    trials : of the ledger so far
    """

    def __init__(self, view: str, connect: Callable[[], OptunaView], trials: Iterable[Trial]):
        self._view, self._connect, self._trials = view, connect, list(trials)
        self._news = threading.Condition()
        self._ending = self._abandoned = self._warned = False
        self._failure = ""
        self._progress = 0
        self._pause = FIRST_PAUSE
        self._thread = threading.Thread(target=self._run, name="view", daemon=True)
        with uninterrupted():  # Ctrl-C is for the thread that evaluates
            self._thread.start()

    def add(self, trial: Trial) -> None:
        """Take a trial that the ledger has."""
        with self._news:
            self._trials.append(trial)
            self._news.notify()
        self._warn()

    def close(self) -> None:
        """Wait until the view has all trials, or fails or stands still."""
        with self._news:
            self._ending = True
            self._news.notify()
        try:
            before = -1
            while self._thread.is_alive() and before < self._progress:
                before = self._progress
                self._thread.join(MAX_SILENCE)
            if self._thread.is_alive():
                self._failure = self._failure or f"no answer within {MAX_SILENCE:.0f} s"
        finally:
            self._abandoned = True
        self._warn()

    def _warn(self) -> None:
        if self._failure and not self._warned:
            self._warned = True
            warnings.warn(
                f"the Optuna view ({address_without_password(self._view)}) failed: {self._failure}; the study goes on "
                "without it, the ledger has all trials, and the view is mended as soon as it answers, at the latest "
                "when the study is next opened",
                stacklevel=4,
            )

    def _run(self) -> None:
        while True:
            last = self._ending
            try:
                return self._follow()
            except Exception as error:  # databases fail in many ways, and none of them is the study's business
                self._failure = self._failure or failure_reason(error, self._view)
            if last or self._abandoned:
                return None
            with self._news:
                self._news.wait_for(lambda: self._ending, self._pause)
            self._pause = min(2.0 * self._pause, MAX_PAUSE)

    def _follow(self) -> None:
        """Write what the view lacks, then each trial as it comes, until the end."""
        with closing(self._connect()) as view:
            self._progress += 1
            seen = len(self._trials)
            waiting = view.missing(self._trials[:seen])
            self._progress += 1
            self._pause = FIRST_PAUSE
            while True:
                for first in range(0, len(waiting), MAX_BATCH):
                    if self._abandoned:
                        return
                    view.add(waiting[first : first + MAX_BATCH])
                    self._progress += 1
                with self._news:
                    self._news.wait_for(lambda: self._ending or len(self._trials) > seen)  # noqa: B023
                    waiting = self._trials[seen:]
                seen += len(waiting)
                if not waiting:
                    return
