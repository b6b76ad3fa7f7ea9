"""One case: files made from a seed, read as a user would, in a process of its own with limits."""

import faulthandler
import json
import os
import random
import resource
import select
import shutil
import signal
import time
import traceback
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Protocol

from fuzzing import watch

from calib.errors import CalibError

MAX_SECONDS = 20  # s, processor time of a case
MAX_WAIT = 100.0  # s, wall-clock time of a case: on a machine whose cores are shared, it is longer
MAX_BYTES = 700_000_000  # of a case, beyond the anonymous ones of the process that forks
ADDRESS_SPACE = 6 * 2**30  # bytes beyond those of the process that forks; above it, memory is refused
MAX_MESSAGE = 20_000  # characters of a refusal
NOTES = "notes"  # file beside the folder of a case, of what it touched outside
STACK = "stack"  # file beside the folder of a case, that tells where it is when its time is over
SECRET = "the secret of another folder"


class OwnError(Exception):
    """A refusal by calib that is no CalibError, such as the status of a run's output."""


class Kind(Protocol):
    """A kind of file that users hand to calib.

    Attributes
    ----------
    name : of the kind
    """

    name: str

    def samples(self) -> Sequence[str]:
        """Names of the undamaged samples."""

    def make(self, sample: str, rng: random.Random | None, folder: Path) -> list[str]:
        """Write a sample into a folder, damaged by `rng`; return what was done to it."""

    def read(self, folder: Path) -> None:
        """Read what is there as a user would.

        Raises
        ------
        CalibError, OwnError : it is refused
        """

    def readable(self, folder: Path) -> frozenset[str]:
        """Files outside of the folder that the case itself names for reading."""


@dataclass
class Outcome:
    """How a case ended.

    Attributes
    ----------
    kind, seed, sample : of the case
    status : "read", "refused", or what is wrong with it
    detail : message or traceback
    signature : by which failures of one cause are recognised; empty where it is good
    seconds, bytes : processor time, and the largest memory of the process beyond the anonymous one of that which forks
    """

    kind: str
    seed: int
    sample: str
    done: list[str]
    status: str
    detail: str = ""
    signature: str = ""
    seconds: float = 0.0
    bytes: int = 0

    @property
    def good(self) -> bool:
        """Whether it was read or refused, within the limits."""
        return not self.signature


def lay_trap(root: Path) -> watch.Trap:
    """Make the folder `outside` of secrets beside the cases, which no case may touch."""
    outside = root / "outside"
    outside.mkdir(parents=True)
    for name in ("secret.txt", "secret.csv", "secret.toml", "secret.json", "secret.j2"):
        (outside / name).write_text(f"{SECRET}\n")
    import h5py
    import numpy as np

    for name in ("secret.nc", "secret.h5"):
        with h5py.File(outside / name, "w") as file:
            file["x"] = np.arange(20.0)
    (outside / "secret.raw").write_bytes(np.arange(400.0).tobytes())
    return watch.Trap(outside)


def choose(kind: Kind, seed: int) -> tuple[random.Random, str]:
    """Random numbers and sample of a case."""
    rng = random.Random(f"{kind.name} {seed}")
    return rng, rng.choice(list(kind.samples()))


def run_case(kind: Kind, seed: int, root: Path, trap: watch.Trap) -> Outcome:
    """Make and read a case in a child process.

    Parameters
    ----------
    root : holds `outside`, and the folder `case` afterwards
    """
    rng, sample = choose(kind, seed)
    folder = root / "case"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    done = _made(kind, sample, rng, folder)
    trap.caught()
    outcome = in_child(kind, folder)
    outcome.seed, outcome.sample, outcome.done = seed, sample, done
    if outcome.good:
        allowed = kind.readable(folder)
        for name, deed in trap.caught():
            if deed == "written" or str(folder.parent / "outside" / name) not in allowed:
                outcome.status, outcome.signature = f"outside/{name} was {deed}", f"outside {deed}"
    return outcome


def _made(kind: Kind, sample: str, rng: random.Random, folder: Path) -> list[str]:
    """Make a case in a forked child process, for libraries may fail at what they are made to write."""
    ours, theirs = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.write(theirs, json.dumps(kind.make(sample, rng, folder))[:60_000].encode())
        except Exception as error:
            os.write(theirs, json.dumps([f"not possible: {error!r:.200}"]).encode())
        finally:
            os._exit(0)
    os.close(theirs)
    with os.fdopen(ours) as file:
        text = file.read()
    os.waitpid(child, 0)
    try:
        return json.loads(text)
    except ValueError:
        return ["not possible"]


def write_files(files: Mapping[str, bytes], folder: Path) -> None:
    """Write the files of a sample, by their path in a folder."""
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


def in_child(kind: Kind, folder: Path) -> Outcome:
    """Read a folder in a forked child process, within limits of time and memory."""
    ours, theirs = os.pipe()
    begin, own = time.monotonic(), _anonymous_bytes()
    child = os.fork()
    if child == 0:
        os.close(ours)
        _child(kind, folder, theirs)
    os.close(theirs)
    text, late = _answer(ours, begin)
    os.close(ours)
    if late:
        os.killpg(child, signal.SIGKILL)
    _, status, usage = os.wait4(child, 0)
    seconds = usage.ru_utime + usage.ru_stime
    outcome = Outcome(kind.name, 0, "", [], **(json.loads(text) if text else {"status": "died"}))
    outcome.seconds, outcome.bytes = seconds, max(0, usage.ru_maxrss * 1024 - own)
    spent = os.WIFSIGNALED(status) and os.WTERMSIG(status) in (signal.SIGXCPU, signal.SIGKILL)
    if late or spent:
        outcome.status, outcome.detail = "too long", (folder.parent / STACK).read_text()
        at = [line.split() for line in outcome.detail.splitlines() if "/calib/" in line]
        outcome.signature = f"too long {' '.join(at[0][1:]) if at else ''}"
    elif not text:
        name = signal.Signals(os.WTERMSIG(status)).name if os.WIFSIGNALED(status) else f"exit {os.WEXITSTATUS(status)}"
        outcome.status = outcome.signature = f"crash {name}"
    elif outcome.good and seconds > MAX_SECONDS:
        outcome.status, outcome.signature = f"took {seconds:.0f} s", "slow"
    elif outcome.good and outcome.bytes > MAX_BYTES:
        outcome.status, outcome.signature = f"took {outcome.bytes / 1e9:.2f} GB", "memory"
    return outcome


def _anonymous_bytes() -> int:
    """Resident memory that a forked process has from its beginning; pages of files it has once it touches them."""
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    return int(status["RssAnon"].split()[0]) * 1024


def _answer(pipe: int, begin: float) -> tuple[str, bool]:
    """What the child says, and whether it was too late."""
    parts = []
    while True:
        left = begin + MAX_WAIT - time.monotonic()
        if left <= 0 or not select.select([pipe], [], [], left)[0]:
            return "", True
        part = os.read(pipe, 65536)
        if not part:
            return b"".join(parts).decode(), False
        parts.append(part)


def _child(kind: Kind, folder: Path, pipe: int) -> None:
    """Read the folder, say how it ended, and end this process."""
    os.setpgid(0, 0)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + ADDRESS_SPACE, used + ADDRESS_SPACE))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (2 * MAX_SECONDS, 2 * MAX_SECONDS))
    null = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(null, stream)
    os.chdir(folder)
    stack = open(folder.parent / STACK, "w")  # noqa: SIM115 - open until the process ends
    faulthandler.dump_traceback_later(MAX_WAIT - 10.0, file=stack)
    faulthandler.enable(file=stack)
    faulthandler.register(signal.SIGXCPU, file=stack, chain=True)
    notes = os.open(folder.parent / NOTES, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND)
    watching = watch.Watch(os.path.realpath(folder), kind.readable(folder), notes)
    watch.begin(watching)
    answer = judged(lambda: kind.read(folder))
    watch.end()
    complaints = (folder.parent / NOTES).read_text().splitlines()
    if not answer["signature"] and complaints:
        answer["status"], answer["detail"] = "outside", "\n".join(dict.fromkeys(complaints))[:5000]
        answer["signature"] = "outside " + complaints[0][:80]
    with os.fdopen(pipe, "w") as file:
        json.dump(answer, file)
    os._exit(0)


def judged(read: Callable[[], None]) -> dict[str, str]:
    """Status, detail and signature of a reading."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            read()
    except (CalibError, OwnError) as error:
        return _refusal(error)
    except BaseException as error:  # whatever else comes is what is sought
        frames = [f for f in traceback.extract_tb(error.__traceback__) if "/calib/" in f.filename]
        where = f"{Path(frames[-1].filename).name}:{frames[-1].name}" if frames else "elsewhere"
        text = traceback.format_exc()
        detail = text if len(text) < 6000 else f"{text[:3000]}\n...\n{text[-3000:]}"
        return {
            "status": "traceback",
            "detail": detail.encode(errors="replace").decode(),
            "signature": f"{type(error).__name__} {where}",
        }
    return {"status": "read", "detail": "", "signature": ""}


def _refusal(error: Exception) -> dict[str, str]:
    text, signature, status = str(error), "", "refused"
    chain: list[BaseException] = [error]
    while (cause := chain[-1].__cause__ or chain[-1].__context__) is not None and cause not in chain:
        chain.append(cause)
    for cause in chain:
        if isinstance(cause, MemoryError):
            status, signature = "asked for too much memory", f"MemoryError {_frame(cause)}"
    if len(text) > MAX_MESSAGE:
        status, signature = f"a message of {len(text)} characters", f"message length {text[:40]}"
    strange = next((c for c in text if (ord(c) < 32 and c not in "\n\t") or 0x7F <= ord(c) < 0xA0), None)
    if strange is not None:
        status, signature = f"a message with {strange!r}", "control character in a message"
    if not text.strip():
        status, signature = "no message", f"no message {_frame(error)}"
    return {"status": status, "detail": text[:6000].encode(errors="replace").decode(), "signature": signature}


def _frame(error: BaseException) -> str:
    frames = [f for f in traceback.extract_tb(error.__traceback__) if "/calib/" in f.filename]
    return f"{Path(frames[-1].filename).name}:{frames[-1].name}" if frames else "elsewhere"


def save(outcome: Outcome, folder: Path, target: Path) -> None:
    """Keep the files of a case, with what happened."""
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(folder, target, symlinks=True)
    (target / "case.json").write_text(json.dumps(asdict(outcome), indent=1))


def warm_up(kinds: Sequence[Kind], root: Path) -> None:
    """Read the undamaged samples in this process: what is imported and compiled on the way is there for all cases.

    Raises
    ------
    Exception : one of them is not read
    """
    for kind in kinds:
        for sample in dict.fromkeys(kind.samples()):
            folder = root / "sample"
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            kind.make(sample, None, folder)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                try:
                    kind.read(folder)
                except (CalibError, OwnError) as error:
                    if kind.name not in ("figure",):
                        raise AssertionError(f"{kind.name} {sample}: {error}") from error
