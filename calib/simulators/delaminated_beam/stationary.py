"""A motion taken period by period until it returns, then recorded."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from calib.errors import CalibError
from calib.records import MIN_SECTION_PERIODS, OK
from calib.simulators.delaminated_beam.impacts import (
    CENTRAL_IMPACTS,
    CONTACT_TIME,
    IMPACTS,
    MAX_FORCE,
    MAX_PENETRATION,
    ContactTrace,
)

MAX_RETURN_PERIODS = 16  # after which a state can return
MAX_IMPACTS = 2**20  # of a record: those of 10 000 periods at least, as a hundredth of a period separates two
STATE_RETURN_TOLERANCE = 1e-6  # of a change of the state over its largest displacement or velocity  [1]
MIN_SCALE = 1e-300  # m or m/s, of a state at rest


class Period(NamedTuple):
    """What one period of a motion gives.

    Attributes
    ----------
    status, reason : "ok", or why the motion ended
    samples : (samples, 4) displacement of beam and layer in the middle [m], their velocities [m/s]
    force : (samples,) contact force on the layer, mean since the sample before  [N]
    """

    status: str
    reason: str
    samples: np.ndarray
    force: np.ndarray


@dataclass(frozen=True, eq=False)
class Contact:
    """Contact over the recorded periods.

    Attributes
    ----------
    impacts, central : (k, 2) instants since their start [s] and closing speeds [m/s] at which contact begins, anywhere
        on the layer and in its middle
    closed : (m,) share of the time for which each node of the layer was in contact  [1]
    fraction : share of the time with contact anywhere  [1]
    force, penetration : largest  [N], [m]
    """

    impacts: np.ndarray
    central: np.ndarray
    closed: np.ndarray
    fraction: float
    force: float
    penetration: float

    @classmethod
    def of(cls, trace: ContactTrace, since: float, span: float, unit: float = 1.0) -> "Contact":
        """Read what a kernel recorded.

        Parameters
        ----------
        since, span : begin and length of the record, in the kernel's unit of time
        unit : of its times  [s]

        Raises
        ------
        CalibError : there were more impacts than are recorded
        """
        if max(trace.total[IMPACTS] - len(trace.impacts), trace.total[CENTRAL_IMPACTS] - len(trace.central)) > 0:
            raise CalibError(
                f"the record has {int(trace.total[IMPACTS])} impacts, of which only {len(trace.impacts)} are kept; "
                "record fewer periods"
            )
        impacts, central = (
            np.column_stack([(rows[: int(number), 0] - since) * unit, rows[: int(number), 1]])
            for rows, number in ((trace.impacts, trace.total[IMPACTS]), (trace.central, trace.total[CENTRAL_IMPACTS]))
        )
        return cls(
            impacts=impacts,
            central=central,
            closed=trace.closed / span,
            fraction=float(trace.total[CONTACT_TIME] / span),
            force=float(trace.total[MAX_FORCE]),
            penetration=float(trace.total[MAX_PENETRATION]),
        )


class Engine(Protocol):
    """A kernel with its state, as `stationary` needs it."""

    def period(self, samples: int) -> Period:
        """Go on by one period."""
        ...

    def state(self) -> np.ndarray:
        """State at the end of the last period, in units in which its largest displacement and velocity are 1."""
        ...

    def contact_recorded(self, periods: int) -> Contact:
        """Contact in the last periods, since `begin_record`."""
        ...

    def begin_record(self) -> None:
        """Begin the record of contact anew."""
        ...


@dataclass(frozen=True)
class FailedMotion:
    """A motion that ended before it was recorded.

    Attributes
    ----------
    status, reason : see `Period`
    settled : periods before it ended, at most those that settle
    """

    status: str
    reason: str
    settled: int


@dataclass(frozen=True, eq=False)
class StationaryMotion:
    """A recorded motion.

    Attributes
    ----------
    samples : (periods * samples, 4), see `Period`
    force : (periods * samples,)  [N]
    sections : (MIN_SECTION_PERIODS or more, 4) the samples at phase zero of the last periods
    settled : periods before the recorded ones
    returns : after how many periods the state returns; None where it did not
    contact : over the recorded periods
    """

    samples: np.ndarray
    force: np.ndarray
    sections: np.ndarray
    settled: int
    returns: int | None
    contact: Contact


def normalised(displacement: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """State (2 n,) of displacements and velocities (n,), each over the largest."""
    return np.concatenate([x / max(abs(x).max(), MIN_SCALE) for x in (displacement, velocity)])


def return_period(states: list[np.ndarray]) -> int | None:
    """Periods after which the last of the states returned, at most MAX_RETURN_PERIODS; None if it did not."""
    for lag in range(1, min(MAX_RETURN_PERIODS, len(states) - 1) + 1):
        if np.abs(states[-1] - states[-1 - lag]).max() < STATE_RETURN_TOLERANCE:
            return lag
    return None


def stationary(
    engine: Engine, periods: int, samples: int, settle: int | None, limit: int
) -> StationaryMotion | FailedMotion:
    """Let a motion settle, then record it.

    Parameters
    ----------
    periods, samples : to record, and samples a period
    settle : periods to drop; None: until the full state returns after 1 to 16 periods, at most `limit`

    Notes
    -----
    Where the state has returned, the sections of further periods are those of the periods before: they are not
    simulated.
    """
    dropped: list[np.ndarray] = []
    states, returns = [engine.state()], None
    while len(dropped) < (limit if settle is None else settle):
        period = engine.period(1)
        if period.status != OK:
            return FailedMotion(period.status, period.reason, len(dropped))
        dropped.append(period.samples[:1])
        states = [*states[-MAX_RETURN_PERIODS:], engine.state()]
        returns = return_period(states)
        if settle is None and returns is not None:
            break
    engine.begin_record()
    recorded, force = [], []
    for _ in range(periods):
        period = engine.period(samples)
        if period.status != OK:
            return FailedMotion(period.status, period.reason, len(dropped))
        recorded.append(period.samples)
        force.append(period.force)
        states = [*states[-MAX_RETURN_PERIODS:], engine.state()]
        returns = return_period(states)
    contact = engine.contact_recorded(periods)
    sections = np.concatenate([*dropped, *(rows[:1] for rows in recorded)])
    while returns is None and len(sections) < MIN_SECTION_PERIODS:
        period = engine.period(1)
        if period.status != OK:
            return FailedMotion(period.status, period.reason, len(dropped))
        sections = np.concatenate([sections, period.samples[:1]])
        states = [*states[-MAX_RETURN_PERIODS:], engine.state()]
        returns = return_period(states)
    if returns is not None and periods < MIN_SECTION_PERIODS:
        sections = np.resize(sections[-returns:], (MIN_SECTION_PERIODS, 4))  # what was before is on the way there
    return StationaryMotion(
        samples=np.concatenate(recorded),
        force=np.concatenate(force),
        sections=sections[-max(MIN_SECTION_PERIODS, periods) :],
        settled=len(dropped),
        returns=returns,
        contact=contact,
    )
