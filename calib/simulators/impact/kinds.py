"""Kernel functions of which problems of one kind have one, and those of another kind another.

A kernel is compiled for each kind of problem, so that none pays for what only another needs: a rigid stop does not take
the time of a compliant one, and a motion without loads of laws or tables is compiled without these.
"""

import inspect
from collections.abc import Callable
from typing import Any

from numba import types
from numba.extending import overload

from calib.simulators.impact.problem import Problem
from calib.simulators.law_calls import UNCOMPILED


def by_stop(rigid: Callable, compliant: Callable, options: dict[str, Any]) -> Callable:
    """Make one kernel function of two with the same arguments, of which the first is the problem.

    options : of numba, with which the one that serves is compiled
    """
    return _by_field("compliance", rigid, compliant, options)


def by_loads(unloaded: Callable, loaded: Callable, options: dict[str, Any]) -> Callable:
    """Make one kernel function of two, as `by_stop` does: without loads over the step, and with them."""
    return _by_field("loads", unloaded, loaded, options)


def _by_field(name: str, absent: Callable, present: Callable, options: dict[str, Any]) -> Callable:
    """Make one kernel function of two: where this field of the problem is None, and where it is not."""
    plain = [getattr(function, "py_func", function) for function in (absent, present)]

    def either(problem: Problem, *rest: Any) -> Any:
        return plain[getattr(problem, name) is not None](problem, *rest)

    if UNCOMPILED:
        return either

    def choose(problem: types.NamedTuple, *rest: types.Type) -> Callable:
        return plain[problem.types[problem.fields.index(name)] is not types.none]

    signature = inspect.signature(plain[0])  # numba compares those of the two with that of the function that serves
    either.__signature__ = signature  # type: ignore[attr-defined]
    choose.__signature__ = signature  # type: ignore[attr-defined]
    without_cache: Any = {name: value for name, value in options.items() if name != "cache"}
    overload(either, jit_options=without_cache)(choose)
    return either
