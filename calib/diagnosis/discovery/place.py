"""Places where a missing force may act: bodies, and interfaces between two of them."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from calib.diagnosis.bench import Bench, Run, simulated
from calib.diagnosis.discovery.free_force import DISPLACEMENT, VELOCITY
from calib.modelling.effect import interfaces_of, places_of
from calib.modelling.simulator import Simulator
from calib.objective import Reference
from calib.study import Pool

AT_INTERFACE = {DISPLACEMENT: "clearance", VELOCITY: "its rate"}  # what the arguments of a force law are there


@dataclass(frozen=True)
class ForcePlace:
    """A body, or an interface, with the states that a force law sees there.

    Attributes
    ----------
    name : by which laws act on it
    factors : body -> factor of its displacement in the law's
    gap : parameter that is added to it, the clearance at rest; "" on a body
    nominal : value of that parameter where none is stated  [m]
    compliant : whether the clearance is negative in contact
    """

    name: str
    factors: Mapping[str, float]
    gap: str = ""
    nominal: float = 0.0
    compliant: bool = False

    @property
    def rows(self) -> tuple[tuple[str, str], ...]:
        """Channels of bodies from which its states follow: displacements, then velocities."""
        return tuple((body, channel) for channel in (DISPLACEMENT, VELOCITY) for body in self.factors)

    def states(self, rows: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
        """Displacement and velocity (2, n) that the law sees, of rows (k, n) at values of parameters."""
        factors = np.array(list(self.factors.values()))
        of_law = np.array([factors @ own for own in np.split(rows, 2)])
        if self.gap:
            of_law[0] += values.get(self.gap, self.nominal)
        return of_law

    @property
    def preposition(self) -> str:
        """Words before its name."""
        return "at the" if self.gap else "on"

    def in_words(self, argument: str) -> str:
        """Name of an argument of a force law here."""
        return AT_INTERFACE[argument] if self.gap else argument


def force_places(simulator: Simulator) -> list[ForcePlace]:
    """Bodies on which a force is likely to act, and interfaces whose clearance the simulator states."""
    bodies = places_of(simulator).get("body", simulator.bodies)
    nominal = {p.name: p.nominal for p in simulator.parameters}
    places = [ForcePlace(body, {body: 1.0}) for body in bodies]
    for name, own in interfaces_of(simulator).items():
        places.append(ForcePlace(name, own.factors, own.gap, nominal[own.gap], own.compliant))
    return places


def visited_regions(
    pool: Pool,
    bench: Bench,
    references: Mapping[str, Reference],
    values: Mapping[str, float],
    places: Iterable[ForcePlace],
) -> dict[str, dict[str, tuple[float, float]]]:
    """Least and largest displacement [m] and velocity [m/s] that a force law sees at each place where a body moves.

    Measured ones where the references compare them, simulated ones at these values of parameters elsewhere.
    """
    regions = {}
    for place in places:
        simulations = simulated(pool, [Run(name, values, rows=place.rows) for name in references])
        ends: list[np.ndarray] = []
        for (name, reference), view in zip(references.items(), simulations, strict=True):
            if set(place.rows) <= set(bench.rows[name]):
                bodies = [str(b) for b in reference.record.body.values]
                rows = np.array([reference.record[c].values[bodies.index(body)] for body, c in place.rows])
                ends.append(place.states(rows, values))
            elif view.usable:
                ends.append(place.states(view.rows, values))
        if ends:
            low, high = (end(np.concatenate(ends, axis=1), axis=1).tolist() for end in (np.min, np.max))
            regions[place.name] = dict(zip((DISPLACEMENT, VELOCITY), zip(low, high, strict=True), strict=True))
    return {name: region for name, region in regions.items() if all(high > low for low, high in region.values())}
