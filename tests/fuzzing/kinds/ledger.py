"""Ledgers: lines of trials, residuals, results and views, in whatever state."""

import json
import random
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory

from echo_study import write_study
from fuzzing.case import write_files
from fuzzing.mutations import damaged, shuffled_lines, text_damaged, tree_damaged

from calib.cli.status import study_status, view_of
from calib.errors import CalibError
from calib.execution import workers
from calib.execution.pool import InProcess
from calib.store import Store, checksum
from calib.study import evaluate
from calib.study_file import load
from calib.workflows.calibrate import rebuild, summary_so_far

SAMPLES = Path(__file__).parents[2] / "samples" / "v0_1"
BINARY = (".f64", ".nc", ".png")


@cache
def _files() -> dict[str, dict[str, bytes]]:
    found = {}
    with TemporaryDirectory() as temporary:
        folder = Path(temporary) / "echo"
        folder.mkdir()
        study = load(write_study(folder))
        store = Store(study.folder, study.view, study.keep)
        study.study.run(store, InProcess(partial(evaluate, study.study)))
        shutil.copytree(SAMPLES / "sample", Path(temporary) / "sample")
        (Path(temporary) / "sample" / "results").rename(Path(temporary) / "sample" / "out")
        for place in sorted(Path(temporary).iterdir()):
            files = [p for p in sorted(place.rglob("*")) if p.is_file() and p.name not in ("report.html", "lock")]
            found[place.name] = {str(p.relative_to(place)): p.read_bytes() for p in files}
    return found


@contextmanager
def _without_processes(simulated: bool) -> Iterator[None]:
    """Evaluate in this process, or let every evaluation fail: what is evaluated is not what is tried here."""
    pool = workers.LocalPool
    workers.LocalPool = lambda function, *_, **__: InProcess(function if simulated else _fail)
    try:
        yield
    finally:
        workers.LocalPool = pool


def _fail(payload: object) -> None:
    raise CalibError("it is not simulated here")


class _Ledgers:
    name = "ledger"

    def samples(self) -> list[str]:
        return list(_files())

    def make(self, sample: str, rng: random.Random | None, folder: Path) -> list[str]:
        write_files(_files()[sample], folder)
        if rng is None:
            return []
        names = sorted(p.relative_to(folder).as_posix() for p in (folder / "out").rglob("*") if p.is_file())
        names += ["out/trials.jsonl"] * 2 * len(names)
        name = rng.choice(names)
        path = folder / name
        if path.suffix in BINARY:
            path.write_bytes(damaged(path.read_bytes(), rng))
            done = "bytes"
        elif rng.random() < 0.3:
            path.write_bytes(text_damaged(path.read_bytes(), rng))
            done = "bytes"
        else:
            done = _document_damaged(path, rng)
        if rng.random() < 0.06:
            (folder / "report").touch()
        return [name, done]

    def read(self, folder: Path) -> None:
        study_status(folder, None)
        view_of(folder, None)
        with _without_processes(
            simulated=(folder / "bench.nc").exists()
        ):  # the other model takes half a minute to compile
            if (folder / "report").exists():
                rebuild(folder / "study.toml")
            else:
                summary_so_far(folder / "study.toml")
        file = load(folder / "study.toml")
        store = Store(file.folder, file.view, file.keep)
        for trial in store.open(file.study.header):
            _ = trial.residuals
        store.close()

    def readable(self, folder: Path) -> frozenset[str]:
        return frozenset()


def _document_damaged(path: Path, rng: random.Random) -> str:
    """Damage what a JSON file or one of its lines says, with a check sum that fits where there is one."""
    lines = path.read_bytes().splitlines(keepends=True)
    if path.suffix == ".json":
        tree, done = tree_damaged(json.loads(b"".join(lines)), rng)
        path.write_text(_text(tree))
        return done
    at = rng.choice([0, rng.randrange(len(lines))])
    try:
        content = json.loads(lines[at])
    except ValueError:  # optuna's view may hold such
        path.write_bytes(shuffled_lines(path.read_bytes(), rng))
        return "lines"
    tree, done = tree_damaged(content, rng)
    if isinstance(tree, dict) and checksum.KEY in tree and rng.random() < 0.8:
        tree.pop(checksum.KEY)
        lines[at] = checksum.sealed(_text(tree))
    else:
        lines[at] = (_text(tree) + "\n").encode()
    path.write_bytes(b"".join(lines))
    if rng.random() < 0.2:
        path.write_bytes(shuffled_lines(path.read_bytes(), rng))
    return f"line {at + 1}: {done}"


def _text(tree: object) -> str:
    return json.dumps(tree, separators=(",", ":"))


LEDGER = _Ledgers()
