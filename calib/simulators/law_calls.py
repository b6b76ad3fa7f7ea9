"""Laws called by a kernel, by their machine address.

Handing first-class functions to a kernel costs 50 us each and run, more than some runs take; an address costs nothing,
and the kernel is still compiled once for any combination of laws. Where numba's compiler is switched off, the functions
themselves are called.
"""

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import config
from numba.core.base import BaseContext
from numba.core.typing.templates import Signature
from numba.experimental.function_type import _get_wrapper_address
from numba.extending import intrinsic

from calib.modelling.laws import LAW_PARAMETERS, SIGNATURES, BoundLaw, at_site

UNCOMPILED: bool = config.DISABLE_JIT  # type: ignore[attr-defined]  # numba reads its settings from the environment


@cache
def _address(function: Callable, site: str) -> int:
    # private: the public way to an address is a wrapper in the caller, which costs what is avoided here
    return _get_wrapper_address(function, SIGNATURES[site])


def addresses(laws: Sequence[BoundLaw], site: str) -> tuple[np.ndarray, np.ndarray, int]:
    """Return the m laws of `site` for a kernel: addresses (m,), numbers (m, those of the longest law), and m."""
    here = at_site(laws, site)
    parameters = np.zeros((len(here), max((law.p.size for law in here), default=LAW_PARAMETERS)))
    for row, law in zip(parameters, here, strict=True):
        row[: law.p.size] = law.p
    if UNCOMPILED:
        return np.array([law.function for law in here], dtype=object), parameters, len(here)
    return np.array([_address(law.function, site) for law in here], dtype=np.int64), parameters, len(here)


def acting(laws: Sequence[BoundLaw], bodies: Sequence[str], ports: Sequence[str] = ()) -> np.ndarray:
    """Say which of m force laws acts where: (m, bodies and ports), in the order of `addresses`; at a port, if named."""
    here = at_site(laws, "force")
    acts = np.zeros((len(here), len(bodies) + len(ports)), dtype=bool)
    for row, law in zip(acts, here, strict=True):
        named = law.bodies or ()
        row[:] = [law.bodies is None or body in named for body in bodies] + [port in named for port in ports]
    return acts


def _caller(site: str) -> Callable[..., float]:
    """Make the kernel function (address, *arguments of the law) -> value of the law at that address."""
    law = SIGNATURES[site]
    if UNCOMPILED:
        return lambda function, *arguments: function(*arguments)

    def call(context: BaseContext, builder: ir.IRBuilder, signature: Signature, values: Sequence[ir.Value]) -> ir.Value:
        kinds = [context.get_value_type(kind) for kind in (law.return_type, *law.args)]
        pointer = builder.inttoptr(values[0], ir.FunctionType(kinds[0], kinds[1:]).as_pointer())
        return builder.call(pointer, values[1:])

    signature = law.return_type(types.int64, *law.args)
    # an intrinsic's arguments are read off its source, so each arity is spelt out
    if site == "force":
        return intrinsic(lambda typing, address, t, x, v, p, z, dz: (signature, call))
    if site == "contact":
        return intrinsic(lambda typing, address, place, clearance, rate, pressure, p: (signature, call))
    if site == "excitation":
        return intrinsic(lambda typing, address, t, phase, amplitude, x, p: (signature, call))
    return intrinsic(lambda typing, address, e, speed, p: (signature, call))


force = _caller("force")
contact = _caller("contact")
excitation = _caller("excitation")
restitution = _caller("restitution")
