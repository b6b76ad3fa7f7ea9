"""Places where a missing force may act: bodies, and interfaces between two of them."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib.diagnosis.bench import Bench, Run, SimulatedRows, simulated
from calib.diagnosis.discovery.free_force import DISPLACEMENT, VELOCITY
from calib.modelling.effect import interfaces_of, places_of
from calib.modelling.simulator import Simulator
from calib.objective import Reference
from calib.records.held_response import as_measured
from calib.records.response import complex_amplitude, has_phase, states_of_motions
from calib.study import Pool

MAX_HALF_WAVE_ASYMMETRY = 1e-4  # of states half a period apart: of their sum, over their size  [1]
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


@dataclass(frozen=True)
class VisitedRegion:
    """What a force law sees at a place in the records.

    Attributes
    ----------
    ends : argument -> its least and largest value  [m], [m/s]
    half_wave_symmetric : whether all records are frequency responses, of motions that half a period later are opposite:
        an even function of the state then changes no first harmonic, to first order
    """

    ends: Mapping[str, tuple[float, float]]
    half_wave_symmetric: bool = False


def visited_regions(
    pool: Pool,
    bench: Bench,
    references: Mapping[str, Reference],
    values: Mapping[str, float],
    places: Iterable[ForcePlace],
) -> dict[str, VisitedRegion]:
    """Least and largest displacement [m] and velocity [m/s] that a force law sees at each place where a body moves.

    Measured ones where the references compare them, simulated ones at these values of parameters elsewhere. Those of a
    measured frequency response are those of its first harmonic.
    """
    regions = {}
    for place in places:
        simulations = simulated(pool, [Run(name, values, rows=place.rows) for name in references])
        ends: list[np.ndarray] = []
        for (name, reference), view in zip(references.items(), simulations, strict=True):
            rows = _measured_rows(place, reference, bench.rows[name])
            if rows is None and view.usable:
                rows = view.rows
            if rows is not None:
                ends.append(place.states(rows, values))
        if ends:
            low, high = (end(np.concatenate(ends, axis=1), axis=1).tolist() for end in (np.min, np.max))
            pairs = dict(zip((DISPLACEMENT, VELOCITY), zip(low, high, strict=True), strict=True))
            swept = all(reference.is_swept for reference in references.values())
            symmetric = swept and all(_is_half_wave_symmetric(place, view, values) for view in simulations)
            regions[place.name] = VisitedRegion(pairs, symmetric)
    return {name: region for name, region in regions.items() if all(high > low for low, high in region.ends.values())}


def _measured_rows(place: ForcePlace, reference: Reference, compared: Sequence[tuple[str, str]]) -> np.ndarray | None:
    """Displacements and velocities (k, n) of the bodies of a place; None where they were not measured."""
    record = reference.record
    bodies = [str(body) for body in record.body.values]
    if reference.is_swept:
        known = has_phase(record) or len(place.factors) == 1
        if not known or not set(place.factors) <= {body for body, _ in compared}:
            return None
        own = complex_amplitude(as_measured(record))[[bodies.index(body) for body in place.factors]]
        motions = np.stack([np.zeros_like(own), own], axis=1)
        return np.concatenate(states_of_motions(record["frequency"].values, motions))
    if not set(place.rows) <= set(compared):
        return None
    return np.array([record[channel].values[bodies.index(body)] for body, channel in place.rows])


def _is_half_wave_symmetric(place: ForcePlace, view: SimulatedRows, values: Mapping[str, float]) -> bool:
    """Whether the states of simulated motions are opposite half a period later; not of a simulation that failed."""
    if not view.usable:
        return False
    one, other = np.split(place.states(view.rows, values), 2, axis=1)
    return bool((np.abs(one + other).max(axis=1) <= MAX_HALF_WAVE_ASYMMETRY * np.abs(one).max(axis=1)).all())
