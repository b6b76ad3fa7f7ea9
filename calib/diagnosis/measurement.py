"""A possible measurement: its settings, and which models it would distinguish."""

import math
from dataclasses import dataclass

from calib.diagnosis.laboratory import (
    FREE_DECAY,
    RECORDED_INPUT,
    REPEATED_RECORD,
    STEADY_TONE,
    STEPPED_SINE,
    SWEEP,
    DesignPoint,
)
from calib.units import shown

DECISIVE_Z = 3.0  # separation from which two models are distinguishable  [standard deviations]; three-sigma rule
MAX_REFIT_RATIO = 2.0  # of the separation simulated at the refitted parameters over the linearised one  [1]
MIN_CHANNEL_GAIN = 1.2  # ratio of separations from which an additional channel is proposed  [1]
OK, IRREGULAR, FAILED = "ok", "irregular", "failed"
GRID, REFINEMENT = "grid", "refinement"


@dataclass(frozen=True)
class EvaluatedPoint:
    """A design point with its predicted separation.

    Attributes
    ----------
    point : its settings
    stage : "grid" or "refinement"
    status : "ok", "irregular" (the motion of a model is) or "failed" (the simulation of a model did)
    reason : of a status that is not "ok"
    impacts : whether any model has impacts there; None where the simulator does not report them
    z : separation of the two least distinguishable models; NaN unless "ok"  [standard deviations]
    z_max : the same of the two most distinguishable
    """

    point: DesignPoint
    stage: str
    status: str
    reason: str = ""
    impacts: bool | None = None
    z: float = math.nan
    z_max: float = math.nan


@dataclass(frozen=True)
class Measurement:
    """The best measurement of a kind of test, with the record's channels or with an additional one.

    Attributes
    ----------
    kind : of test of which it is the best; a steady tone may be the best `WITHOUT_CONTACT` too
    description : in words
    record : on which it is based
    point : its settings
    channel : "body.channel" that is measured in addition to those of the record; "" for none
    impacts : whether it has any; None where the simulator does not report them
    distinguished : number of pairs of models whose separation is decisive, linearised and in simulations
    pairs : number of pairs of models
    unchecked : number of pairs of a decisive linearised separation for which the budget left no simulations
    z : separation of the two least distinguishable models; not more than `z_refit`  [standard deviations]
    z_max : the same of the two most distinguishable, of those whose decisive separation no simulation contradicts
    z_refit : of the two least distinguishable, simulated at the parameters to which the linearised refit moves them;
        None where that cannot be simulated
    """

    kind: str
    description: str
    record: str
    point: DesignPoint
    channel: str
    impacts: bool | None
    distinguished: int
    pairs: int
    unchecked: int
    z: float
    z_max: float
    z_refit: float | None

    @property
    def confirmed(self) -> bool:
        """Whether simulations at the refitted parameters agree with the linearised refit."""
        return agrees(self.z, self.z_refit)

    @property
    def prediction(self) -> str:
        """Which models it would distinguish, as the end of a sentence."""
        if self.distinguished == self.pairs:
            return f"would distinguish them (z = {self.z:.3g})"
        if self.distinguished:
            return f"would distinguish some of them (z = {self.z:.2g} to {self.z_max:.3g})"
        if self.unchecked:
            how = "by derivatives; the budget left no simulations to confirm it"
            return f"may distinguish them (z = {self.z_max:.3g} {how})"
        if self.z_max >= DECISIVE_Z:
            return f"may distinguish them (z = {self.z_max:.3g} by derivatives, which simulations do not confirm)"
        return f"would not distinguish them (z = {self.z_max:.2g})"


def agrees(z: float, refit: float | None) -> bool:
    """Whether the separation simulated at the refitted parameters is near the linearised one."""
    return refit is not None and refit <= MAX_REFIT_RATIO * max(z, 1.0)


def rank(measurement: Measurement) -> tuple[int, bool, bool, float, float]:
    """Key for sorting: pairs distinguished; then confirmed; without an additional channel; the separation."""
    m = measurement
    return m.distinguished, m.confirmed, not m.channel, m.z, m.z_max


def separates_further(more: Measurement, bare: Measurement) -> bool:
    """Whether a measurement with an additional channel distinguishes more models, or separates them further."""
    return more.distinguished > bare.distinguished or more.z >= MIN_CHANNEL_GAIN * bare.z


def described(outcome: EvaluatedPoint, record: str, unit: str, channel: str) -> str:
    """Describe a measurement in words.

    Parameters
    ----------
    unit : of the amplitude
    channel : that is measured in addition to those of the record; "" for none
    """
    point = outcome.point
    contact = {True: ", with impacts", False: ", without impacts", None: ""}[outcome.impacts]
    what = {
        STEADY_TONE: lambda: f"a steady tone of {shown(point.amplitude, unit, 3)} at {point.frequency:.4g} Hz",
        SWEEP: lambda: (
            f"a sweep of {shown(point.amplitude, unit, 3)} from {point.frequency:.3g} to {point.end_frequency:.3g} Hz"
        ),
        STEPPED_SINE: lambda: (
            f"a stepped sine of {shown(point.amplitude, unit, 3)} from {point.frequency:.3g} to "
            f"{point.end_frequency:.3g} Hz"
        ),
        RECORDED_INPUT: lambda: f"the input of {record}, scaled to {shown(point.amplitude, unit, 3)}",
        FREE_DECAY: lambda: f"a free decay, released from {shown(point.release, 'm', 3)}",
        REPEATED_RECORD: lambda: f"{record} once more",
    }[point.test]()
    return f"{what}{contact}{f', with the {channel} measured too' if channel else ''}"
