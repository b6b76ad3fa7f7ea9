"""Calibrations of records made from hidden values, and whether the stated intervals cover these."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from calib.confidence import around_best
from calib.execution.pool import InProcess
from calib.features import PhaseCurve, TimeHistory
from calib.modelling.model import Model
from calib.modelling.parameter import Space, Window
from calib.modelling.simulator import Request
from calib.objective import Objective, Reference, Term
from calib.optimisers.multistart import Multistart
from calib.records import channels
from calib.records.excitation import Excitation
from calib.simulators.four_dof import FourDof
from calib.simulators.oscillator import Oscillator
from calib.store import Store
from calib.study import CalibrationStudy, evaluate

NOISE = 0.02  # of each channel's standard deviation
TIME = np.arange(2000) * 1e-3  # s
PUSH = np.random.default_rng(5).standard_normal(200)  # a recorded force: smooth between 0.01 s knots


@dataclass(frozen=True)
class Case:
    """A simulator with an excitation, what is searched, and from where the truth is drawn (the inner part of it)."""

    simulator: object
    excitation: Excitation
    request: Request
    windows: dict[str, Window]
    fixed: dict[str, float]
    feature: object
    nuisance: tuple[str, ...] = ()
    budget: int = 200

    def truth(self, rng):
        """Draw values until the motion is one that can be calibrated: ok, and of period 1 where it has a period."""
        space = Space(self.windows, self.fixed)
        while True:
            values = space.values(rng.uniform(0.2, 0.8, space.dim))
            record = Model(self.simulator).run(values, self.excitation, self.request)
            if record.attrs["status"] == "ok" and self.steady(record):
                return values, record

    def steady(self, record):
        if not self.excitation.periodic:
            return True
        section = record["section_displacement"].values
        impacts = record.get("impact_speed")
        hit = impacts is None or (impacts.size == self.request.periods and impacts.min() > 0.05)
        return hit and np.ptp(section, axis=1).max() < 1e-6 * np.abs(section).max()


def smooth_force():
    return np.interp(TIME, np.arange(200) * 1e-2, 20.0 * PUSH)


CASES = {
    "four_dof": Case(
        FourDof(),
        Excitation("end", "displacement", frequency=26.24, amplitude=1.5e-3),
        Request(periods=6, samples=200),
        {
            "restitution": Window(0.0, 0.2),
            "gap": Window(0.8e-3, 1.2e-3),
            "damping": Window(0.002, 0.02, "log"),
            "layer_stiffness": Window(0.9, 1.1),
            "amplitude": Window(0.9, 1.1),
        },
        {},
        PhaseCurve(),
        ("trigger",),
    ),
    "oscillator, free decay": Case(
        Oscillator(),
        Excitation("mass", "free decay"),
        Request(times=TIME[:1000]),
        {
            "damping": Window(0.3, 3.0, "log"),
            "stiffness": Window(500.0, 2000.0, "log"),
            "initial_displacement": Window(-5e-3, 5e-3),
            "initial_velocity": Window(-0.2, 0.2),
        },
        {"mass": 1.0},
        TimeHistory(),
    ),
    "oscillator, recorded force": Case(
        Oscillator(),
        Excitation("mass", "force", time=TIME, value=smooth_force()),
        Request(times=TIME),
        {
            "mass": Window(0.5, 2.0, "log"),
            "damping": Window(1.0, 10.0, "log"),
            "stiffness": Window(500.0, 2000.0, "log"),
            "load": Window(-20.0, 20.0),
        },
        {},
        TimeHistory(),
    ),
    "oscillator, servo": Case(
        Oscillator(),
        Excitation("mass", "servo reference", time=TIME, value=1e-3 * smooth_force()),
        Request(times=TIME),
        {
            "mass": Window(50.0, 200.0, "log"),
            "damping": Window(100.0, 1000.0, "log"),
            "load": Window(-50.0, 50.0),
        },
        {"stiffness": 0.0, "position_gain": 20.0, "velocity_gain": 50.0, "drive_constant": 35.0},
        TimeHistory(),
    ),
    "oscillator with a stop": Case(
        Oscillator(stop=True),
        Excitation("mass", "force", frequency=4.0, amplitude=2.0),
        Request(periods=6, samples=200),
        {
            "restitution": Window(0.1, 0.6),
            "gap": Window(0.5e-3, 3e-3),
            "damping": Window(1.0, 6.0, "log"),
            "stiffness": Window(600.0, 1500.0, "log"),
        },
        {"mass": 1.0},
        PhaseCurve(),
        ("trigger",),
    ),
}


def noisy(record, rng):
    """The record as an instrument gives it: without the section and the list of impacts, with white noise."""
    kept = record[list(channels(record))].copy(deep=True)
    for channel in channels(record):
        values = kept[channel].values
        values += NOISE * values.std(axis=1, keepdims=True) * rng.standard_normal(values.shape)
    return kept


def recovered(case, seed, folder):
    """Truth, and confidence at the best point of a blind calibration."""
    rng = np.random.default_rng(seed)
    truth, record = case.truth(rng)
    reference = Reference(
        "made", noisy(record, rng), nuisance=case.nuisance, excitation=case.excitation, request=case.request
    )
    study = CalibrationStudy(
        name="recovery",
        model=Model(case.simulator),
        space=Space(case.windows, case.fixed),
        objective=Objective({"made": reference}, [Term(case.feature)]),
        optimiser=Multistart,
        budget=case.budget,
        seed=seed,
    )
    pool = InProcess(partial(evaluate, study.without_search()))
    found = study.run(Store(folder, view=None, keep="best"), pool)
    return truth, around_best(study, pool, found.best)


def coverage(seeds, folder: Path):
    """Whether the interval of each parameter covers the truth: (case, parameter, seed, whether), of all cases."""
    rows = []
    for name, case in CASES.items():
        for seed in seeds:
            truth, confidence = recovered(case, seed, folder / f"{name} {seed}")
            for parameter in case.windows:
                low, high = confidence.interval.get(parameter, (np.nan, np.nan))
                rows.append((name, parameter, seed, low <= truth[parameter] <= high))
    return rows
