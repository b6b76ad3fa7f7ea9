"""How the kernels of the simulators are compiled."""

from typing import Any

# `Any`: the options of numba's decorators differ in type, and their annotations do not know `_nrt`
COMPILED: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
}  # called from Python, or making arrays
# Called from compiled code, making no arrays and calling nothing that does: without counting references. Counted, each
# array of a tuple that is handed over costs an atomic increment and a decrement, in all more than a step's arithmetic.
WITHIN = {**COMPILED, "_nrt": False}
INLINED = {**WITHIN, "forceinline": True}
# Called from compiled code alone, with a problem, its state or its scratch, some sixty arrays: without the wrapper by
# which Python calls a kernel, whose compilation takes a quarter of the whole. A call from Python ends the process.
ENCLOSED = {**WITHIN, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
ENCLOSED_INLINED = {**ENCLOSED, "forceinline": True}
