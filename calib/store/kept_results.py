"""Results of a long calculation in a file, so that one that was stopped or killed goes on from them."""

import fcntl
import hashlib
import json
import os
from collections.abc import Hashable
from contextlib import suppress
from pathlib import Path
from typing import Any

from calib.errors import CalibError
from calib.execution.files import PERMISSIONS
from calib.execution.pools.results import DIGEST_BYTES
from calib.store.ledger import write_at
from calib.store.plain import plain

LENGTH_BYTES = 8  # of the length of a result
ENTRY_HEAD_BYTES = 2 * DIGEST_BYTES + LENGTH_BYTES  # of an entry: key, check sum of key and result, length


class KeptResults:
    """A file of results by their keys, SHA-256 digests; use it in a with block.

    It begins with a digest of what the results belong to. Those of something else are forgotten, and so is all from the
    first damaged entry on. They are a copy, without which the same results are calculated again: where the disk is
    full, or another process writes the file, none are kept, and nobody is stopped by that.

    Parameters
    ----------
    path : of the file, made where it is missing
    identity : all that decides what the results are beside their keys, as JSON

    Raises
    ------
    CalibError : the file cannot be opened
    """

    def __init__(self, path: Path, identity: Any):
        self._path = path
        digest = hashlib.sha256(json.dumps(plain(identity), sort_keys=True).encode()).digest()
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CREAT, PERMISSIONS)
        except OSError as error:
            raise CalibError(f"cannot write {path}: {error.strerror}; mend that and run again") from error
        self._places: dict[Hashable, tuple[int, int]] = {}  # key -> offset and length of the result
        self._end = 0
        self._alone = self._keeping = _locked(self._file)
        if self._alone:
            if os.pread(self._file, DIGEST_BYTES, 0) == digest:
                self._read()
            else:
                self._append(digest)
            with suppress(OSError):
                os.ftruncate(self._file, self._end)
        self.known = len(self._places)  # when it was opened

    def __contains__(self, key: object) -> bool:
        return key in self._places

    def get(self, key: Hashable) -> bytes:
        """Return the result of a key that is in the file."""
        offset, length = self._places[key]
        return os.pread(self._file, length, offset)

    def add(self, key: bytes, result: bytes) -> None:
        """Keep a result, where results are kept and that of the same key is not."""
        if key in self._places or not self._keeping:
            return
        begin = self._end + ENTRY_HEAD_BYTES
        self._append(key + _check_sum(key, result) + len(result).to_bytes(LENGTH_BYTES, "big") + result)
        if self._keeping:
            self._places[key] = begin, len(result)

    def remove(self) -> None:
        """Delete the file, unless another process writes it: what the results were for is complete."""
        if self._alone:
            self._path.unlink(missing_ok=True)

    def __enter__(self) -> "KeptResults":
        return self

    def __exit__(self, *exception: object) -> None:
        os.close(self._file)

    def _read(self) -> None:
        """Find the entries of the file, up to the first that is damaged or unfinished."""
        self._end = DIGEST_BYTES
        while True:
            head = os.pread(self._file, ENTRY_HEAD_BYTES, self._end)
            key, check_sum = head[:DIGEST_BYTES], head[DIGEST_BYTES : 2 * DIGEST_BYTES]
            length = int.from_bytes(head[2 * DIGEST_BYTES :], "big")
            begin = self._end + ENTRY_HEAD_BYTES
            if len(head) < ENTRY_HEAD_BYTES or begin + length > os.fstat(self._file).st_size:
                return
            if _check_sum(key, os.pread(self._file, length, begin)) != check_sum:
                return
            self._places[key] = begin, length
            self._end = begin + length

    def _append(self, data: bytes) -> None:
        """Write at the end; where that fails, keep nothing more."""
        try:
            write_at(self._file, self._path, data, self._end, sync=False)
        except CalibError:
            self._keeping = False
        else:
            self._end += len(data)


def _locked(file: int) -> bool:
    """Lock an open file until it is closed; False where another process holds the lock."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True


def _check_sum(key: bytes, result: bytes) -> bytes:
    return hashlib.sha256(key + result).digest()
