"""The scalar features of a trial, of which what all trials share is in memory once."""

from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any, overload

import numpy as np

MAX_DESCRIPTIONS = 64  # that are remembered: a study has one or a few
PLACEHOLDER = object()  # in the place of a number
TEXTS = frozenset(("label", "record", "body", "unit"))  # keys of a feature
NUMBERS = frozenset(("measured", "simulated", "tolerance", "resolution"))
MAX_FEATURE_VALUE = 2**1000  # integers above it are no numbers of a ledger

Description = tuple[tuple[tuple[str, Any], ...], ...]  # key and value of each entry of each feature


@lru_cache(MAX_DESCRIPTIONS)
def _once(description: Description) -> Description:
    """Return the equal one that there is already.

    Raises
    ------
    TypeError : a value is neither text nor number, or a text or a number in the place of the other
    """
    for key, value in (entry for feature in description for entry in feature):
        is_number = value is PLACEHOLDER or isinstance(value, int | float | np.number)
        fits = value is None or is_number and key not in TEXTS or isinstance(value, str) and key not in NUMBERS
        if not fits or isinstance(value, int) and abs(value) > MAX_FEATURE_VALUE:
            raise TypeError(f"{key} of a feature is {value!r:.40}")
    return description


class ScalarFeatures(Sequence[dict[str, Any]]):
    """Features as dicts, each made when it is asked for: their numbers, and a description that trials share.

    Raises
    ------
    TypeError, AttributeError : a feature is no dict of texts and numbers
    """

    __slots__ = ("_description", "_numbers")

    def __init__(self, features: Iterable[Mapping[str, Any]]):
        own = list(features)
        self._numbers = array("d", [value for one in own for value in one.values() if type(value) is float])
        self._description = _once(
            tuple(
                tuple([(key, PLACEHOLDER if type(value) is float else value) for key, value in one.items()])
                for one in own
            )
        )

    def __len__(self) -> int:
        return len(self._description)

    @overload
    def __getitem__(self, index: int) -> dict[str, Any]: ...
    @overload
    def __getitem__(self, index: slice) -> list[dict[str, Any]]: ...
    def __getitem__(self, index: int | slice) -> dict[str, Any] | list[dict[str, Any]]:
        return list(self)[index]

    def __iter__(self) -> Iterator[dict[str, Any]]:
        numbers = iter(self._numbers)
        for entries in self._description:
            yield {key: next(numbers) if value is PLACEHOLDER else value for key, value in entries}

    def __eq__(self, other: object) -> bool:
        return list(self) == list(other) if isinstance(other, Sequence) else NotImplemented

    __hash__ = None  # type: ignore[assignment]  # it equals lists

    def __repr__(self) -> str:
        return repr(list(self))
