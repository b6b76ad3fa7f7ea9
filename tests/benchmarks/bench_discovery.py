"""How often a hidden force law is found as a free function, and how well: `calib discover` on laws of 25 kinds.

    PYTHONPATH=tests python tests/benchmarks/bench_discovery.py --cases 25 --nothing 10 --out /tmp/found.jsonl

writes a line a case (and goes on from those that are there), then prints the table. The cases are a Latin design: each
kind, each size (the level of the law over Omega^2 L, of which the oscillator's damping force is 0.04) and each noise
occurs as often as any other, in orders drawn from the seed. Records of the oscillator: two tones, a multisine from rest
and a free decay; another multisine is held out. Those of four_dof: its five tones with impacts, one of them held out.
All are integrated by scipy's DOP853. Scored for each case:

place      the body on which the law acts
arguments  those of the law: displacement, velocity, both
error      root mean square of the force found less the true one over that of the true one, over the states that the
           simulations of the records visit. What the calibrated stiffness and damping have taken is a part of the
           force: by their known change in the oscillator, by the best multiples of x and v in four_dof
formula    the same of the first formula where it predicts as well as the free function, which is written then
stated     the same of the force with its band: the formula and what the records add to it, where there is one, else the
           free function; and the share of the states at which the 95 % band covers the true law. Beside the law less
           what calibration absorbs
held out   misfit of the record held out (root mean square over the noise) over that of the model that was told: the
           true law as an effect whose level is free, fitted to the same records; by the free function and the formula
CPU s      of the search, calibration excluded

    PYTHONPATH=tests python tests/benchmarks/bench_discovery.py --peers

compares it with other methods on records with impacts: see `discovery_peers`.
"""

import argparse
import tempfile
import time
import warnings
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from benchmarks.discovery_peers import compared
from hidden.drawn import share
from hidden.foreign_laws import KINDS, SIZES, XV, Hidden, Written, hidden, system, written
from hidden.motion import Refused
from hidden.table import all_played

from calib.diagnosis.bench import Bench, Run
from calib.diagnosis.discovery.discover import discover
from calib.diagnosis.discovery.outcome import FOUND, NOTHING, Discovery
from calib.diagnosis.effort import Effort
from calib.diagnosis.fit import Fit
from calib.diagnosis.preparation import NotDiagnosable, bench_of, prepared
from calib.diagnosis.speculation import SpeculativePool
from calib.execution.pool import InProcess
from calib.report.formatting import HALF_WIDTH_ERRORS_95
from calib.store import Store
from calib.study import evaluate
from calib.study_file import StudyFile, load

Case = dict
MAX_ERROR, MAX_MISFIT_RATIO = 0.1, 1.3  # of a force that counts as found well  [1]
MAX_FORMULA_RATIO = 1.01  # of misfits on the record held out, up to which a formula predicts as well as the law  [1]


def cases(name: str, count: int, nothing: int, noises: list[float], seed: int) -> list[Case]:
    """Cases of a Latin design: every kind, size and noise as often as any other; then some without a law."""
    rng = np.random.default_rng(seed)
    kinds = _levels(list(KINDS), count, rng)
    sizes, levels = _levels(list(SIZES), count, rng), _levels(noises, count, rng)
    common = {"system": name, "design": seed}
    drawn = [
        {**common, "kind": kind, "size": size, "noise": noise, "seed": [seed, k]}
        for k, (kind, size, noise) in enumerate(zip(kinds, sizes, levels, strict=True))
    ]
    empty = [{**common, "kind": "", "size": 0.0, "noise": noises[k % len(noises)], "seed": [seed, 1000 + k]}
             for k in range(nothing)]  # fmt: skip
    return drawn + empty


def _levels(levels: list, count: int, rng: np.random.Generator) -> list:
    """Levels of a factor for so many cases, each as often as any other, in an order drawn by chance."""
    rounds = [rng.permutation(len(levels)) for _ in range(-(-count // len(levels)))]
    places = np.concatenate([np.zeros(0, dtype=int), *rounds])[:count]
    return [levels[k] for k in places]


def key(case: Case) -> tuple:
    """What tells a case from the others."""
    return (case["system"], case["kind"], case["size"], case["noise"], tuple(case["seed"]))


def played(case: Case) -> Case:
    """Hide a law, calibrate without it, search, and score what is found."""
    begin = time.process_time()
    law = hidden(case["system"], case["kind"], case["size"])
    with tempfile.TemporaryDirectory() as place, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            at = written(
                system(case["system"]), law, case["noise"], case["seed"][0] * 10_000 + case["seed"][1], Path(place)
            )
        except Refused as error:
            return {**case, "verdict": "refused", "said": str(error), "seconds": time.process_time() - begin}
        return {**case, **scored(at, law, case["system"]), "seconds": time.process_time() - begin}


def scored(at: Written, law: Hidden, name: str) -> Case:
    """Search for the law in the study, and compare with the truth."""
    file, values = calibrated(at)
    study = file.study
    begin = time.process_time()
    found = discover(study, file.others, values, file.suspects(), pool=InProcess)
    row: Case = {"verdict": found.verdict, "said": found.summary, "search_seconds": time.process_time() - begin,
                 "simulations": found.simulations, "excess": list(found.excess_chi2)}  # fmt: skip
    if found.chosen is not None:
        row |= {"body": found.chosen.body, "arguments": [list(a) for a in found.chosen.arguments],
                "rivals": list(found.rivals), "trials": _trials(found)}  # fmt: skip
        row |= {"formula": found.formula_trial and found.formula_trial.formula.text}
        if law.kind:
            x, v = found.states.x, found.states.v
            row |= {"error": error(found, law, name, x, v), "formula_error": formula_error(found, law, name, x, v)}
            row |= stated(found, law, x, v)
    if law.kind:
        row |= {"misfits": held_out_misfits(at, found, file, values, law, name)}
    return row


def calibrated(at: Written) -> tuple[StudyFile, dict[str, float]]:
    """Return the study, and its values after a calibration without the law."""
    file = load(at.folder)
    calibration = file.study.run(Store(at.folder / "out"), InProcess(partial(evaluate, file.study.without_search())))
    return file, {**file.study.space.fixed, **calibration.best.values}


def beside_peers(at: Written, law: Hidden, x: np.ndarray, v: np.ndarray) -> tuple[float | None, str]:
    """Error of the force that is found over states (n,), and what is said."""
    file, values = calibrated(at)
    found = discover(file.study, file.others, values, file.suspects(), pool=InProcess)
    return stated(found, law, x, v)["stated_error"], found.summary


def _trials(found: Discovery) -> list:
    """Arguments and predictive deviance of the models that were fitted."""
    return [[[list(a) for a in trial.arguments], None if trial.left_out is None else trial.left_out.deviance,
             trial.fitted.fit.chi2] for trial in found.trials]  # fmt: skip


def error(found: Discovery, law: Hidden, name: str, x: np.ndarray, v: np.ndarray) -> float | None:
    """Relative root mean square error of the free function over states (n,); None where another body is named."""
    chosen = found.chosen
    if chosen is None or chosen.body != law.body:
        return None
    force = chosen.fitted.model.matrix(x, v) @ chosen.fitted.coefficients
    return _relative_error(force, chosen.fitted.fit, law, name, x, v)


def formula_error(found: Discovery, law: Hidden, name: str, x: np.ndarray, v: np.ndarray) -> float | None:
    """Return the same of the formula; of the free function where no formula predicts as well."""
    trial = found.formula_trial
    if trial is None or found.chosen is None or found.chosen.body != law.body:
        return error(found, law, name, x, v)
    return _relative_error(trial.formula.values(x, v), trial.fit, law, name, x, v)


def stated(found: Discovery, law: Hidden, x: np.ndarray, v: np.ndarray) -> dict[str, float | None]:
    """Relative error of the force that is stated over states (n,), and share of them at which its 95 % band covers.

    Both beside the true law less the same linear functions, which calibration absorbs.
    """
    chosen = found.chosen
    if chosen is None or chosen.body != law.body:
        return {"stated_error": None, "covered": None}
    model, absorbed = chosen.fitted.model, chosen.fitted.smoothing.absorbed
    taken = np.linalg.pinv(model.visited @ absorbed) @ law.at(model.states.x, model.states.v)
    true = law.at(x, v)
    force, deviation = (found.partial_spline or chosen.fitted).surface(x, v)
    apart = force - true + model.matrix(x, v) @ absorbed @ taken
    covered = np.abs(apart) <= HALF_WIDTH_ERRORS_95 * deviation
    return {"stated_error": float(np.sqrt(np.mean(apart**2) / np.mean(true**2))), "covered": float(covered.mean())}


def _relative_error(force: np.ndarray, fit: Fit, law: Hidden, name: str, x: np.ndarray, v: np.ndarray) -> float:
    """Of a force (n,) beside the calibrated parameters of a fit."""
    true = law.at(x, v)
    rest = force - true
    if name == "oscillator":
        truth = system(name).truth
        for parameter, k in (("stiffness", 0), ("damping", 1)):
            rest = rest - (fit.value(parameter) - truth[parameter]) / truth["mass"] * (x, v)[k]
    else:
        linear = np.column_stack([x, v])
        rest = rest - linear @ np.linalg.lstsq(linear, rest, rcond=None)[0]
    return float(np.sqrt(np.mean(rest**2) / np.mean(true**2)))


def held_out_misfits(
    at: Written, found: Discovery, file: StudyFile, values: dict[str, float], law: Hidden, name: str
) -> dict[str, float | None]:
    """Misfit of the record held out by the calibrated model, the one that was found, and the one that was told."""
    bench = bench_of(file.study, file.others)
    with InProcess(bench) as open_pool, closing(SpeculativePool(open_pool, 0)) as ahead:
        pool = Effort(ahead, None, lambda done, foreseen: None)
        noise = [effect for effect in file.suspects() if effect.noise]
        ready = prepared(pool, bench, file.study, values, [law.effect, *noise], lambda text: None)
        if isinstance(ready, NotDiagnosable):
            return {}
        [told] = [candidate for candidate in ready.suspects if candidate.name == "hidden"]
        truth = {own: system(name).truth[own] for own in file.study.space.names}
        start = replace(ready.null.point, values={**ready.null.point.values, **truth})
        fit = ready.fitter.fit(start, [told], {"hidden_level": law.level})
        fits = {"null": ready.null, "told": fit, "found": found.chosen and found.chosen.fitted.fit,
                "formula": found.formula_trial and found.formula_trial.fit}  # fmt: skip
    level = {"told_level": fit.value("hidden_level") / law.level if "hidden_level" in fit.names else None}
    return {which: own and _misfit(bench, own, at) for which, own in fits.items()} | level


def _misfit(bench: Bench, fit: Fit, at: Written) -> float:
    """Root mean square, over the noise, of the residual of the record held out."""
    [name] = [name for name, reference in bench.objective.references.items() if reference.use == "holdout"]
    view = bench(Run(name, fit.point.values, fit.point.effects))
    if not view.usable:
        return float("inf")
    record, bodies = bench.objective.references[name].record, list(at.bodies)
    residuals = []
    for row, (body, channel) in zip(view.rows, bench.rows[name], strict=True):
        k = bodies.index(body)
        sigma = at.sigma[name][k + (channel == "velocity") * len(bodies), 0]
        trust = view.trust if channel == "velocity" else np.ones(row.size)
        residuals.append(((row - record[channel].sel(body=body).values) / sigma)[trust > 0.0])
    return float(np.sqrt(np.mean(np.concatenate(residuals) ** 2)))


# --- what is told ----------------------------------------------------------------------------------------------------


def right_arguments(row: Case) -> bool:
    """Whether the arguments of the law are those found."""
    found = {argument for own in row.get("arguments", []) for argument in own}
    return found == set(KINDS[row["kind"]].arguments)


def ratio(row: Case, which: str = "found") -> float | None:
    """Misfit of the record held out over that of the model that was told; where nothing was found, the calibrated."""
    misfits = row.get("misfits") or {}
    told, found = misfits.get("told"), misfits.get(which) or misfits.get("null")
    return found / told if told and found else None


def line(row: Case) -> str:
    """One case in one line."""
    law = f"{row['kind'] or 'nothing'} {row['size']:g} at {row['noise']:.1%}"
    if row["verdict"] in ("refused", "failed"):
        return f"{law}: {row['verdict']}: {(row.get('said') or row.get('reason', '')).strip().splitlines()[-1][:150]}"
    functions = " + ".join(f"f({', '.join(a[0] for a in own)})" for own in row.get("arguments", []))
    text = f"{law}: {row['verdict']} {functions.replace('d', 'x')}"
    if row.get("error") is not None:
        text += f", error {row['error']:.1%}"
    if row.get("stated_error") is not None:
        text += f", stated {row['stated_error']:.1%}, covered {row['covered']:.0%}"
    if row.get("formula"):
        text += f", {row['formula']}"
        if row.get("formula_error") is not None:
            text += f": {row['formula_error']:.1%}"
    if ratio(row) is not None:
        text += f", held out {ratio(row):.2f} times"
    return f"{text} ({row.get('search_seconds', 0.0):.0f} s)"


def table(rows: list[Case]) -> str:
    """Cases one by one, and rates with their 95 % bounds."""
    played_rows = [row for row in rows if row["verdict"] not in ("refused", "failed")]
    empty = [row for row in played_rows if not row["kind"]]
    order = ["", *KINDS]
    lines = [line(row) for row in sorted(rows, key=lambda row: (order.index(row["kind"]), row["size"]))]
    for noise in sorted({row["noise"] for row in played_rows}):
        lines += ["", *_rates([row for row in played_rows if row["kind"] and row["noise"] == noise], noise)]
    if empty:
        silent = sum(row["verdict"] == NOTHING for row in empty)
        lines.append(f"nothing found where nothing is hidden {share(silent, len(empty))}")
    seconds = sorted(row["search_seconds"] for row in played_rows)
    if seconds:
        middle, whole = np.median(seconds), sum(seconds)
        lines.append(f"CPU s of a search: median {middle:.0f}, longest {seconds[-1]:.0f}, in all {whole:.0f}")
    return "\n".join([*lines, f"failed or refused {len(rows) - len(played_rows)}"])


def _rates(rows: list[Case], noise: float) -> list[str]:
    """Rates of the cases of one noise."""
    count = len(rows)
    places = [row.get("body") == hidden(row["system"], row["kind"], row["size"]).body for row in rows]
    arguments = [right_arguments(row) for row in rows]
    errors = [np.inf if row.get("error") is None else row["error"] for row in rows]
    well = [error < MAX_ERROR for error in errors]
    written_well = [(row.get("formula_error") or np.inf) < MAX_ERROR for row in rows]
    stated_well = [(row.get("stated_error") or np.inf) < MAX_ERROR for row in rows]
    covered = [row["covered"] for row in rows if row.get("covered") is not None]
    as_well = [bool(row.get("formula")) and (ratio(row, "formula") or np.inf) <= MAX_FORMULA_RATIO for row in rows]
    ratios = [own for own in map(ratio, rows) if own is not None]
    near = sum(own <= MAX_MISFIT_RATIO for own in ratios)
    lines = [
        f"noise {noise:.1%}: a force found {share(sum(row['verdict'] == FOUND for row in rows), count)}",
        f"  right place {share(sum(places), count)}",
        f"  right arguments {share(sum(arguments), count)}",
        f"  error below {MAX_ERROR:.0%} {share(sum(well), count)}",
        f"  error of the force that is stated below {MAX_ERROR:.0%} {share(sum(stated_well), count)}",
        f"  error of what is written below {MAX_ERROR:.0%} {share(sum(written_well), count)}",
        f"  held out within {MAX_MISFIT_RATIO} times {share(near, len(ratios))}",
        f"  a formula predicts as well as the law, to {MAX_FORMULA_RATIO - 1.0:.0%} {share(sum(as_well), count)}",
    ]
    if covered:
        lines.append(f"  95 % bands cover the law at {np.mean(covered):.0%} of states, median {np.median(covered):.0%}")
    for size in SIZES:
        own = [k for k, row in enumerate(rows) if row["size"] == size]
        counts = [f"{sum(some[k] for k in own)} of {len(own)}" for some in (arguments, well)]
        lines.append(f"  size {size:g}: right arguments {counts[0]}, error below {MAX_ERROR:.0%} {counts[1]}")
    for functions in (("displacement",), ("velocity",), XV):
        own = [k for k, row in enumerate(rows) if KINDS[row["kind"]].arguments == functions]
        counts = [f"{sum(some[k] for k in own)} of {len(own)}" for some in (arguments, well)]
        what = " and ".join(functions)
        lines.append(f"  law of {what}: right arguments {counts[0]}, error below {MAX_ERROR:.0%} {counts[1]}")
    return lines


def main():
    """Play what is missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--cases", type=int, default=24)
    parser.add_argument("--nothing", type=int, default=10, help="cases without a law")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--noise", default="0.01", help="relative to the rms of a channel; several, with commas")
    parser.add_argument("--system", default="oscillator", choices=["oscillator", "four_dof"])
    parser.add_argument("--out", type=Path, default=Path(tempfile.gettempdir()) / "discovery.jsonl")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--peers", action="store_true", help="compare with other methods, on records with impacts")
    given = parser.parse_args()
    if given.peers:
        compared(given.seed, beside_peers)
        return
    wanted = cases(given.system, given.cases, given.nothing, [float(n) for n in given.noise.split(",")], given.seed)
    print(table(all_played(wanted, key, played, line, given.out, given.jobs)))


if __name__ == "__main__":
    main()
