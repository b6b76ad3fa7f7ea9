"""References, terms and scores: what is compared, and the result."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, Protocol, get_args

import numpy as np
import xarray as xr

from calib.errors import CalibError, nearest
from calib.modelling.simulator import Request
from calib.records import OK, STATE, check, is_response, mean_interval
from calib.records.compared_response import in_standard_uncertainties
from calib.records.excitation import Excitation

Use = Literal["calibrate", "name", "holdout"]
USES = get_args(Use)
INITIAL_STATE = "initial_state"
OF_RECORD = Excitation("", "free decay")  # stands for the excitation that the record itself states
NUISANCES = ("trigger", "offset", "scale", "shear", INITIAL_STATE)


class Feature(Protocol):
    """The contract of a feature.

    To write one:

    1. `name`; `unit` of its numbers; `channels` that a record must have for it, empty where it takes what there is.
    2. Called with a record and names of bodies (None: all) it returns a DataArray with dims ("body", "channel", ...),
       or ("body", ...), of one shape for the reference and every simulation. A simulated record comes on the
       reference's time base, its nuisances applied. NaN says that there is nothing to measure ("no impact").
    3. `scale` says what difference scores 1: a number, or a DataArray that broadcasts against the values.
    4. Optionally `uncertainty(record, bodies)`: standard uncertainty of the values, or None; `wraps`: the values are
       angles of which one turn is this much; `aligned = False`: it wants the simulated record as it was simulated;
       `values(record, bodies)`: the same numbers as a bare array (body, channel, ...), where labels cost more;
       `trust(record)`: factors (channel, ...) in [0, 1] on the differences of sampled values, made of the simulated
       record's variable `trust` (time), which is 0 where velocity jumps between two samples, or (point), which is less
       than 1 where a measured point of a frequency response is in doubt;
       `prepared(reference, bodies)`: the same feature with all that the reference alone decides, such as a grid of its
       amplitudes: a feature that is called with this reference and every simulation of it.
    5. It pickles, and does not change its record.
    """

    name: str
    unit: str
    channels: Sequence[str]

    def __call__(self, record: xr.Dataset, bodies: Sequence[str] | None = None) -> xr.DataArray:
        """Return the numbers (body, channel, ...)."""
        ...

    def scale(self, reference: xr.DataArray) -> xr.DataArray | float:
        """Return the difference that scores 1."""
        ...


@dataclass(frozen=True, eq=False)
class Reference:
    """A measured record with its use, nuisances, excitation and request.

    Attributes
    ----------
    name : of the record
    record : its bodies named as the simulator's
    use : "calibrate" (scored), "name" (used in diagnosis only) or "holdout" (used to measure gain only)
    nuisance : of this measurement, not of the model: "trigger" (the instant of its start; one per record, common to all
        bodies and channels), "offset" (of each body's displacement), "scale" (of each channel), "shear" (of the plotted
        phase curve, x + k y) are solved in closed form; "initial_state" (the simulator's parameters `initial`) by
        Gauss-Newton steps, where the record begins with the motion
    excitation : by default the one that the record states in its attributes
    request : what to compute for the comparison; its interval, where it states none, is that of the record
    """

    name: str
    record: xr.Dataset
    use: Use = "calibrate"
    nuisance: Sequence[str] = ()
    excitation: Excitation = OF_RECORD
    request: Request = field(default_factory=Request)

    def __post_init__(self) -> None:
        object.__setattr__(self, "record", check(self.record, self.name))
        if self.use not in USES:
            raise CalibError(f"{self.name}: use is one of {', '.join(USES)}, got {self.use!r}{nearest(self.use, USES)}")
        if self.excitation is OF_RECORD:
            object.__setattr__(self, "excitation", Excitation.of(self.record))
        if self.request.interval is None and not is_response(self.record):
            object.__setattr__(self, "request", replace(self.request, interval=mean_interval(self.record)))
        object.__setattr__(self, "nuisance", tuple(self.nuisance))
        for nuisance in self.nuisance:
            self._check_nuisance(nuisance)

    @property
    def frees_initial_state(self) -> bool:
        """Whether the initial state is one of the nuisances."""
        return INITIAL_STATE in self.nuisance

    @property
    def is_swept(self) -> bool:
        """Whether it is a frequency response, and none over time."""
        return is_response(self.record)

    @property
    def period(self) -> float | None:
        """Period of the excitation [s]; None where it has none, or another at each point of a frequency response."""
        return None if self.is_swept else self.excitation.period

    @property
    def abscissa(self) -> np.ndarray:
        """Instants of the samples (n,) [s]; of a frequency response the numbers of its points."""
        return np.arange(self.record.sizes["point"], dtype=float) if self.is_swept else self.record.time.values

    @cached_property
    def compared(self) -> xr.Dataset:
        """The record as it is compared sample by sample: of a response the parts in their standard uncertainties."""
        return in_standard_uncertainties(self.record) if self.is_swept else self.record

    def _check_nuisance(self, nuisance: str) -> None:
        if nuisance not in NUISANCES:
            hint = nearest(nuisance, NUISANCES)
            raise CalibError(f"{self.name}: unknown nuisance {nuisance!r}{hint}; known are {NUISANCES}")
        if is_response(self.record):
            raise CalibError(
                f"{self.name}: a frequency response has no nuisances, got {nuisance!r}; drop it, or leave a factor on "
                "the excitation free as a parameter"
            )
        if nuisance == INITIAL_STATE and self.excitation.harmonic:
            raise CalibError(
                f"{self.name}: the nuisance {INITIAL_STATE!r} belongs to a record that begins with the motion, a free "
                "decay or one with a recorded input; this one is a steady state under a harmonic excitation, which "
                "does not depend on its start: drop this nuisance"
            )
        if nuisance == "trigger" and not self.excitation.periodic:
            raise CalibError(
                f"{self.name}: the trigger can be solved for only where the excitation has a period; "
                "state its frequency, or drop this nuisance"
            )
        needed = {"offset": ("displacement",), "shear": STATE}.get(nuisance, ())
        for channel in needed:
            if channel not in self.record:
                raise CalibError(
                    f"{self.name}: the nuisance {nuisance!r} needs {channel}, which is missing in the record"
                )


@dataclass(frozen=True, eq=False)
class Term:
    """One feature to compare, of some bodies in some records.

    Attributes
    ----------
    feature : see `Feature`
    bodies : None compares all of the reference
    records : None compares all
    weight : of the squared distance, against that of the other terms
    label : what the term is called in scores; made from the others where it is empty
    """

    feature: Feature
    bodies: Sequence[str] | None = None
    records: Sequence[str] | None = None
    weight: float = 1.0
    label: str = ""

    def __post_init__(self) -> None:
        for name in ("bodies", "records"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, (value,) if isinstance(value, str) else tuple(value))
        if not (np.isfinite(self.weight) and self.weight > 0.0):
            raise CalibError(f"{self.feature.name}: expected a weight above 0, got {self.weight}; or drop the term")
        if not self.label:
            of = f" of {', '.join(self.bodies)}" if self.bodies else ""
            at = f" in {', '.join(self.records)}" if self.records else ""
            object.__setattr__(self, "label", f"{self.feature.name}{of}{at}")


@dataclass(frozen=True, eq=False)
class Score:
    """Distance of the simulated records from the measured ones.

    Attributes
    ----------
    cost : what a search minimises. With D the root of the weighted mean of the squared distances of the terms: D
        itself up to 5, beyond that a value that rises with it towards 9; of a wrong kind of motion 10 to 21, falling as
        the motion comes nearer to the right kind; infinite where a run failed
    terms : distance of each term by label
    status, reason : "ok", or of the first failed record
    kind : kind of the simulated motion, one for all records or "record: kind; ..."
    evidence : on which the kind was decided
    residuals : (n,) float64 with sum of squares D^2; None where a run failed
    nuisances : record -> name -> value in SI
    wrong : records whose motion is of another kind than the reference's
    """

    cost: float
    terms: dict[str, float]
    status: str = OK
    reason: str = ""
    kind: str = ""
    evidence: str = ""
    residuals: np.ndarray | None = field(default=None, repr=False)
    nuisances: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    wrong: tuple[str, ...] = ()
