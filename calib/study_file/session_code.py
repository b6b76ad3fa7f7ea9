"""A digest of what a notebook or an interactive session defines: it has no source file."""

import hashlib
from collections.abc import Iterator
from types import CodeType, FunctionType, ModuleType
from typing import Any

PLAIN = (bool, int, float, complex, str, bytes, type(None))


def session_digest(thing: object) -> str:
    """Return the digest of a class, function or instance by its compiled code.

    It covers the functions, classes and plain values of the same module that this code names, directly or indirectly.
    Another version of Python gives another digest.
    """
    digest = hashlib.sha256()
    for text in _parts(thing, set()):
        digest.update(text.encode() + b"\0")
    return f"compiled sha256 {digest.hexdigest()}"


def _parts(thing: Any, known: set[int]) -> Iterator[str]:
    """Texts that determine what a thing does, each thing once."""
    if isinstance(thing, PLAIN):
        yield repr(thing)
        return
    if id(thing) in known or isinstance(thing, ModuleType):
        return
    known.add(id(thing))
    if isinstance(thing, tuple | list):
        for item in thing:
            yield from _parts(item, known)
    elif isinstance(thing, FunctionType):
        yield from _function_parts(thing, known)
    elif isinstance(thing, staticmethod | classmethod):
        yield from _parts(thing.__func__, known)
    elif isinstance(thing, property):
        yield from _parts((thing.fget, thing.fset), known)
    elif isinstance(thing, type):
        yield from _class_parts(thing, known)
    elif isinstance(function := getattr(thing, "py_func", None), FunctionType):  # compiled by numba
        yield from _parts(function, known)
    elif hasattr(thing, "__dict__"):
        yield type(thing).__qualname__
        for name, value in sorted(vars(thing).items()):
            yield name
            yield from _parts(value, known)


def _class_parts(thing: type, known: set[int]) -> Iterator[str]:
    yield thing.__qualname__
    for base in thing.__bases__:
        if base.__module__ == thing.__module__:
            yield from _parts(base, known)
    for name, value in sorted(vars(thing).items()):
        if name not in ("__dict__", "__weakref__", "__doc__", "__module__"):
            yield name
            yield from _parts(value, known)


def _function_parts(function: FunctionType, known: set[int]) -> Iterator[str]:
    names = set[str]()
    yield from _code_parts(function.__code__, names)
    yield from _parts(function.__defaults__, known)
    for name in sorted(names & set(function.__globals__)):
        value = function.__globals__[name]
        if isinstance(value, PLAIN) or getattr(value, "__module__", None) == function.__module__:
            yield name
            yield from _parts(value, known)


def _code_parts(code: CodeType, names: set[str]) -> Iterator[str]:
    """Texts of compiled code; the names that it looks up are added to `names`."""
    names.update(code.co_names)
    yield code.co_code.hex()
    yield repr((code.co_names, code.co_varnames))
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code_parts(constant, names)
        elif isinstance(constant, frozenset):
            yield repr(sorted(map(repr, constant)))  # its order changes from process to process
        else:
            yield repr(constant)
