"""Things as JSON takes them."""

import math
from collections.abc import Mapping
from typing import Any


def plain(thing: Any) -> Any:
    """Return the same in dicts, lists, texts and finite numbers; infinity and NaN become None."""
    if isinstance(thing, float):
        return float(thing) if math.isfinite(thing) else None
    if isinstance(thing, Mapping):
        return {str(key): plain(value) for key, value in thing.items()}
    if isinstance(thing, list | tuple | set | frozenset):
        return [plain(value) for value in thing]
    if hasattr(thing, "tolist"):  # arrays and scalars of numpy
        return plain(thing.tolist())
    return thing
