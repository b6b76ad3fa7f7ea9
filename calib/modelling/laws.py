"""The sites where a law may act, and the one signature that every law of a site has.

A law is a scalar function. The decorator of its site compiles it with the site's signature, so that all laws of a site
are values of one type: a kernel calls them by their addresses and is compiled once, whatever the laws are.

=========== ============================= ============ ================================================================
site        signature                     returns      arguments
=========== ============================= ============ ================================================================
force       (t, x, v, p, z, dz)           [m/s^2]      time [s], displacement [m] and velocity [m/s] of the body (both
                                                       absolute), parameters, up to four internal states and, to be
                                                       written, their rates
gap         (place, p)                    [m]          place along the contact line in [-1, 1], 0 the middle;
                                                       added to the gap
contact     (place, clearance, rate,      [Pa]         place as above, clearance of the two sides [m], negative in
            pressure, p)                               penetration, its rate [m/s], the pressure without laws;
                                                       added to the pressure
restitution (e, speed, p)                 [1]          the coefficient without laws, closing speed [m/s];
                                                       added to e, and the sum is clipped to [0, 1]
excitation  (t, phase, amplitude, x, p)   [its unit]   time [s], phase of the drive [rad], its amplitude, its value
                                                       undisturbed; added to the excitation
structure   (present, p)                  new values   values of some parameters of the simulator, in SI and in the
                                                       order in which the effect names them (plain Python, as the
                                                       next four)
stop        (simulator, p)                a simulator  the simulator, parameters by name; that with another stop in
                                                       the place of its own takes them beside its parameters
numerical   (simulator, p)                a simulator  the simulator, parameters by name
sensor      (record, p)                   a record     the simulated record, parameters by name
response    (record, p)                   a record     the simulated frequency response, parameters by name
=========== ============================= ============ ================================================================

A force law acts on bodies, or at a port between two: there x is the clearance [m], v its rate [m/s], and the force is
per unit mass of the body that an impact turns round, positive where it opens the clearance; the other body takes the
reaction. Laws of one site add up; those in plain Python act one after the other, and the model itself serves them for
every simulator.

Compiled laws divide as IEEE 754 has it: a division by zero is infinite or NaN, and ends the run. An exception could not
leave a function that is called by its address: its value would be 0.
"""

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
from numba import njit
from numba.core import types

MAX_LAW_PARAMETERS = 80  # numbers per law: a free function of two arguments takes 78
LAW_PARAMETERS = 8  # numbers that a row holds at least: rows of usual laws lie side by side in the processor's cache
STATES = 4  # internal states per force law

_f = types.float64
_array = types.Array(_f, 1, "C")
SIGNATURES = {
    "force": _f(_f, _f, _f, _array, _array, _array),
    "gap": _f(_f, _array),
    "contact": _f(_f, _f, _f, _f, _array),
    "restitution": _f(_f, _f, _array),
    "excitation": _f(_f, _f, _f, _f, _array),
}
PYTHON_SITES = ("structure", "stop", "numerical", "sensor", "response")  # in plain Python, served by the model
SITES = (*SIGNATURES, *PYTHON_SITES)


@dataclass(frozen=True)
class Law:
    """A function that acts at a site; `states` counts the internal states of a force law."""

    site: str
    function: Callable
    module: str
    name: str
    states: int = 0

    def __reduce__(self) -> tuple[Callable[[str, str], "Law"], tuple[str, str]]:
        """Pickle by reference: a worker imports the law, and finds its machine code in the cache."""
        return _find, (self.module, self.name)


def _find(module: str, name: str) -> Law:
    return getattr(importlib.import_module(module), name)


def _site(site: str, states: int = 0) -> Callable[[Callable], Law]:
    def decorate(function: Callable) -> Law:
        compiled = function
        if site not in PYTHON_SITES:
            compiled = njit(SIGNATURES[site], cache=True, nogil=True, error_model="numpy")(function)
        return Law(site, compiled, function.__module__, function.__name__, states)

    return decorate


@overload
def force(function: Callable) -> Law: ...
@overload
def force(*, states: int) -> Callable[[Callable], Law]: ...
def force(function: Callable | None = None, *, states: int = 0) -> Law | Callable[[Callable], Law]:
    """Make a law of a scalar function (t, x, v, p, z, dz) -> force per unit mass [m/s^2]."""
    return _site("force", states)(function) if function else _site("force", states)


def gap(function: Callable) -> Law:
    """Make a law of a scalar function (place, p) -> change of the gap [m]."""
    return _site("gap")(function)


def contact(function: Callable) -> Law:
    """Make a law of a scalar function (place, clearance, rate, pressure, p) -> change of the contact pressure [Pa]."""
    return _site("contact")(function)


def restitution(function: Callable) -> Law:
    """Make a law of a scalar function (e, speed, p) -> change of the coefficient of restitution [1]."""
    return _site("restitution")(function)


def excitation(function: Callable) -> Law:
    """Make a law of a scalar function (t, phase, amplitude, x, p) -> change of the excitation [its unit]."""
    return _site("excitation")(function)


def structure(function: Callable) -> Law:
    """Make a law of a function (present: tuple, p: dict) -> new values of parameters of the simulator."""
    return _site("structure")(function)


def stop(function: Callable) -> Law:
    """Make a law of a function (simulator, p: dict) -> the simulator with another stop, which takes p too."""
    return _site("stop")(function)


def numerical(function: Callable) -> Law:
    """Make a law of a function (simulator, p: dict) -> the simulator that is run in its place."""
    return _site("numerical")(function)


def sensor(function: Callable) -> Law:
    """Make a law of a function (record, p: dict) -> record: what the instruments do to the motion."""
    return _site("sensor")(function)


def response(function: Callable) -> Law:
    """Make a law of a function (record, p: dict) -> record: what a measurement adds to a frequency response."""
    return _site("response")(function)


@dataclass(frozen=True, eq=False)
class BoundLaw:
    """A law with its numbers, as a simulator is handed it.

    Attributes
    ----------
    p : (n,) values in the order of the effect's parameters, padded with zeros to at least LAW_PARAMETERS
    bodies : the bodies it acts on; None means all that the simulator has
    """

    site: str
    function: Callable
    p: np.ndarray
    bodies: tuple[str, ...] | None = None
    states: int = 0


def at_site(laws: Sequence[BoundLaw], site: str) -> list[BoundLaw]:
    """Return the laws that act at `site`, in their order."""
    return [law for law in laws if law.site == site]
