"""The ledger: every trial of a study in the order they ended, each synced to disk before the next."""

import hashlib
import json
import os
import uuid
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from calib.errors import CalibError
from calib.execution.files import PERMISSIONS
from calib.modelling.parameter import Window
from calib.store import checksum
from calib.store.code import by_present_code, code_change
from calib.store.environment import Environment, environment
from calib.store.header import HEADER_KEYS, Header, StudyHeader
from calib.store.plain import plain
from calib.store.residuals import BYTES_PER_RESIDUAL, SideFile, StoredResiduals
from calib.store.trial import KEYS, Trial, line, trial_of
from calib.units import count

TRIALS, RESIDUALS = "trials.jsonl", "residuals.f64"
FORMAT_VERSION = 1  # of the ledger: a log of another is not read
RECENT_NUMBERS = 4096  # texts of numbers that are remembered while a ledger is read; a line has some 100


def read(folder: str | Path, definition: Mapping[str, Any] | None = None) -> tuple[Header, list[Trial]]:
    """Header now in force and the trials of a study's folder, without a lock; a run may be going on there.

    Raises
    ------
    CalibError : no ledger there, or an unreadable one, or that of another study than `definition` says
    """
    content = _parse(Path(folder) / TRIALS)
    if not content.headers:
        raise CalibError(f"{folder}: no study was run here (no {TRIALS} with a header)")
    if definition is not None:
        _compare(Path(folder) / TRIALS, content.headers[0].definition, json.loads(json.dumps(definition)))
    return content.headers[-1], by_present_code(content.trials, content.headers)


class Ledger:
    """`trials.jsonl` and `residuals.f64` of one folder, open for one writer.

    `trials.jsonl` holds a header line, then one line a trial. A later header line begins a new segment (other
    libraries, another processor or BLAS kernel, changed code) or states a new budget.

    A line counts when its line end is there, and it ends with its check sum. Residuals are synced before the line that
    points at them, and the line before the call returns.
    """

    def __init__(self, folder: Path):
        self._path, self._side_path = folder / TRIALS, folder / RESIDUALS
        self._file = self._side = -1
        self._end = self._side_end = 0
        self._next = 0
        self._residuals: SideFile | None = None
        self._header: Header | None = None

    @property
    def header(self) -> Header:
        """Header of the segment now in force.

        Raises
        ------
        RuntimeError : the ledger was not opened
        """
        if self._header is None:
            raise RuntimeError(f"{self._path} was not opened; call open first")
        return self._header

    def open(self, header: StudyHeader) -> list[Trial]:
        """Cut off an unfinished line, compare the header, and return the trials logged so far.

        Raises
        ------
        CalibError : another study's ledger; unreadable; not writable
        """
        here = environment()
        definition = json.loads(json.dumps(header.definition))
        content = _parse(self._path)
        if content.headers:
            _compare(self._path, content.headers[0].definition, definition)
        with write_errors_reported(self._path):
            self._file = os.open(self._path, os.O_RDWR | os.O_CREAT, PERMISSIONS)
            self._side = os.open(self._side_path, os.O_RDWR | os.O_CREAT, PERMISSIONS)
            os.ftruncate(self._file, content.end)
            os.ftruncate(self._side, content.side_end)
            self._residuals = SideFile(self._side_path)
        self._end, self._side_end = content.end, content.side_end
        if content.headers:
            self._resume(content, header, here)
        else:
            self._begin(header, definition, here)
        return by_present_code(content.trials, [*content.headers, self.header])

    def _begin(self, header: StudyHeader, definition: dict[str, Any], here: Environment) -> None:
        canonical = json.dumps(definition, separators=(",", ":"))
        own = Header(
            format=FORMAT_VERSION,
            id=uuid.uuid4().hex,
            segment=0,
            name=header.name,
            definition=definition,
            digest=hashlib.sha256(canonical.encode()).hexdigest(),
            screen=header.screen,
            first=header.screen,
            hint=header.budget,
            budget=header.budget,
            code=header.code,
        )
        self._write_header(own.within(here))
        folder = os.open(self._path.parent, os.O_RDONLY)  # the names of the two files have to last, too
        os.fsync(folder)
        os.close(folder)

    def _resume(self, content: "_Content", header: StudyHeader, here: Environment) -> None:
        """Continue the last segment, or begin a new one where libraries, processor, BLAS or code have changed."""
        last = content.headers[-1]
        self._header = replace(last, code=header.code)
        self._next = max((trial.number for trial in content.trials), default=-1) + 1
        changes = differences(plain(last.environment), plain(here))
        if changes:
            warnings.warn(
                "this study was begun with other libraries, or on another processor or BLAS kernel:\n  "
                + "\n  ".join(changes)
                + f"\nwhat is logged ({count(len(content.trials), 'trial')}) stays valid; a new segment continues it",
                stacklevel=4,
            )
        sentence = code_change(last.code, header.code, len(content.trials))
        if sentence:
            warnings.warn(sentence, stacklevel=4)
        if changes or sentence:
            self.begin_segment(header.budget)
        elif header.budget != last.budget:
            self._write_header(replace(self._header, budget=header.budget))

    def begin_segment(self, budget: int) -> None:
        """Begin a new segment: the trials so far stay valid, but are not asked for again when the study is resumed."""
        last = self.header
        first = max(last.screen, self._next)
        segment = replace(last, segment=last.segment + 1, first=first, hint=budget, budget=budget)
        self._write_header(segment.within(environment()))

    def append(self, trial: Trial) -> Trial:
        """Log a trial; when this returns, it outlives a power failure.

        Returns
        -------
        the trial in little memory: its residuals are read from the side file when they are asked for

        Raises
        ------
        CalibError : disk full or not writable; the ledger is left as it was before
        """
        place = stored = None
        if trial.residuals is not None:
            data = np.ascontiguousarray(trial.residuals, dtype="<f8")
            place = (self._side_end // BYTES_PER_RESIDUAL, data.size)
            write_at(self._side, self._side_path, data.tobytes(), self._side_end)
        text = checksum.sealed(line(trial, place))
        write_at(self._file, self._path, text, self._end)
        self._end += len(text)
        self._next = max(self._next, trial.number + 1)
        if place is not None:
            self._side_end += BYTES_PER_RESIDUAL * place[1]
            if self._residuals is not None:
                stored = StoredResiduals(self._residuals, *place)
        return trial.compact(stored)

    def _write_header(self, header: Header) -> None:
        self._header = replace(header, time=datetime.now(UTC).isoformat(timespec="seconds"))
        text = checksum.sealed(json.dumps(self._header.as_dict(), allow_nan=False, separators=(",", ":")))
        write_at(self._file, self._path, text, self._end)
        self._end += len(text)

    def close(self) -> None:
        """Close the files."""
        for file in (self._file, self._side):
            if file >= 0:
                os.close(file)
        self._file = self._side = -1


def write_at(file: int, path: Path, data: bytes, offset: int, sync: bool = True) -> None:
    """Write at `offset` and sync, if asked for; where that fails, cut the file back to `offset`."""
    with write_errors_reported(path):
        try:
            written = 0
            while written < len(data):
                written += os.pwrite(file, data[written:], offset + written)
            if sync:
                os.fsync(file)
        except BaseException:
            os.ftruncate(file, offset)
            raise


@contextmanager
def write_errors_reported(path: Path) -> Iterator[None]:
    """Turn a failure to write at `path` into a message with its remedy."""
    try:
        yield
    except (OSError, RuntimeError) as error:  # netCDF's library says RuntimeError
        why = getattr(error, "strerror", None) or f"{error} (the disk may be full)"
        raise CalibError(
            f"cannot write {path}: {why}; mend that and run again, the study goes on where it was"
        ) from error


@dataclass(frozen=True)
class _Content:
    """The complete lines of a ledger: headers, trials, and where each file ends  [bytes]."""

    headers: list[Header]
    trials: list[Trial]
    end: int
    side_end: int


_number = lru_cache(RECENT_NUMBERS)(float)  # a measured value that every line states is held once in memory


class _Damage(ValueError):
    """What is wrong with a line that can be read, and what to do about it."""

    def __init__(self, what: str, remedy: str = "restore it, cut that line out"):
        super().__init__(what)
        self.remedy = remedy


DAMAGE = (AttributeError, KeyError, OverflowError, RecursionError, TypeError, ValueError)  # by a line that is no trial


def _parse(path: Path) -> _Content:
    """Read the complete lines of the ledger at `path`, whose side file lies beside it.

    An unfinished last line is left out, and with a warning also lines whose residuals are missing.
    """
    headers, trials = list[Header](), list[Trial]()
    windows: dict[str, Window] = {}
    end, side_end = 0, 0
    lines, size, side, count = _files(path)
    for index, text in enumerate(lines):
        try:
            content = _object(text, is_last=end + len(text) == size)
            if content is None:
                break
            if "format" in content:
                headers.append(_header(text, content, path))
                windows = _windows(headers[-1])
            elif not headers:
                raise CalibError(f"{path}: not a ledger of calib (no header in line 1); choose another folder")
            else:
                offset, length = _checked(text, content)["residuals"] or (0, 0)
                if offset + length > count:
                    _warn_of_lost_residuals(path, index, 1 + sum(1 for _ in lines))
                    break
                stored = None if side is None or content["residuals"] is None else StoredResiduals(side, offset, length)
                trials.append(_trial(content, stored, headers[-1].segment, windows))
                side_end = max(side_end, BYTES_PER_RESIDUAL * (offset + length))
        except DAMAGE as error:
            raise _damaged(path, index, error) from error
        end += len(text)
    return _Content(headers, trials, end, side_end)


def _files(path: Path) -> tuple[Iterator[bytes], int, SideFile | None, int]:
    """Lines of the ledger at `path`, its size  [bytes], and the residuals beside it, with their number.

    The size is taken first: a study that goes on there writes residuals before the lines that point at them.
    """
    try:
        size = path.stat().st_size if path.exists() else 0
        side = path.with_name(RESIDUALS)
        count = side.stat().st_size // BYTES_PER_RESIDUAL if side.exists() else 0
        return _lines(path, size), size, SideFile(side) if count else None, count
    except OSError as error:
        raise CalibError(f"cannot read {path}: {error.strerror}") from error


def _lines(path: Path, size: int) -> Iterator[bytes]:
    """Lines of the first `size` bytes of a file, with their line ends."""
    if not size:
        return
    try:
        with open(path, "rb") as file:
            while size and (text := file.readline(size)):
                size -= len(text)
                yield text
    except OSError as error:
        raise CalibError(f"cannot read {path}: {error.strerror}") from error


def _object(text: bytes, is_last: bool) -> dict[str, Any] | None:
    """Return the JSON object of a line; None where it is the last one and unfinished."""
    try:
        content = json.loads(text, parse_float=_number, parse_constant=_no_number) if text.endswith(b"\n") else None
    except RecursionError as error:
        raise _Damage("its brackets are nested too deeply") from error
    except ValueError:
        content = None
    if isinstance(content, dict):
        return content
    if is_last:
        return None
    raise ValueError("no JSON object")


def _no_number(constant: str) -> float:
    """Refuse NaN and infinity, which a ledger writes as null."""
    raise ValueError(f"{constant} is no number of a ledger")


def _checked(text: bytes, content: dict[str, Any]) -> dict[str, Any]:
    """Return the content of a trial's line, refused where its check sum is wrong.

    A line without one, as version 0.1 wrote it, has no key but those of that version: another one is a damaged name.
    """
    if content.keys() - KEYS and not checksum.is_intact(text, content):
        raise _Damage("its check sum does not fit its content")
    offset, length = content["residuals"] or (0, 0)
    if type(offset) is not int or type(length) is not int or offset < 0 or length < 0:
        raise ValueError("no place in the side file")
    return content


def _trial(
    content: dict[str, Any], residuals: StoredResiduals | None, segment: int, windows: Mapping[str, Window]
) -> Trial:
    """Trial of a line, refused where its values contradict its point."""
    trial = trial_of(content, residuals, segment)
    if windows and (contradiction := trial.contradiction(windows)):
        raise _Damage(f"the values of trial {trial.number} contradict its point: {contradiction}")
    return trial


def _windows(header: Header) -> dict[str, Window]:
    """Windows of the searched parameters; none where the definition states none."""
    stated = header.definition.get("windows", {})
    try:
        return {name: Window(window["low"], window["high"], window["scale"]) for name, window in stated.items()}
    except CalibError as error:
        raise _Damage(f"a window of the study is none ({error})") from error


def _warn_of_lost_residuals(path: Path, index: int, lost: int) -> None:
    warnings.warn(
        f"{path}: from line {index + 1} on residuals are lost, of {count(lost, 'trial')}, evaluated again now",
        stacklevel=5,
    )


def _compare(path: Path, old: Mapping[str, Any], new: Mapping[str, Any]) -> None:
    changes = differences(old, new)
    if changes:
        raise CalibError(
            f"{path} was made by another study:\n  "
            + "\n  ".join(changes)
            + "\nundo the change, choose another folder, or begin afresh (--fresh moves what is there aside)"
        )


def _damaged(path: Path, index: int, error: Exception) -> CalibError:
    damage = error if isinstance(error, _Damage) else _Damage("not readable")
    return CalibError(
        f"{path}, line {index + 1}: {damage}; the file was changed or the disk is damaged; "
        f"{damage.remedy}, or begin afresh (--fresh moves what is there aside)"
    )


def _header(text: bytes, content: dict[str, Any], path: Path) -> Header:
    """Header of a line; one without a check sum, as version 0.1 wrote it, has no key but those of a header."""
    if content.keys() - HEADER_KEYS and not checksum.is_intact(text, content):
        raise _Damage(
            "the check sum of this header does not fit its content",
            "the trials after it are safe: restore the line from a copy of the file, or put it right and delete its "
            f'"{checksum.KEY}"',
        )
    content.pop(checksum.KEY, None)
    if content["format"] != FORMAT_VERSION:
        raise CalibError(
            f"{path}: format {content['format']}, this calib reads {FORMAT_VERSION}; use the calib that wrote it"
        )
    return Header.from_dict(content)


def differences(old: Any, new: Any, where: str = "") -> list[str]:
    """Lines "key: old -> new" of two nests of dicts, lists and plain values; keys joined by dots."""
    if isinstance(old, dict) and isinstance(new, dict):
        lines = []
        for key in [*old, *(key for key in new if key not in old)]:
            path = f"{where}.{key}" if where else str(key)
            if key not in new:
                lines.append(f"{path}: {_short(old[key])} -> (absent)")
            elif key not in old:
                lines.append(f"{path}: (absent) -> {_short(new[key])}")
            else:
                lines += differences(old[key], new[key], path)
        if not lines and list(old) != list(new):
            lines.append(f"{where or 'keys'}: order {list(old)} -> {list(new)}")
        return lines
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        pairs = enumerate(zip(old, new, strict=True))
        return [text for index, pair in pairs for text in differences(*pair, f"{where}[{index}]")]
    return [] if old == new else [f"{where}: {_short(old)} -> {_short(new)}"]


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 80 else text[:77] + "..."
