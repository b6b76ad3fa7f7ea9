"""A study that costs nothing: two masses that follow a formula, compared with a curve, searched at random."""

import os
import time
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from calib.errors import CalibError
from calib.execution.pool import InProcess
from calib.modelling.model import Model
from calib.modelling.parameter import Parameter, Space, Window
from calib.modelling.simulator import Request
from calib.records import record
from calib.records.excitation import Excitation
from calib.store import Store
from calib.study import CalibrationStudy, evaluate

TIME = np.linspace(0.0, 1.0, 41)


@dataclass(frozen=True)
class Formula:
    """Displacement x sin(2 pi t + y) of one body; what else it does depends on the values."""

    seconds: float = 0.0
    trouble: str = ""
    name: str = "formula"
    bodies: tuple = ("mass",)
    parameters: tuple = (Parameter("x", "m", 1.0, "amplitude"), Parameter("y", "rad", 0.0, "phase"))
    sites: frozenset = frozenset()

    def run(self, values, excitation, laws, request):
        time.sleep(self.seconds)
        x, y = values["x"], values["y"]
        if self.trouble == "refuse":
            raise CalibError("the formula cannot take this excitation")
        if x > 1.5 and self.trouble:
            if self.trouble == "hang":
                time.sleep(100)
            if self.trouble == "crash":
                os._exit(3)
            if self.trouble == "raise":
                raise ZeroDivisionError("float division by zero")
            return record.failed(self.bodies, "diverged", "x is above 1.5")
        motion = x * np.sin(2 * np.pi * TIME + y)
        return record.make(TIME, self.bodies, {"displacement": motion[None, :]})


@dataclass
class Reference:
    """A measured curve with the excitation it was taken under."""

    excitation: Excitation = field(default_factory=lambda: Excitation("mass", "force", frequency=1.0, amplitude=1.0))
    request: Request = field(default_factory=Request)
    use: str = "calibrate"
    frees_initial_state: bool = False
    is_swept: bool = False


@dataclass
class Score:
    """What the objective says."""

    cost: float
    terms: dict
    status: str = "ok"
    reason: str = ""
    kind: str | None = "period-1"
    residuals: np.ndarray | None = None


@dataclass
class FeatureValue:
    """A scalar feature."""

    label: str
    record: str
    body: str
    unit: str
    measured: float
    simulated: float
    tolerance: float


class Distance:
    """Root mean square distance from a curve, in all records."""

    def __init__(self, names=("decay",), measured=0.7):
        self.references = {name: Reference() for name in names}
        self.scored = list(names)
        self.measured = measured

    def __call__(self, records):
        for name, one in records.items():
            if one.attrs["status"] != "ok":
                return Score(np.inf, {}, one.attrs["status"], f"{name}: {one.attrs['reason']}", None)
        target = 0.7 * np.sin(2 * np.pi * TIME + 0.3)
        residuals = np.concatenate([one.displacement.values[0] - target for one in records.values()])
        cost = float(np.sqrt(np.mean(residuals**2)))
        return Score(cost, {"distance": cost}, residuals=residuals)

    def judged(self, records):
        score = self(records)
        return score, [
            FeatureValue("amplitude", name, "mass", "m", self.measured, float(one.displacement.max()), 0.01)
            for name, one in records.items()
            if score.status == "ok"
        ]


class Wanderer:
    """Random steps from the best point, whose direction hangs on every residual told so far."""

    def __init__(self, dim, seed, budget, batch=1):
        self.dim, self.batch, self.budget = dim, batch, budget
        self.rng = np.random.default_rng(seed)
        self.best, self.cost, self.sum, self.told = np.full(dim, 0.5), np.inf, 0.0, 0
        self.closed = False

    def ask(self):
        drift = 0.01 * np.sin(self.sum + np.arange(self.dim))
        return np.clip(self.best + drift + self.rng.normal(0.0, 0.2, (self.batch, self.dim)), 0.0, 1.0)

    def tell(self, x, outcomes):
        for u, outcome in zip(x, outcomes, strict=True):
            self.told += 1
            if outcome.residuals is not None:
                self.sum += float(outcome.residuals.sum()) + outcome.cost
            if outcome.cost < self.cost:
                self.best, self.cost = u, outcome.cost

    def stop(self):
        return None

    def close(self):
        self.closed = True

    def summary(self):
        return {"told": self.told}


class Frugal(Wanderer):
    """Ends when the budget it was made with is spent."""

    def stop(self):
        return "my budget is spent" if self.told >= self.budget else None


SPACE = Space({"x": Window(0.1, 2.0, "log"), "y": Window(-1.0, 1.0)})


def study(budget=40, *, seconds=0.0, trouble="", records=("decay",), optimiser=Wanderer, measured=0.7, **settings):
    """A study of the formula; settings of `CalibrationStudy` may be given."""
    settings = {"name": "formula", "batch": 4, "seed": 5, "screen": 8, "space": SPACE} | settings
    return CalibrationStudy(
        model=Model(Formula(seconds, trouble)),
        objective=Distance(records, measured),
        optimiser=optimiser,
        budget=budget,
        **settings,
    )


def run(a_study, folder, **options):
    """Run a study in this process, without a view."""
    with InProcess(partial(evaluate, a_study.without_search())) as pool:
        return a_study.run(Store(folder, view=None), pool, **options)


def lines(trials):
    """All that two runs of one study have in common, by asking number."""
    return [
        (t.number, t.u, t.values, t.cost, t.terms, t.status, t.reason, t.kind, t.phase, t.features,
         None if t.residuals is None else t.residuals.tobytes())
        for t in sorted(trials, key=lambda t: t.number)
    ]  # fmt: skip
