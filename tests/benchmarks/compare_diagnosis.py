"""How often a hidden effect is named: calib's diagnosis beside its peers, on the same records.

    python tests/benchmarks/compare_diagnosis.py --out /tmp/diagnosis.jsonl

writes a line a case (and goes on from those that are there: another version of calib needs another file), then prints
the table. Peers that are not installed are named as missing: `pip install petab-select pysindy`.

A mass on a spring and a damper, from rest under 31 tones of 1 to 16 Hz at three amplitudes: three records of 500
samples, displacement and velocity, and the force without noise. The hidden force is cubic in the displacement, v |v|,
sgn v, or absent; its rms is 2 % of that of the driving force, along the motions without it, whoever seeks it. The seed
draws the phases of the tones and the noise. The truth is integrated by scipy's DOP853 from one reversal of a dry
friction to the next, sticking included. All know mass and force up to a factor, and seek damping, stiffness and that
factor beside the same five candidates: x^3, v |v|, sgn v, x |x| and a constant. None is told the noise.

calib         a study with the default search (60 trials) and the default diagnosis
petab-select  forward selection by BIC, until a step brings no lower one; least squares on the motions simulated by
              calib's oscillator, from where the predecessor ended; its sgn v is sharp (tanh(v / 10 um/s)), and the
              coefficients of v |v| and sgn v are not negative, as in calib
pysindy       weak form of the velocity's equation, rows divided by the rms of their record, stepwise sparse regression
              (SSR, by residual), number of terms by BIC with as many rows as are independent. Half width of the
              domains, their number, and SSR in place of STLSQ over 33 thresholds or of smoothed derivatives
              (Savitzky and Golay, four windows) are what named most in 72 cases with the seeds 100 to 105

Counted for each hidden force: right (named exactly), wrong (named otherwise), neither; for nothing hidden: silent, and
false alarms. Where calib says "one of", it is wrong if the truth is not among them, else neither. CPU seconds are the
median of a method's cases, calibration included.

Twenty seeds (720 cases), two busy cores, petab-select 0.4 and pysindy 2.1; right, wrong, neither; silent, alarms:

============  =====  ===============  ==============  ================  =======  =====
method        noise  cubic_stiffness  quadratic_drag  coulomb_friction  nothing  CPU s
============  =====  ===============  ==============  ================  =======  =====
calib         0.05%  18, 2, 0         20, 0, 0        20, 0, 0          20, 0    7.9
calib         1.00%  19, 1, 0         20, 0, 0        20, 0, 0          20, 0    6.8
calib         3.00%  18, 1, 1         20, 0, 0        20, 0, 0          20, 0    6.8
petab-select  0.05%  18, 2, 0         20, 0, 0        19, 1, 0          20, 0    12.2
petab-select  1.00%  19, 1, 0         20, 0, 0        19, 1, 0          19, 1    12.3
petab-select  3.00%  18, 2, 0         20, 0, 0        20, 0, 0          20, 0    11.4
pysindy       0.05%  19, 1, 0         17, 3, 0        17, 3, 0          18, 2    0.5
pysindy       1.00%  15, 5, 0         17, 2, 1        18, 2, 0          18, 2    0.5
pysindy       3.00%  8, 5, 7          6, 4, 10        17, 2, 1          17, 3    0.5
============  =====  ===============  ==============  ================  =======  =====

Four of calib's five misses name a second cause beside the cubic spring (preload three times, v |v| once), as a
threshold that noise passes once in a hundred searches will; the fifth leaves open whether it is cubic or softening.
"""

import argparse
import json
import os
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from importlib.util import find_spec
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # CPU seconds of one thread, whatever the machine

import numpy as np  # noqa: E402 - after the number of threads
from scipy.integrate import solve_ivp  # noqa: E402
from scipy.optimize import least_squares  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from hidden.seeker import seek  # noqa: E402 - run as a script

from calib.diagnosis.verdict import NAMED, NONE, ONE_OF  # noqa: E402
from calib.effects import coulomb_friction, cubic_stiffness, quadratic_drag, softening  # noqa: E402
from calib.modelling.model import Model  # noqa: E402
from calib.modelling.simulator import Request  # noqa: E402
from calib.records import record, write  # noqa: E402
from calib.records.excitation import Excitation  # noqa: E402
from calib.simulators.oscillator import Oscillator  # noqa: E402

MASS, DAMPING, STIFFNESS = 1.0, 2.5, 3950.0  # kg, N s/m, N/m: 10 Hz, 2 % of critical
TONES = np.arange(1.0, 16.5, 0.5)  # Hz, of the force, with phases of the seed
AMPLITUDES = (0.25, 0.5, 1.0)  # N, of each tone: one record each, from rest
TIME = np.arange(500) * 2e-3  # s
WINDOWS = {"damping": (0.5, 10.0), "stiffness": (3000.0, 5000.0), "amplitude": (0.8, 1.25)}  # calibrated
SHARE = 0.02  # of the rms of the force that the hidden one has, along the motion without it
NOISES = (0.0005, 0.01, 0.03)  # of the rms of each channel

# --- what is hidden -------------------------------------------------------------------------------------------------

TERMS: Mapping[str, Callable] = {  # force per unit mass over its coefficient
    "cubic_stiffness": lambda x, v: -(x**3),
    "quadratic_drag": lambda x, v: -v * abs(v),
    "coulomb_friction": lambda x, v: -np.sign(v),
    "softening": lambda x, v: -x * abs(x),
    "preload": lambda x, v: 1.0 + 0.0 * x,
}  # fmt: skip
NOTHING = "nothing"
HIDDEN = ("cubic_stiffness", "quadratic_drag", "coulomb_friction", NOTHING)
LEAST = 1e-7  # s: where friction and pull balance, rounding would turn the mass back and forth at one instant


class Data(NamedTuple):
    """Records: forces (r, n) [N], displacements [m] and velocities [m/s] (r, n) with their noise."""

    force: np.ndarray
    x: np.ndarray
    v: np.ndarray


def motion(force: Callable, hidden: str, size: float) -> np.ndarray:
    """Displacement and velocity (2, n) at TIME, from rest under a force [N] of time, with a hidden term.

    Dry friction turns about where the velocity does, and holds the mass for as long as it can.
    """
    friction = size if hidden == "coulomb_friction" else 0.0
    smooth = size if hidden not in ("coulomb_friction", NOTHING) else 0.0
    term = TERMS.get(hidden, TERMS["preload"])

    def pull(t, x, v):
        return (force(t) - DAMPING * v - STIFFNESS * x) / MASS + smooth * term(x, v)

    def slides(t, x):
        ahead = pull(t, x, 0.0)
        return 0.0 if abs(ahead) < friction else np.sign(ahead)

    rows, begin, end, y = np.zeros((2, TIME.size)), 0.0, TIME[-1] + 1e-6, np.zeros(2)
    sign = slides(begin, y[0])
    while True:

        def rate(t, y, sign=sign):
            return (y[1], pull(t, *y) - friction * sign) if sign else (0.0, 0.0)

        def turns(t, y, sign=sign):
            return sign * y[1] if sign else abs(pull(t, y[0], 0.0)) - friction

        turns.terminal, turns.direction = True, -1 if sign else 1
        arc = solve_ivp(
            rate, (begin, end), y, "DOP853", dense_output=True, max_step=0.01, rtol=1e-10, atol=1e-13,
            events=turns if friction else None,
        )  # fmt: skip
        ended = max(arc.t[-1], begin + LEAST)
        inside = (begin <= TIME) & (ended >= TIME)
        if inside.any():
            rows[:, inside] = arc.sol(TIME[inside])
        if arc.status != 1:
            return rows
        begin, y = ended, np.array([arc.y[0, -1], 0.0])
        sign = slides(begin, y[0]) if sign else np.sign(pull(begin, y[0], 0.0))


def measured(hidden: str, noise: float, seed: int) -> Data:
    """Records of a case; its size is SHARE of the force, along the motions of the linear mass."""
    phases = 2.0 * np.pi * np.random.default_rng(seed).uniform(size=TONES.size)

    def tones(t):
        return np.cos(2.0 * np.pi * np.multiply.outer(t, TONES) + phases).sum(axis=-1)

    forces = np.multiply.outer(AMPLITUDES, tones(TIME))
    size = 0.0
    if hidden != NOTHING:
        linear = np.array([motion(lambda t, a=a: a * tones(t), NOTHING, 0.0) for a in AMPLITUDES])
        size = SHARE * rms(forces) / MASS / rms(TERMS[hidden](linear[:, 0], linear[:, 1]))
    clean = np.array([motion(lambda t, a=a: a * tones(t), hidden, size) for a in AMPLITUDES])
    sigma = noise * np.sqrt((clean**2).mean(axis=2, keepdims=True))
    rng = np.random.default_rng([seed, HIDDEN.index(hidden), NOISES.index(noise)])
    noisy = clean + sigma * rng.standard_normal(clean.shape)
    return Data(forces, noisy[:, 0], noisy[:, 1])


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


# --- calib ------------------------------------------------------------------------------------------------------------


def calib(data: Data) -> dict:
    """Calibrate a study and diagnose it, with the default search and the default diagnosis."""
    with tempfile.TemporaryDirectory() as folder:
        for index, (force, x, v) in enumerate(zip(*data, strict=True)):
            one = record.make(
                TIME, ["mass"], {"displacement": x[None], "velocity": v[None]},
                place="mass", quantity="force", source="measured",
            ).assign(excitation=("time", force, {"units": "N"}))  # fmt: skip
            write(one, Path(folder) / f"record_{index}.nc")
        (Path(folder) / "study.toml").write_text(study())
        found = seek(Path(folder))
    said = {"verdict": found.verdict, "said": found.summary, "classes": [list(names) for names in found.classes]}
    return {"named": list(found.causes), "open": found.verdict not in (NONE, NAMED), **said}


def study() -> str:
    """Text of the study file."""
    lines = ["[study]", 'name = "oscillator"', "seed = 1", "budget = 60"]
    for index in range(len(AMPLITUDES)):
        lines += ["[[record]]", f'name = "record_{index}"', f'path = "record_{index}.nc"', 'use = "calibrate"']
    lines += ["[model]", 'simulator = "oscillator"', f'fixed = {{ mass = "{MASS} kg" }}', "[windows]"]
    lines += [f"{name} = {{ low = {low}, high = {high} }}" for name, (low, high) in WINDOWS.items()]
    lines += ["[[term]]", 'feature = "time_history"', "[optimiser]", 'name = "multistart"']
    return "\n".join([*lines, "[diagnosis]", f"candidates = {json.dumps(list(TERMS))}", ""])


# --- petab-select -----------------------------------------------------------------------------------------------------


COEFFICIENTS = {
    "cubic_stiffness": "k3", "quadratic_drag": "c2", "coulomb_friction": "friction", "softening": "kx",
    "preload": "load",
}  # fmt: skip
EFFECTS = {
    "k3": cubic_stiffness.EFFECT, "c2": quadratic_drag.EFFECT, "friction": coulomb_friction.EFFECT,
    "kx": softening.EFFECT,
}  # fmt: skip


FIRST = 0.1  # of the hidden size, at which the fit of a further term starts
SLIP = 1e-5  # m/s, over which dry friction turns about in the fits


class Likelihood:
    """Fits of the oscillator with some of the terms, by least squares over all samples.

    The noise is one unknown share of the rms of each channel: -log L = N / 2 log(sum of squares) + constant.
    """

    def __init__(self, data: Data):
        self.drives = [Excitation("mass", "force", time=TIME, value=force) for force in data.force]
        self.rows = np.stack([data.x, data.v], axis=1)
        self.scale = np.sqrt((self.rows**2).mean(axis=2, keepdims=True))
        force = SHARE * rms(data.force) / MASS
        self.units = {name: force / rms(TERMS[term](data.x, data.v)) for term, name in COEFFICIENTS.items()}
        self.units |= {name: np.sqrt(low * high) for name, (low, high) in WINDOWS.items()}

    def residuals(self, values: Mapping[str, float]) -> np.ndarray:
        """Simulated less measured, over the rms of each channel (N,)."""
        model = Model(Oscillator(), [EFFECTS[name] for name in values if name in EFFECTS])
        slip = {"friction_slip": SLIP} if "friction" in values else {}
        runs = [model.run({"mass": MASS, **values, **slip}, drive, Request(times=TIME)) for drive in self.drives]
        rows = np.array([[run.displacement.values[0], run.velocity.values[0]] for run in runs])
        return ((rows - self.rows) / self.scale).ravel()

    def fitted(self, names, start: Mapping[str, float]) -> tuple[dict[str, float], float]:
        """Estimates by name, and -log L there."""
        units = np.array([self.units[name] for name in names])
        begin = [start[n] / self.units[n] if n in start else 1.0 if n in WINDOWS else FIRST for n in names]
        low = [0.0 if name in ("c2", "friction") else -np.inf for name in names]
        found = least_squares(
            lambda u: self.residuals(dict(zip(names, u * units, strict=True))), begin, bounds=(low, np.inf),
            method="dogbox", diff_step=1e-6, xtol=1e-6, ftol=1e-6,
        )  # fmt: skip
        nllh = 0.5 * found.fun.size * np.log(2.0 * found.cost)
        return dict(zip(names, (found.x * units).tolist(), strict=True)), float(nllh)


def petab_select(data: Data) -> dict:
    """Forward selection by BIC; each model starts where its predecessor ended."""
    import petab_select as ps

    likelihood = Likelihood(data)
    with tempfile.TemporaryDirectory() as folder:
        problem = ps.Problem.from_yaml(selection_problem(Path(folder), likelihood.rows.size))
        space, fits = None, 0
        while True:
            begun = ps.ui.start_iteration(problem, space)
            space = begun[ps.constants.CANDIDATE_SPACE]
            before = getattr(begun[ps.constants.PREDECESSOR_MODEL], "estimated_parameters", None) or {}
            models = ps.Models()
            for model in begun[ps.constants.UNCALIBRATED_MODELS]:
                values, nllh = likelihood.fitted(model.get_estimated_parameter_ids(), before)
                model.set_estimated_parameters(values)
                model.set_criterion(ps.Criterion.NLLH, nllh)
                model.compute_criterion(ps.Criterion.BIC)
                models.append(model)
                fits += 1
            end = ps.ui.end_iteration(problem, space, models)
            best = ps.ui.get_best(problem, problem.state.models)
            if end[ps.constants.TERMINATE] or best not in models:
                break
    named = [term for term, name in COEFFICIENTS.items() if name in best.estimated_parameters]
    return {"named": named, "open": False, "models": fits}


def selection_problem(folder: Path, count: int) -> Path:
    """Write the files that petab-select reads: parameters, as many measurements as there are, the space of models."""
    names = [*WINDOWS, *COEFFICIENTS.values()]
    rows = [f"{name}\tlin\t-1e9\t1e9\t0.0\t{int(name in WINDOWS)}" for name in names]
    head = "parameterId\tparameterScale\tlowerBound\tupperBound\tnominalValue\testimate"
    (folder / "parameters.tsv").write_text("\n".join([head, *rows, ""]))
    rows = [f"channel\trun\t0\t{index}" for index in range(count)]
    head = "observableId\tsimulationConditionId\tmeasurement\ttime"
    (folder / "measurements.tsv").write_text("\n".join([head, *rows, ""]))
    (folder / "petab.yaml").write_text(
        "format_version: 1\nparameter_file: parameters.tsv\nproblems:\n- measurement_files: [measurements.tsv]\n"
        "  condition_files: []\n  observable_files: []\n  sbml_files: []\n"
    )
    head = "\t".join(["model_subspace_id", "model_subspace_petab_yaml", *COEFFICIENTS.values()])
    row = "\t".join(["oscillator", "petab.yaml", *["0;estimate"] * len(COEFFICIENTS)])
    (folder / "models.tsv").write_text(f"{head}\n{row}\n")
    path = folder / "problem.yaml"
    path.write_text("format_version: 1.0.0\ncriterion: BIC\nmethod: forward\nmodel_space_files: [models.tsv]\n")
    return path


# --- pysindy ----------------------------------------------------------------------------------------------------------

HALF = 0.04  # s, half the width of a domain of the weak form
POWER, DOMAINS = 4, 300  # of the test functions (1 - s^2)^p; in each record, at random places
APART = 25  # of them that count as independent, twice as many as stand side by side


def pysindy(data: Data) -> dict:
    """Weak form of the velocity's equation, stepwise sparse regression, and BIC for the number of terms.

    The rows of a record are divided by their rms, which is what its noise is relative to.
    """
    import pysindy as ps

    np.random.seed(0)  # noqa: NPY002 - pysindy draws its domains from the global generator
    functions = [lambda x, v, u: x, lambda x, v, u: v, lambda x, v, u: u, *map(_of_three, TERMS.values())]
    library = ps.WeakPDELibrary(ps.CustomLibrary(functions), spatiotemporal_grid=TIME, H_xt=HALF, p=POWER, K=DOMAINS)
    columns, rates = [], []
    for force, x, v in zip(*data, strict=True):
        rows = ps.AxesArray(np.column_stack([x, v, force]), {"ax_time": 0, "ax_coord": 1})
        rate = np.asarray(library.convert_u_dot_integral(rows))[:, 1]
        columns.append(np.asarray(library.fit_transform([rows])[0]) / rms(rate))
        rates.append(rate / rms(rate))
    columns, rates = np.concatenate(columns), np.concatenate(rates)
    search = ps.SSR(alpha=1e-10, criteria="model_residual", normalize_columns=True)
    search.fit(columns, rates[:, None])
    kept = {tuple(np.ravel(coefficients) != 0.0) for coefficients in search.history_}
    best = min(kept, key=lambda terms: _bic(columns[:, terms], rates))
    return {"named": [term for term, there in zip(TERMS, best[3:], strict=True) if there], "open": False}


def _of_three(term: Callable) -> Callable:
    return lambda x, v, u: term(x, v)


def _bic(columns: np.ndarray, rates: np.ndarray) -> float:
    """BIC of a least-squares fit of the rates (N,) by columns (N, k), in as many rows as are independent."""
    columns = columns / np.linalg.norm(columns, axis=0)
    left = rates - columns @ np.linalg.lstsq(columns, rates, rcond=None)[0]
    count = APART * len(AMPLITUDES)
    return count * np.log(np.mean(left**2)) + columns.shape[1] * np.log(count)


# --- the comparison ---------------------------------------------------------------------------------------------------

# name: (method, package it needs)
METHODS = {
    "calib": (calib, None), "petab-select": (petab_select, "petab_select"), "pysindy": (pysindy, "pysindy"),
}  # fmt: skip
RIGHT, WRONG, NEITHER = "right", "wrong", "neither"


def played(case: dict) -> dict:
    """One case, given to one method."""
    data = measured(case["hidden"], case["noise"], case["seed"])
    begin = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = METHODS[case["method"]][0](data)
    return {**case, **found, "outcome": outcome(case["hidden"], found), "seconds": time.process_time() - begin}


def outcome(hidden: str, found: Mapping) -> str:
    """Right: exactly what is hidden is named, or nothing is said where nothing is; neither: nothing wrong is said.

    A diagnosis that says "one of" is wrong where what is hidden is not one of them; where nothing is hidden, whatever
    is said is a false alarm, "unexplained" too.
    """
    if hidden == NOTHING:
        return WRONG if found["named"] or found["open"] else RIGHT
    if found["named"]:
        return RIGHT if found["named"] == [hidden] else WRONG
    return WRONG if found.get("verdict") == ONE_OF and [hidden] not in found["classes"] else NEITHER


def table(rows: list[dict]) -> str:
    """Right, wrong and neither of each method, noise and hidden term; false alarms; median CPU seconds."""
    head = ["method", "noise", *HIDDEN, "CPU s"]
    lines = [head]
    for method in dict.fromkeys(row["method"] for row in rows):
        for noise in NOISES:
            own = [row for row in rows if (row["method"], row["noise"]) == (method, noise)]
            counts = []
            for hidden in HIDDEN:
                told = [row["outcome"] for row in own if row["hidden"] == hidden]
                kinds = (RIGHT, WRONG) if hidden == NOTHING else (RIGHT, WRONG, NEITHER)
                counts.append(", ".join(str(told.count(kind)) for kind in kinds))
            seconds = f"{np.median([row['seconds'] for row in own]):.1f}" if own else "-"
            lines.append([method, f"{noise:.2%}", *counts, seconds])
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join("  ".join(cell.ljust(w) for cell, w in zip(line, widths, strict=True)).rstrip() for line in lines)


def main():
    """Play what is missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="of the seeds")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--methods", nargs="+", default=list(METHODS), choices=METHODS)
    parser.add_argument("--out", type=Path, help="a line a case; cases that are there are not played again")
    given = parser.parse_args()
    for method in [m for m in given.methods if METHODS[m][1] and not find_spec(METHODS[m][1])]:
        print(f"missing: {method} (pip install {method})")
        given.methods.remove(method)
    seeds = range(given.first, given.first + given.seeds)
    cases = [
        {"method": method, "hidden": hidden, "noise": noise, "seed": seed}
        for seed in seeds for hidden in HIDDEN for noise in NOISES for method in given.methods
    ]  # fmt: skip
    there = given.out is not None and given.out.exists()
    rows = [json.loads(line) for line in given.out.read_text().splitlines()] if there else []
    done = {tuple(row[name] for name in cases[0]): row for row in rows}
    todo = [case for case in cases if tuple(case.values()) not in done]
    with ProcessPoolExecutor(given.jobs, mp_context=get_context("spawn")) as pool:
        for future in as_completed([pool.submit(played, case) for case in todo]):
            row = future.result()
            done[tuple(row[name] for name in cases[0])] = row
            if given.out is not None:
                with given.out.open("a") as lines:
                    lines.write(json.dumps(row) + "\n")
            print(*(row[name] for name in cases[0]), row["outcome"], *row["named"], file=sys.stderr, flush=True)
    print(table([done[tuple(case.values())] for case in cases]))


if __name__ == "__main__":
    main()
