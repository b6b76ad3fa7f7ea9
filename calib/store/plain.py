"""Conversion of values to JSON types, and of JSON to dataclasses.

A field of a dataclass stands in JSON under its name, or under the key that its metadata state:
`field(metadata={"key": "class"})`.
"""

import math
from collections.abc import Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Any, TypeVar, get_args, get_origin, get_type_hints

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

PLAIN: dict[Any, Any] = {str: str, bool: bool, int: int, float: int | float}  # type of a field -> of its value in JSON
PLAIN_NAMES = {str: "a text", bool: "true or false", int: "a whole number", float: "a number"}
T = TypeVar("T", bound="DataclassInstance")


def plain(value: Any) -> Any:
    """Return the same in dicts, lists, texts and finite numbers; infinity and NaN become None."""
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(entry) for entry in value]
    if is_dataclass(value) and not isinstance(value, type):
        return {_key(field): plain(getattr(value, field.name)) for field in fields(value)}
    if hasattr(value, "tolist"):  # arrays and scalars of numpy
        return plain(value.tolist())
    return value


def typed(kind: type[T], document: Mapping[str, Any]) -> T:
    """Return the dataclass `kind` that a JSON object describes, with the dataclasses that its fields declare.

    A field that is missing or null takes its default, or None where it has none and may be None; a key that is no field
    is left out.

    Raises
    ------
    ValueError : no such object: a field without a default is missing, or a value has another shape
    """
    document, hints = _as(Mapping, document, kind.__name__), get_type_hints(kind)
    given = {}
    for field in fields(kind):
        key, hint = _key(field), hints[field.name]
        required = field.default is MISSING and field.default_factory is MISSING
        value = document.get(key)
        if value is not None or required and key in document and NoneType in get_args(hint):
            given[field.name] = _value(hint, value)
        elif required:
            raise ValueError(f"{kind.__name__} has no {key}")
    return kind(**given)


def _key(field: Field[Any]) -> str:
    return field.metadata.get("key", field.name)


def _value(hint: Any, value: Any) -> Any:
    """Return a JSON value as the type that a field declares: dataclasses, mappings and tuples of them, or as it is."""
    if isinstance(hint, UnionType):
        hint = next(one for one in get_args(hint) if one is not NoneType)
    if value is not None and hint in PLAIN:
        return _as(PLAIN[hint], value, PLAIN_NAMES[hint])
    if value is None:
        return None
    if isinstance(hint, type) and is_dataclass(hint):
        return typed(hint, value)
    if get_origin(hint) is Mapping:
        return {key: _value(get_args(hint)[1], one) for key, one in _as(Mapping, value, "a mapping").items()}
    if get_origin(hint) is tuple:
        return tuple(_value(get_args(hint)[0], one) for one in _as(list | tuple, value, "a list"))
    return value


def _as(shape: Any, value: Any, what: str) -> Any:
    if not isinstance(value, shape) or isinstance(value, bool) and shape is not bool:
        raise ValueError(f"expected {what}, got {value!r:.60}")
    return value
