"""Kernel functions of which a rigid stop has one and a compliant stop another.

A kernel is compiled for each kind of stop, so that a rigid one does not pay for what only the other needs.
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
    plain = [getattr(function, "py_func", function) for function in (rigid, compliant)]

    def either(problem: Problem, *rest: Any) -> Any:
        return plain[problem.compliance is not None](problem, *rest)

    if UNCOMPILED:
        return either

    def choose(problem: types.NamedTuple, *rest: types.Type) -> Callable:
        compliance = problem.types[problem.fields.index("compliance")]
        return plain[compliance is not types.none]

    signature = inspect.signature(plain[0])  # numba compares those of the two with that of the function that serves
    either.__signature__ = signature  # type: ignore[attr-defined]
    choose.__signature__ = signature  # type: ignore[attr-defined]
    without_cache: Any = {name: value for name, value in options.items() if name != "cache"}
    overload(either, jit_options=without_cache)(choose)
    return either
