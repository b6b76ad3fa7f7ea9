"""Studies made up for the report: one with a period, one without, one in which nothing went well."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from calib.modelling.parameter import Parameter, Space, Window
from calib.objective import Reference
from calib.records import failed, make
from calib.records.excitation import Excitation
from calib.store import Trial
from calib.study import CalibrationResult

PERIOD = 0.04  # s


@dataclass(frozen=True)
class Scene:
    study: object
    trials: list
    records: dict
    result: CalibrationResult

    @property
    def arguments(self):
        return self.study, self.trials, self.records, self.result


def clapping(rng=None, scale=1.0, periods=6, samples=400):
    """A beam and a layer that is kicked once a period; noisy where `rng` is given."""
    phase = np.arange(periods * samples) / samples
    beam = 2.7e-3 * np.cos(2 * np.pi * phase)
    beam_velocity = -2.7e-3 * 2 * np.pi / PERIOD * np.sin(2 * np.pi * phase)
    saw = (phase - 0.3) % 1.0
    layer = scale * (2e-3 * np.cos(2 * np.pi * phase) + 1.2e-3 * (saw - saw**2) * 4.0)
    layer_velocity = scale * (-2e-3 * 2 * np.pi * np.sin(2 * np.pi * phase) + 4.8e-3 * (1.0 - 2.0 * saw)) / PERIOD
    channels = {"displacement": np.array([beam, layer]), "velocity": np.array([beam_velocity, layer_velocity])}
    attrs = {"frequency": 1.0 / PERIOD, "amplitude": 1.5e-3, "place": "end", "quantity": "displacement"}
    if rng is not None:
        channels = {
            c: v + s * rng.standard_normal(v.shape) for (c, v), s in zip(channels.items(), (2e-5, 6e-3), strict=True)
        }
        channels |= {"displacement_sigma": np.full(2, 2e-5), "velocity_sigma": np.full(2, 6e-3)}
        attrs |= {"source": "clapping.csv", "warning": "not measured: <computed> outside this project"}
    record = make(PERIOD * phase, ["q2", "q3"], channels, **attrs)
    if rng is None:
        record["impact_time"] = ("impact", PERIOD * (0.3 + np.arange(periods)))
    return record


def sliding(rng=None, coulomb=0.0):
    """A mass on a slide: displacement and velocity measured, the force that it takes."""
    time = np.arange(8000) / 400.0
    velocity = 0.1 * np.sin(1.3 * time) + 0.05 * np.sin(3.1 * time)
    position = np.cumsum(velocity) / 400.0
    force = 95.0 * np.gradient(velocity, time) + 200.0 * velocity + coulomb * np.sign(velocity)
    noise = np.zeros_like(time) if rng is None else rng.standard_normal(time.size)
    channels = {"displacement": position[None], "velocity": velocity[None], "force": force[None] + noise}
    return make(time, ["mass"], channels, prescribed="mass.displacement,mass.velocity" if rng is None else "")


def search(space, rng, number=240):
    trials = []
    for i in range(number):
        u = rng.random(space.dim) if i < 64 else np.clip(0.4 + 0.3 * rng.standard_normal(space.dim) * 0.98**i, 0.0, 1.0)
        cost = 0.02 + np.sum((u - 0.4) ** 2) * np.exp(0.2 * rng.standard_normal())
        kind = "period 1" if u[0] < 0.45 else "period 2" if u[0] < 0.7 else "irregular"
        bad = i % 17 == 3
        trials.append(
            Trial(
                i,
                u.tolist(),
                space.values(u),
                np.inf if bad else float(cost + (kind != "period 1")),
                {} if bad else {"phase_curve": float(cost)},
                status="step budget" if bad else "ok",
                reason=f"{1000 + i} steps made, {12 + i} of 100 periods" if bad else "",
                kind="" if bad else kind,
                seconds=0.01,
                phase="screen" if i < 64 else "search",
            )
        )
    return trials


def study(references, space, parameters):
    objective = SimpleNamespace(
        references=references,
        terms=[SimpleNamespace(label="phase_curve", weight=1.0), SimpleNamespace(label="amplitude", weight=0.5)],
        aligned=lambda name, record: record.assign(trust=("time", np.ones(record.sizes["time"]))),
    )
    model = SimpleNamespace(name="four_dof", bodies=("q2", "q3"), parameters=parameters)
    return SimpleNamespace(
        name="minimal",
        model=model,
        space=space,
        objective=objective,
        budget=600,
        seed=1,
        definition={"study": {"name": "minimal"}},
    )


@pytest.fixture
def undrawn(monkeypatch):
    """Leave the figures of a page empty: for claims about its words, which take a hundredth of the time."""
    monkeypatch.setattr("calib.report.pages.picture.svg", lambda figure, name, outlines: "<svg></svg>")


@pytest.fixture(scope="session")
def periodic():
    rng = np.random.default_rng(1)
    space = Space(
        {"restitution": Window(0.0, 0.6), "gap": Window(7e-4, 1.3e-3), "damping": Window(1e-3, 5e-2, "log")},
        {"mass": 1.02},
    )
    parameters = {
        p.name: p
        for p in (
            Parameter("restitution", "1", 0.05, "relative speed after an impact over the one before"),
            Parameter("gap", "m", 1e-3, "distance of the surfaces at rest"),
            Parameter("damping", "1", 0.004, "modal damping ratio"),
            Parameter("mass", "1", 1.0, "factor on the mass of the layer"),
        )
    }
    references = {
        "clapping": Reference("clapping", clapping(rng)),
        "louder": Reference("louder", clapping(rng, 1.1), use="holdout"),
        "slower": Reference("slower", clapping(rng, 0.9), use="holdout"),
    }
    trials = search(space, rng)
    best = min(trials, key=lambda t: t.cost)
    records = {"clapping": clapping(scale=1.03), "louder": clapping(scale=1.12)}
    records["slower"] = failed(["q2", "q3"], "diverged", "|q| > 1 m after 12 periods")
    result = {
        "name": "minimal",
        "status": "ok",
        "stopped": "all starts have ended",
        "values": best.values | {"restitution": 0.0},
        "intervals": {"restitution": [0.0, 0.02], "gap": [9e-4, 1.02e-3], "damping": [1e-3, 5e-2]},
        "at_edge": ["restitution"],
        "undetermined": [{"members": ["damping"], "text": "damping: not determined inside its window"}],
        "unreachable": [
            {
                "feature": "amplitude",
                "record": "clapping",
                "body": "q3",
                "unit": "m",
                "measured": 2.41e-3,
                "nearest": 3.02e-3,
                "off": 6.1,
            }
        ],
        "score": {"total": best.cost, "terms": {"phase_curve": 0.031, "amplitude": 0.012}},
        "motion": {"kind": "period 1", "wrong": [], "evidence": "section spread 1e-6"},
        "agreement": {"starts": 8, "agree": 6},
        "holdout": {
            "louder": {"misfit": 0.028, "score": 0.051, "kind": "period 1", "status": "ok", "reason": ""},
            "slower": {"misfit": None, "score": None, "kind": None, "status": "diverged", "reason": "|q| > 1 m"},
        },
        "confidence": {
            "status": "ok",
            "reason": "",
            "standard_error": {"restitution": 0.01, "gap": 3e-5, "damping": None},
            "at_edge": {"restitution": "low"},
        },
        "nuisances": {"clapping": {"trigger": 0.0123}},
        "nuisance_units": {"trigger": "s"},
        "best_trial": best.number,
        "trials": len(trials),
        "failed": sum(t.status != "ok" for t in trials),
        "simulations": 700,
        "seconds": 12.3,
    }
    return Scene(study(references, space, parameters), trials, records, CalibrationResult.from_dict(result))


@pytest.fixture(scope="session")
def recorded():
    rng = np.random.default_rng(2)
    space = Space({"mass": Window(50.0, 150.0), "viscous": Window(10.0, 1000.0, "log")})
    parameters = {
        "mass": Parameter("mass", "kg", 95.0, "moving mass"),
        "viscous": Parameter("viscous", "N s/m", 200.0, "viscous friction"),
    }
    force = Excitation("mass", "force", time=np.arange(8000) / 400.0, value=np.zeros(8000))
    references = {"emps": Reference("emps", sliding(rng, coulomb=20.0), excitation=force)}
    trials = search(space, rng, 100)
    best = min(trials, key=lambda t: t.cost)
    result = {
        "values": best.values,
        "score": {"total": best.cost, "terms": {"force_balance": 0.167}},
        "motion": {"kind": "not periodic"},
        "best_trial": best.number,
    }
    return Scene(study(references, space, parameters), trials, {"emps": sliding()}, CalibrationResult.from_dict(result))


@pytest.fixture(scope="session")
def hopeless(periodic):
    trials = [t for t in periodic.trials if t.status != "ok"]
    result = {
        "status": "failed",
        "values": {},
        "score": {"total": None, "terms": {}},
        "motion": {"kind": None},
        "best_trial": None,
    }
    return Scene(periodic.study, trials, {}, CalibrationResult.from_dict(result))
