"""Frequency responses of 400 points with stability, by harmonic balance, by shooting and by pyHarm.

    PYTHONPATH=tests python tests/benchmarks/bench_response.py

CPU seconds on one thread, compiled before, of an oscillator with a cubic spring through its folds, and of `four_dof`
with a cubic spring on each body out of contact: per point as they are followed, and for 400 of them; then the folds
that each finds. Harmonic balance is followed once more in steps so short that there are 400 points. pyHarm (`pip
install pyHarm-os`; its harmonic balance of the same oscillator with as many harmonics, without multipliers) is left out
where it is not installed.
"""

import copy
import logging
import os
import time
import warnings
from functools import partial
from operator import itemgetter

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from calib.dynamics.arclength import MAX_ARCLENGTH_STEP, run
from calib.dynamics.harmonic_balance import HarmonicBalance
from calib.dynamics.harmonic_response import balanced_response
from calib.dynamics.response import frequency_response
from calib.dynamics.series_curve import SeriesCurve, at_own_scale, linear_size, modal_system
from calib.dynamics.setting import Setting
from calib.effects.cubic_stiffness import EFFECT as CUBIC_STIFFNESS
from calib.modelling.model import Model
from calib.records.excitation import Excitation
from calib.simulators.four_dof import FourDof
from calib.simulators.oscillator import Oscillator

HARMONICS, POINTS, REPEATS = 7, 400, 3
DUFFING = Setting(
    Model(Oscillator(), [CUBIC_STIFFNESS]),
    Excitation("mass", "force", frequency=3.0, amplitude=1.0),
    {"mass": 1.0, "damping": 1.0, "stiffness": 400.0, "k3": 4e5},
)
FOUR_DOF = Setting(
    Model(FourDof(), [CUBIC_STIFFNESS]),
    Excitation("end", "displacement", frequency=26.24, amplitude=1.5e-3),
    {"k3": 2e9},
)
CASES = {"oscillator": (DUFFING, (2.5, 4.5), 0.6), "four_dof": (FOUR_DOF, (20.0, 32.0), 1.5e-4)}


def cpu(function):
    """CPU seconds of a call, and what it returns."""
    begin = time.process_time()
    answer = function()
    return time.process_time() - begin, answer


def told(name, seconds, points, folds):
    """Print a line of the table."""
    at = ", ".join(f"{fold:.9f}" for fold in folds) or "none"
    each = seconds / points
    print(f"{name}: {1e3 * each:.2f} ms a point, {POINTS} points {POINTS * each:.2f} s; folds {at}")


def ours(name, setting, window, level):
    """Time harmonic balance and shooting."""
    for method, follow in (
        ("harmonic balance", lambda: balanced_response(setting, window, [level], harmonics=HARMONICS, steps=2)),
        ("shooting", lambda: frequency_response(setting, window, [level], steps=2)),
    ):
        follow()  # compiles
        seconds, response = min((cpu(follow) for _ in range(REPEATS)), key=lambda pair: pair[0])
        branches = response.branches
        points = sum(one.frequency.size for one in branches)
        folds = [point.parameter for one in branches for point in one.branch.points if point.kind == "fold"]
        told(f"{name}, {method}", seconds, points, folds)


def finely(name, setting, window, level):
    """Time a curve of harmonic balance in steps so short that it has some 400 points, its special points included."""
    balance = HarmonicBalance(modal_system(setting, window[0], level), HARMONICS)
    amplitude = balance.system.amplitude

    def followed(scale, longest=MAX_ARCLENGTH_STEP):
        curve = SeriesCurve(balance, *window, scale, lambda frequency: amplitude)
        y = curve.solved(balance.linear_motion(2.0 * np.pi * window[0], amplitude), window[0])
        way = run(curve, curve.start(y, window[0]), 10 * POINTS, longest)
        return (curve, way), way.points

    curve, way = at_own_scale(linear_size(balance, window, lambda frequency: amplitude), followed)
    length = sum(np.linalg.norm(b.z - a.z) for a, b in zip(way.points[:-1], way.points[1:], strict=True))
    again = partial(followed, curve.scale, length / POINTS)
    seconds, ((curve, way), _) = min((cpu(again) for _ in range(REPEATS)), key=itemgetter(0))
    folds = [curve.parameter(mark.point.z) for _, mark in way.marks if mark.kind == "fold"]
    told(f"{name}, harmonic balance in short steps", seconds, len(way.points), folds)


def pyharm():
    """Time pyHarm on the oscillator."""
    try:
        from pyHarm.Maestro import Maestro
    except ImportError:
        print("pyHarm is not installed")
        return
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)
    values, one, (_, window, level) = DUFFING.values, np.ones((1, 1)), CASES["oscillator"]
    given = {
        "analysis": {
            "response": {
                "study": "frf", "solver": "scipyroot", "puls_inf": 2.0 * np.pi * window[0],
                "puls_sup": 2.0 * np.pi * window[1], "ds_max": 0.1, "ds_min": 1e-8, "ds0": 0.01, "verbose": False,
            }
        },
        "system": {"type": "Base", "nh": HARMONICS, "nti": 128, "adim": {"status": False, "lc": 1.0, "wc": 1.0}},
        "substructures": {
            "mass": {
                "matrix": {"M": one * values["mass"], "C": one * values["damping"], "K": one * values["stiffness"],
                           "G": 0.0 * one}, "ndofs": 1, "nmodes": 0,
            }
        },
        "connectors": {
            "spring": {"type": "CubicSpring", "connect": {"mass": [0]}, "dirs": [0],
                       "k": values["mass"] * values["k3"]},
            "force": {"type": "CosinusForcing", "connect": {"mass": [0]}, "dirs": [0], "amp": level},
        },
    }  # fmt: skip
    for _ in range(2):  # the first compiles
        maestro = Maestro(copy.deepcopy(given))
        seconds, _ = cpu(maestro.operate)
    frequency = np.array([solution.x[-1] for solution in maestro.nls["response"].SolList]) / (2.0 * np.pi)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(frequency)))) + 1  # some more near a fold, where its steps turn back
    told("oscillator, pyHarm", seconds, frequency.size, frequency[turns[[0, -1]]] if turns.size else [])


if __name__ == "__main__":
    for name, case in CASES.items():
        ours(name, *case)
        finely(name, *case)
    pyharm()
