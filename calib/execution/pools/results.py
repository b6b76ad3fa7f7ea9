"""Results of evaluations, kept in a folder by their content until the caller has them."""

import hashlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calib.execution.files import whole

FOLDER = ".results"  # in the folder of a study
DIGEST_BYTES = 32  # of SHA-256, in front of a result


@dataclass(frozen=True)
class ResultFolder:
    """A folder in which results lie from the end of their evaluation until the caller has taken them over.

    Attributes
    ----------
    path : of the folder
    identity : text of all that decides what an evaluation gives, beside its payload
    content : text of a payload; None for one whose result is not kept
    """

    path: Path
    identity: str
    content: Callable[[Any], str | None]

    def key(self, payload: Any) -> str | None:
        """Name under which the result of a payload is kept; None for one that is not."""
        text = self.content(payload)
        return None if text is None else hashlib.sha256(f"{self.identity}\n{text}".encode()).hexdigest()


def keep(folder: Path, key: str, result: bytes) -> None:
    """Write a result; when this returns, it is on disk."""
    with whole(folder / key) as temporary:
        temporary.write_bytes(hashlib.sha256(result).digest() + result)


def kept(folder: Path, key: str) -> bytes | None:
    """Read a result; None where there is none, or a damaged one."""
    try:
        content = (folder / key).read_bytes()
    except OSError:
        return None
    digest, result = content[:DIGEST_BYTES], content[DIGEST_BYTES:]
    return result if hashlib.sha256(result).digest() == digest else None


def drop(folder: Path, key: str) -> None:
    """Delete a result that the caller has taken over."""
    with suppress(OSError):
        (folder / key).unlink()
