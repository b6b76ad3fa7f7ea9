"""Where evaluations run, as a study states it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from calib.errors import CalibError, nearest
from calib.execution.pools.local import check_jobs

PoolKind = Literal["local", "dask", "executor"]
KINDS: tuple[PoolKind, ...] = ("local", "dask", "executor")
KEYS = {"local": (), "dask": ("scheduler", "cluster"), "executor": ("executor",)}  # of which a kind takes one


@dataclass(frozen=True)
class PoolSettings:
    """Where evaluations run.

    Attributes
    ----------
    kind : "local" (child processes of this machine), "dask" (workers of a Dask scheduler), "executor" (anything with
        the shape of `concurrent.futures.Executor`)
    jobs : evaluations side by side, at most; of a `cluster`, the workers that are asked for. None: one where it is
        local, else as many as the workers take
    memory : limit of one evaluation with the programs that it starts  [byte]; None for none
    scheduler : address of a Dask scheduler that runs, "tcp://host:8786", of kind "dask"
    cluster : "module:Class" of a Dask cluster that is started, instead of `scheduler`
    executor : "module:Class" of an executor
    options : of the class that `cluster` or `executor` names

    Raises
    ------
    CalibError : settings that do not fit together
    """

    kind: PoolKind = "local"
    jobs: int | None = None
    memory: float | None = None
    scheduler: str | None = None
    cluster: str | None = None
    executor: str | None = None
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise CalibError(f"kind: expected {', '.join(KINDS)}, got {self.kind!r}{nearest(str(self.kind), KINDS)}")
        if self.jobs is not None:
            if isinstance(self.jobs, bool) or not isinstance(self.jobs, int) or self.jobs < 1:
                raise CalibError(f"jobs: expected a whole number from 1 on, got {self.jobs!r}")
            if self.kind == "local":
                check_jobs(self.jobs)
        stated = [key for keys in KEYS.values() for key in keys if getattr(self, key) is not None]
        wanted = KEYS[self.kind]
        for key in stated:
            if key not in wanted:
                owner = next(kind for kind, keys in KEYS.items() if key in keys)
                raise CalibError(f'{key} belongs to kind = "{owner}", and the kind is "{self.kind}"; drop one of them')
        if wanted and len(stated) != 1:
            came = " and ".join(stated) or "none of them"
            raise CalibError(f'kind = "{self.kind}" needs {" or ".join(wanted)}; got {came}')
        if self.options and not self.named:
            raise CalibError("options are those of the class that cluster or executor names; there is none here")
        for key in ("cluster", "executor"):
            text = getattr(self, key)
            if text is not None and not all(text.partition(":")):
                raise CalibError(f'{key}: expected "module:Class", such as {_EXAMPLES[key]}, got {text!r}')

    @property
    def named(self) -> str | None:
        """The class whose `options` these are; None where there is none."""
        return self.cluster or self.executor

    @property
    def local_jobs(self) -> int:
        """Child processes on this machine, beside the evaluations too: one where those run elsewhere."""
        return 1 if self.kind != "local" or self.jobs is None else self.jobs


_EXAMPLES = {"cluster": '"dask_jobqueue:SLURMCluster"', "executor": '"executorlib:SlurmJobExecutor"'}
