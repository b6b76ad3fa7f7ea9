"""The result of a search for a force law: the objects of discovery.json, their fields in the order of its keys."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from calib.diagnosis.document import GateResult
from calib.store.plain import plain, typed
from calib.units import plain_number

MAX_NARROW_BAND = 1.25  # highest over lowest frequency, in which a velocity is told from a displacement by little  [1]
OF_HISTORY = "history_dependent"  # verdict that a law with internal states predicts better than functions of the state


@dataclass(frozen=True)
class FunctionResult:
    """A function of the force, per unit mass of the body, over the region that the records visit.

    Attributes
    ----------
    arguments : "displacement" or "velocity", or both
    units : of each
    region : least and largest value of each that is visited; outside the function is continued linearly
    points : values of each argument at which the function is stated
    force, error : there, and the standard error  [m/s^2]; of two arguments, all values of the second for the first
        value of the first, and so on. Where a formula predicts as well, that formula and what the records add to it
    visited : whether the records visit the neighbourhood of each of these points
    formula : values of the formula there, less what calibration absorbs of it  [m/s^2]; empty without one
    """

    arguments: tuple[str, ...]
    units: tuple[str, ...]
    region: tuple[tuple[float, float], ...]
    points: tuple[tuple[float, ...], ...]
    force: tuple[float, ...]
    error: tuple[float, ...]
    visited: tuple[bool, ...]
    formula: tuple[float, ...] = ()


@dataclass(frozen=True)
class NumberResult:
    """A number of a formula.

    Attributes
    ----------
    name : in its text
    value, error : and standard error, in SI
    unit : of both
    meaning : in words
    """

    name: str
    value: float
    error: float | None
    unit: str
    meaning: str


def _listed(numbers: Sequence[NumberResult]) -> str:
    return ", ".join(f"{n.name} = {plain_number(n.value)} {n.unit}" for n in numbers)


@dataclass(frozen=True)
class FormulaResult:
    """A formula of the force, refitted inside the simulator.

    Attributes
    ----------
    text, latex : force per unit mass over displacement x and velocity v, with names for its numbers
    numbers : that are fitted
    chi2, left_out_deviance : as those of a `TrialResult`
    ric : risk inflation criterion, but for a constant that all formulas have in common  [1]
    ties : whether it is within a tie of the best by that
    on_front : whether no formula of as many numbers or fewer has a lower chi-square
    predicts : whether it fits all records and predicts left-out ones as well as the free function
    explains : whether the misfit that it leaves is none beside the noise
    """

    text: str
    latex: str
    numbers: tuple[NumberResult, ...]
    chi2: float
    left_out_deviance: float | None
    ric: float
    ties: bool
    on_front: bool
    predicts: bool
    explains: bool

    @property
    def equation(self) -> str:
        """Text with its numbers behind it."""
        return f"{self.text}; {_listed(self.numbers)}"


@dataclass(frozen=True)
class HistoryResult:
    """A law with internal states that was refitted in the place of the free force.

    Attributes
    ----------
    effect, equation : its name in the library, and the force per unit mass
    numbers : its parameters, and the form of its law
    chi2, left_out_deviance : as those of a `TrialResult`
    """

    effect: str
    equation: str
    numbers: tuple[NumberResult, ...]
    chi2: float
    left_out_deviance: float | None

    @property
    def text(self) -> str:
        """Its name and equation with the numbers behind them."""
        return f"{self.effect}: {self.equation}; {_listed(self.numbers)}"


@dataclass(frozen=True)
class DescribingFunctionResult:
    """Describing function of a force: of it the first harmonic under a harmonic motion, over the amplitude of that.

    All that the first harmonic of a response sees of a force law, to first order: equivalent stiffness and damping.

    Attributes
    ----------
    frequency : of the motion  [Hz]
    band : lowest and highest frequency at which responses were measured  [Hz]
    amplitudes : of the displacement  [m]
    stiffness, stiffness_error : equivalent ones per unit mass, without what calibration absorbs, and standard errors
        [1/s^2]; 0 of a function of velocity alone
    damping, damping_error : likewise, 0 of a function of displacement alone  [1/s]
    """

    frequency: float
    band: tuple[float, float]
    amplitudes: tuple[float, ...]
    stiffness: tuple[float, ...]
    stiffness_error: tuple[float, ...]
    damping: tuple[float, ...]
    damping_error: tuple[float, ...]

    @property
    def limits(self) -> str:
        """What cannot be told from it, in a few sentences."""
        text = (
            "A frequency response is the first harmonic of the motion: of a force it tells the describing function, "
            "the equivalent stiffness and damping over the amplitude. Laws that share it are indistinguishable"
        )
        low, high = self.band
        if high > MAX_NARROW_BAND * low:
            return f"{text}: of even functions of the state it is nil"
        return (
            f"{text}: of even functions of the state it is nil, and between {low:.4g} and {high:.4g} Hz the same loss "
            "is made by a function of velocity, by one that displacement multiplies, such as |x| v beside |v| v, and "
            "by hysteresis"
        )


@dataclass(frozen=True)
class TrialResult:
    """A model with free forces that was fitted.

    Attributes
    ----------
    body : on which they act, or name of the interface
    functions : in words
    chi2, left_out_deviance : chi-square of all records; predictive deviance of each while it was left out (see
        `calib.diagnosis.discovery.left_out`), None where none can be
    effective_parameters : effective number of coefficients  [1]
    """

    body: str
    functions: str
    chi2: float
    left_out_deviance: float | None
    effective_parameters: float


@dataclass(frozen=True)
class DiscoveryResult:
    """What a search for a force law found; numbers in SI.

    Attributes
    ----------
    verdict : "found", "history_dependent" (a law with internal states predicts better than any function of the state),
        "nothing", "undetermined" (the records cannot tell, or the budget ended the search) or "not_diagnosable"
    summary : the verdict in a sentence
    body : on which the force acts, or name of the interface; "" where none was found
    arguments : on which it depends
    functions : whose sum it is
    rms : root mean square of the force over the visited states, and of its standard error  [m/s^2]
    explained : share of the excess chi-square of the calibrated model  [1]
    left_out : names of the records, or blocks of time, that were left out in turn
    left_out_deviance : predictive deviance of these without the force and with it
    undetermined : linear functions that calibrated parameters absorb: the force is stated without them
    rivals : bodies or interfaces at which a force predicts as well
    trials : models that were fitted
    formulas : of the force, the best first: of those within a tie of AIC the one with the fewest numbers
    gates : conditions of the search
    parameters : calibrated values beside the force
    values : calibrated values from which the search began
    simulations, seconds : cost; wall-clock time  [s]
    cut_short : whether the budget ended the search before all was tried
    curves : place by place where all records visit one curve of states, what coincides there and which record tells
        it apart, in words
    interface : whether it acts between two bodies, as a function of their clearance, which takes the place of the
        displacement, and of its rate
    histories : laws with internal states in the place of the force, the one that predicts best first
    describing_function : of a force on a body, where records are frequency responses
    """

    verdict: str
    summary: str = ""
    body: str = ""
    arguments: tuple[str, ...] = ()
    functions: tuple[FunctionResult, ...] = ()
    rms: tuple[float, ...] = ()
    explained: float | None = None
    left_out: tuple[str, ...] = ()
    left_out_deviance: tuple[float, ...] = ()
    undetermined: tuple[str, ...] = ()
    rivals: tuple[str, ...] = ()
    trials: tuple[TrialResult, ...] = ()
    formulas: tuple[FormulaResult, ...] = ()
    gates: tuple[GateResult, ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)
    values: Mapping[str, float] = field(default_factory=dict)
    simulations: int = 0
    seconds: float = 0.0
    interface: bool = False
    cut_short: bool = False
    curves: tuple[str, ...] = ()
    histories: tuple[HistoryResult, ...] = ()
    describing_function: DescribingFunctionResult | None = None

    @property
    def depends_on_history(self) -> bool:
        """Whether a law with internal states predicts better than any function of the state."""
        return self.verdict == OF_HISTORY

    @property
    def formula(self) -> FormulaResult | None:
        """Formula of the force: the first, where it predicts as well as the free function; None if history counts."""
        if self.depends_on_history:
            return None
        return next((f for f in self.formulas[:1] if f.predicts), None)

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> "DiscoveryResult":
        """Return the result that the object of discovery.json describes.

        Raises
        ------
        ValueError : the object is no such result
        """
        return typed(cls, document)

    def as_dict(self) -> dict[str, Any]:
        """Return the object of discovery.json, which `json.dumps(..., allow_nan=False)` takes."""
        return dict(plain(self))
