"""Where a key of a TOML text stands."""

import tomllib
from collections.abc import Iterator, Sequence
from typing import Any

Key = tuple[str | int, ...]  # ("record", 0, "path"): the path of the first [[record]]


def lines(text: str) -> dict[Key, int]:
    """Line (counted from 1) on which each key of a valid TOML text begins.

    tomllib keeps no positions, but a TOML text cut after a complete statement is a TOML text too: the keys that a
    statement adds are the difference between two such beginnings. So is one cut between the entries of an array, which
    is then closed. Keys inside an entry are assigned the line on which it begins.
    """
    rows = text.split("\n")
    known: dict[Key, int] = {}
    begin = 0
    for end in range(1, len(rows) + 1):
        read = _read("\n".join(rows[:end]))
        if read is None:
            read = _read("\n".join([*rows[:end], "]"]))
        if read is None:
            continue  # inside a value of several lines
        for key in _keys(read):
            known.setdefault(key, begin + 1)
        begin = end
    return known


def _read(text: str) -> dict[str, Any] | None:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return None


def line_of(known: dict[Key, int], key: Sequence[str | int]) -> int | None:
    """Line of `key`, or of the nearest enclosing key that stands in the text."""
    for length in range(len(key), 0, -1):
        if tuple(key[:length]) in known:
            return known[tuple(key[:length])]
    return None


def dotted(key: Sequence[str | int]) -> str:
    """Write a key as a reader would: ``record[2].path``, with entries counted from 1."""
    text = ""
    for part in key:
        text += f"[{part + 1}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def _keys(value: object, above: Key = ()) -> Iterator[Key]:
    if isinstance(value, dict):
        for name, inner in value.items():
            yield (*above, name)
            yield from _keys(inner, (*above, name))
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield (*above, index)
            yield from _keys(inner, (*above, index))
