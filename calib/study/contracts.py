"""What a study needs of a search method and of the place its trials are kept in."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import xarray as xr

from calib.store import Header, StudyHeader, Trial


@dataclass(frozen=True, eq=False)
class Outcome:
    """What an optimiser learns of a point.

    Attributes
    ----------
    cost : what to minimise; infinity where the evaluation failed
    residuals : (n,) float64 with one n for the whole study, or None where the evaluation failed
    status : "ok" or why there is no score
    kind : kind of the simulated motion, or None
    """

    cost: float
    residuals: np.ndarray | None
    status: str
    kind: str | None


class Optimiser(Protocol):
    """What a study needs of a search method.

    To write one:

    1. It is made as ``optimiser(dim=, seed=, budget=, batch=)``, all further arguments being options with a default.
       `budget` is the number of trials of the whole study, those told before the first ask included. The optimiser
       counts what it is told against it: `ask` returns no more points than are left, `stop` a reason once none are.
    2. Everything random comes from `seed`. The same outcomes told in the same order give the same asks, bit for bit, in
       another process too: a study is resumed by asking and telling all over again.
    3. `ask` returns points (n, dim) in [0, 1], n of your choice; about `batch` points keep the processes busy.
    4. `tell` brings the outcomes of exactly the points asked for last, in their order. Before the first `ask` it may
       bring others: the study's screen, or the trials of an earlier stretch.
    5. An outcome may be infinite and without residuals: the simulation failed there. All of them may be.
    6. `stop` is looked at before every `ask`: a reason to end in plain words, or None to go on.
    7. `close` ends threads and files. A study calls it once, whatever happened; a second call does nothing.
    8. Optionally `summary()`: a dict (or dataclass) on how far the search may be trusted, after the last `tell`.

    `calib.testing.OptimiserSuite` checks all this.
    """

    def ask(self) -> np.ndarray:
        """Return the next points (n, dim)."""
        ...

    def tell(self, x: np.ndarray, outcomes: Sequence[Outcome]) -> None:
        """Take the outcomes of the points `x` (n, dim)."""
        ...

    def stop(self) -> str | None:
        """Return why the search has ended, or None."""
        ...

    def close(self) -> None:
        """End what runs beside."""
        ...


class StoreContract(Protocol):
    """What a study needs of the place its trials are kept in.

    To write one:

    1. `open` takes the header (name, definition, screen, budget), refuses another definition than the one the trials
       there belong to, and returns those trials; where their code was another than that of the header, as
       `Trial.superseded`. It keeps a second writer out until `close`.
    2. `header` is then the one in force: with `screen` of the first opening, and of the present segment `segment`, its
       `hint` (the budget it began with) and `first` (its first search number). A segment begins at first opening, when
       libraries, processor or code have changed since, and at `begin_segment`, with the number after the highest logged
       (or the screen).
    3. `append` returns when the trial is safe: after a power failure, `open` returns it with the same bits. What it
       returns is the same trial, which may read its residuals when they are asked for, lest all are held in memory.
    4. Whatever it cannot write is a CalibError.
    """

    @property
    def header(self) -> Header:
        """The header in force."""
        ...

    def open(self, header: StudyHeader, fresh: bool = False) -> list[Trial]:
        """Return the trials there; with `fresh`, set them aside and return none."""
        ...

    def begin_segment(self, budget: int) -> None:
        """Begin a new segment."""
        ...

    def append(self, trial: Trial, records: Mapping[str, xr.Dataset] | None) -> Trial:
        """Log a trial, with its simulated records where there are any; return it as it is held from now on."""
        ...

    def close(self) -> None:
        """Let go of the place."""
        ...
