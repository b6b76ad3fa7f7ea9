"""What dynamics need of a simulator: the map of a period."""

from typing import Protocol

import numpy as np

from calib.modelling.orbit import Orbit, Tangent


class PeriodMap(Protocol):
    """The state at one phase of the excitation to the state one period on.

    To write one, let the simulator have ``period_map(values, excitation, laws, phase)``, with `phase` in [0, 1) the
    place in the period at which the section is taken [1, in periods]. It returns a thing with

    1. `period` of the excitation [s]; `bodies`; `impacting`, whether there is a stop that impacts could be at.
    2. `names` of the state's components, such as "q3.displacement" and "q3.velocity", their `units`, the `scale` of
       each (dimension,), by which differences are made comparable, and the state `initial` (dimension,) to start from
       where nothing else is said.
    3. `orbit` goes on by whole periods. The same state gives the same bits; two calls in a row give what one gives, but
       for rounding. What diverges or spends its step budget ends with a status, never in an endless loop: chatter
       included.
    4. `tangent` carries small differences along (saltation at impacts included), or is None for a map that does not
       know its derivative; central differences of `orbit` are taken then.
    5. `misses` gives the local minima of the clearance [m] between the impacts of one period from `state` on: where one
       comes to zero, an impact is about to appear. Without a stop: empty.

    `calib.testing.SimulatorSuite` checks this where the simulator offers a map.
    """

    period: float
    bodies: tuple[str, ...]
    impacting: bool
    names: tuple[str, ...]
    units: tuple[str, ...]
    scale: np.ndarray
    initial: np.ndarray

    def orbit(self, state: np.ndarray, periods: int) -> Orbit:
        """Go on from `state` (dimension,) by whole periods."""
        ...

    def tangent(self, state: np.ndarray, vectors: np.ndarray, periods: int) -> Tangent | None:
        """Carry `vectors` (dimension, m), in units of the scale, along the orbit from `state`."""
        ...

    def misses(self, state: np.ndarray) -> np.ndarray:
        """Local minima (k,) of the clearance over one period  [m]."""
        ...
