"""The map of a period: the orbits that it runs through, and how their neighbours depart from them."""

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from calib.records import OK


class Orbit(NamedTuple):
    """States that a period map runs through.

    Attributes
    ----------
    states : (n, dimension) at the ends of the periods, each in the unit of its component; fewer rows than asked for
        where `status` is not "ok"
    displacement, velocity : (body, n) of every body at the same instants  [m], [m/s]
    impacts : (k, 3) period in which it happens, counted from 0; phase in [0, 1) since that period's start [1, in
        periods]; closing speed [m/s]
    contact : share of the time spent in permanent contact  [1]
    status, reason : "ok", or "diverged", "step budget", ... and why
    """

    states: np.ndarray
    displacement: np.ndarray
    velocity: np.ndarray
    impacts: np.ndarray
    contact: float = 0.0
    status: str = OK
    reason: str = ""


class Tangent(NamedTuple):
    """Small differences carried along an orbit, made orthonormal after each period.

    All vectors are in units of the map's scale, so that displacements and velocities can be compared. With V_0 the
    vectors given, made orthonormal, and J_k the Jacobian of period k, J_k V_(k-1) = V_k R_k.

    Attributes
    ----------
    states : (n, dimension) at the ends of the periods; fewer rows than asked for where the motion fails
    vectors : (dimension, m) V_n
    growth : (n, m, m) upper triangular R_k, its diagonal not negative; a direction that a phase of contact
        reduces to zero has a zero there
    """

    states: np.ndarray
    vectors: np.ndarray
    growth: np.ndarray


class PeriodMap(Protocol):
    """The state at one phase of the excitation to the state one period on.

    To write one, let the simulator have ``period_map(values, excitation, laws, phase)``, with `phase` in [0, 1) that of
    the section [1, in periods]. It returns an object with

    1. `period` of the excitation [s]; `bodies`; `impacting`, whether there is a stop that impacts could be at.
    2. `names` of the state's components, such as "q3.displacement" and "q3.velocity", their `units`, the `scale` of
       each (dimension,), by which differences are made comparable, and the state `initial` (dimension,) to start from
       where no other is given.
    3. `orbit` goes on by whole periods. The same state gives the same bits; two calls in a row give what one gives, but
       for rounding. What diverges or spends its step budget ends with a status, never in an endless loop: chatter
       included.
    4. `tangent` carries small differences along (saltation at impacts included), or is None for a map that does not
       know its derivative; central differences of `orbit` are taken then.
    5. `near_misses` gives the local minima of the clearance [m] between the impacts of one period from `state` on:
       where one comes to zero, an impact is about to appear. Without a stop: empty.
    6. Optionally `motion`, which samples the motion within the periods: harmonics of a response are taken from it; see
       `SampledMap`.

    `calib.testing.SimulatorSuite` checks this where the simulator offers a map.
    """

    @property
    def period(self) -> float:
        """Period of the excitation  [s]."""
        ...

    @property
    def bodies(self) -> tuple[str, ...]:
        """Bodies of the simulator."""
        ...

    @property
    def impacting(self) -> bool:
        """Whether there is a stop."""
        ...

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the state's components."""
        ...

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the state's components."""
        ...

    @property
    def scale(self) -> np.ndarray:
        """Scale (dimension,) of the state's components, each in its unit."""
        ...

    @property
    def initial(self) -> np.ndarray:
        """State (dimension,) to start from, each component in its unit."""
        ...

    def orbit(self, state: np.ndarray, periods: int) -> Orbit:
        """Go on from `state` (dimension,) by whole periods."""
        ...

    def tangent(self, state: np.ndarray, vectors: np.ndarray, periods: int) -> Tangent | None:
        """Carry `vectors` (dimension, m), in units of the scale, along the orbit from `state`."""
        ...

    def near_misses(self, state: np.ndarray) -> np.ndarray:
        """Local minima (k,) of the clearance over one period  [m]."""
        ...


@runtime_checkable
class SampledMap(PeriodMap, Protocol):
    """A period map that tells the motion between its sections, too."""

    def motion(self, state: np.ndarray, periods: int, samples: int) -> np.ndarray:
        """Displacement (body, periods * samples) of every body from `state` on  [m].

        `samples` instants a period, equally spaced, the first that of `state`. Fewer are returned where the motion
        fails.
        """
        ...
