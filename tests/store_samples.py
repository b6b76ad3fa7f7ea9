"""Trials and records for a store, and a folder filled with them."""

import math

import numpy as np

from calib.modelling.parameter import Space, Window
from calib.records import record
from calib.store import Store, StudyHeader, Trial

WINDOWS = {"x": {"low": 0.1, "high": 2.0, "scale": "log"}, "y": {"low": -1.0, "high": 1.0, "scale": "linear"}}
SPACE = Space({name: Window(**window) for name, window in WINDOWS.items()})
TIME = np.linspace(0.0, 1.0, 41)
HEADER = StudyHeader("demo", {"seed": 1, "windows": WINDOWS}, screen=2, budget=20)


def picture(trial, records):
    """Something that a store may take for a picture."""
    return b"\x89PNG" + bytes(10)


def trial(number, cost=None, **more):
    rng = np.random.default_rng(number)
    u = rng.random(2).tolist()
    values = {**SPACE.values(u), "gap": 1e-3}
    cost = 1.0 / (1 + number) if cost is None else cost
    return Trial(
        **{
            "number": number,
            "u": u,
            "values": values,
            "cost": cost,
            "terms": {"curve": cost},
            "kind": "period-1",
            "seconds": 0.25,
            "residuals": rng.normal(size=5),
        }
        | more
    )


def failed(number):
    return trial(number, math.inf, status="diverged", reason="x is above 1.5", kind=None, residuals=None, terms={})


def records(number=0, names=("clapping",)):
    one = record.make(TIME, ["layer"], {"displacement": (number + TIME)[None, :]})
    return {name: one for name in names}


def filled(folder, trials, header=HEADER, **options):
    with Store(folder, **{"view": None} | options) as store:
        store.open(header)
        for one in trials:
            store.append(one, records(one.number) if one.cost < math.inf else None)
    return folder
