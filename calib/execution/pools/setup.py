"""What a worker is told of a pool, and what it answers."""

import sys
import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from calib.execution.pool import Failure
from calib.execution.pools.limits import CallLimits
from calib.execution.pools.sent import SentFunction

STOPPED = 75  # exit code of the program that evaluates for a worker, where its pool has been closed


@dataclass(frozen=True)
class PoolSetup:
    """What a worker needs to evaluate for a pool.

    Attributes
    ----------
    function : that is evaluated
    limits : of each evaluation
    identity : of the process that asks: see `calib.execution.pools.identity.identity`
    folder : in which results are kept; None where they are not
    path : folders in which that process finds modules
    number : of the pool, unlike that of any other; a file of that name lies in `folder`
    """

    function: SentFunction
    limits: CallLimits
    identity: Mapping[str, str]
    folder: Path | None = None
    path: tuple[str, ...] = field(default_factory=lambda: module_folders())
    number: str = field(default_factory=lambda: uuid.uuid4().hex)


@dataclass(frozen=True)
class WorkerState:
    """What a worker says once it is told of a pool.

    Attributes
    ----------
    differences : from the process that asks, one text each; it may not evaluate where there are any
    shares_folder : whether it has the folder of results in common with that process
    processor : that kernels are compiled for
    """

    differences: tuple[str, ...]
    shares_folder: bool
    processor: str


@dataclass(frozen=True)
class Answer:
    """What a worker gives back.

    Attributes
    ----------
    result : pickled result, or why there is none
    worker : its name
    prepared : what it has said of itself
    """

    result: bytes | Failure
    worker: str
    prepared: WorkerState


@dataclass(frozen=True)
class Unfit:
    """A worker that may not evaluate, and why.

    Attributes
    ----------
    worker : its name
    reasons : one text each
    """

    worker: str
    reasons: tuple[str, ...]


def module_folders() -> tuple[str, ...]:
    """Folders in which this process finds modules, beside those of its own installation of Python."""
    own = [Path(place).resolve() for place in (sys.prefix, sys.base_prefix)]
    folders = [Path(folder).resolve() for folder in sys.path]
    return tuple(str(folder) for folder in folders if not any(folder.is_relative_to(place) for place in own))
