"""How often hidden effects are found: every effect of a system hidden at several strengths, and sought.

    PYTHONPATH=tests python -m hidden.table four_dof --out /tmp/found.jsonl

writes a line a case (and goes on from those that are there), then prints the table. What may be asked of the seeker:
the truth in its class in 95 % of the cases; the one right name in 75 % at z >= 8 and 90 % at z >= 40, of effects that
the records tell from every other (|cos| < 0.9); "unexplained" in 90 % where the effect is not in the library, and no
other is like it (|cos| < 0.7: more is half of what there is to explain, which is to be named); both of two effects in
80 %; 5 false alarms in 100 where nothing is hidden; a misfit on the records held out that is at most 20 % above that of
a model which was told what is hidden.
"""

import argparse
import functools
import json
import sys
import tempfile
import time
import traceback
import warnings
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from hidden.hider import bench, hide
from hidden.motion import Refused
from hidden.seeker import seek

from calib.diagnosis.diagnose import OUTLIERS, QUANTISATION, Diagnosis

STRENGTHS = (8.0, 40.0)
PHI = 0.8  # correlation of the noise of every other case with nothing hidden
CLEAR = 0.9  # |cos| after calibration above which two effects are not to be told apart
UNLIKE = 0.7  # |cos| below which no other effect explains half of what one does, which is what naming asks for
IN_RECORDS = (OUTLIERS, QUANTISATION)  # seen in the samples themselves, not in what a model leaves
NEAR = 1.2  # misfit of the records held out, over that of a model which was told the effect
PAIRS = {
    "four_dof": (("quadratic_drag", "gap_offset"), ("cubic_stiffness", "channel_lag"), ("preload", "linear_drag")),
    "oscillator": (
        ("cubic_stiffness", "coulomb_friction"), ("quadratic_drag", "channel_lag"), ("preload", "softening"),
    ),
}


def cases(
    simulator: str, kinds: list[str], seeds: int, nothing: int, strengths: list[float], cache: Path
) -> list[dict]:
    """What is hidden, each as the arguments of `played`."""
    found = []
    effects = bench(simulator, cache).system.effects
    if "one" in kinds:
        found += [
            {"simulator": simulator, "kind": "one", "effect": [name], "strength": z, "seed": seed}
            for name in effects for z in strengths for seed in range(seeds)
        ]  # fmt: skip
    if "none" in kinds:
        found += [
            {"simulator": simulator, "kind": "none", "effect": [], "strength": 0.0, "seed": n, "phi": PHI * (n % 2)}
            for n in range(nothing)
        ]  # fmt: skip
    if "two" in kinds:
        found += [
            {"simulator": simulator, "kind": "two", "effect": list(pair), "strength": 40.0, "seed": seed}
            for pair in PAIRS[simulator] for seed in range(seeds)
        ]  # fmt: skip
    if "absent" in kinds:
        found += [
            {"simulator": simulator, "kind": "absent", "effect": [name], "strength": 80.0, "seed": seed}
            for name in effects if name not in IN_RECORDS and 0.0 < _nearest(simulator, cache, name)[1] < UNLIKE
            for seed in range(seeds)
        ]  # fmt: skip
    return found


def played(case: dict, cache: Path) -> dict:
    """Hide and seek once."""
    begin = time.process_time()
    effect = tuple(case["effect"]) or None
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            hidden = hide(
                case["simulator"], effect, case["strength"] or None, case["seed"], phi=case.get("phi", 0.0),
                folder=Path(folder), cache=cache,
            )  # fmt: skip
        except Refused as error:
            return {**case, "verdict": "refused", "reason": str(error)}
        found = seek(Path(folder), without=tuple(case["effect"]) if case["kind"] == "absent" else ())
        ratio = _beside_the_told(Path(folder), found, effect) if case["kind"] in ("one", "two") else None
    clear = {"nearest": list(_nearest(case["simulator"], cache, case["effect"][0]))} if len(case["effect"]) == 1 else {}
    suspects = [] if found.selection is None else found.selection.rounds[0].suspects
    return {
        **case, **clear,
        "values": dict(hidden.values), "z": dict(hidden.z), "verdict": found.verdict, "said": found.said,
        "causes": list(found.causes), "class": [list(names) for names in found.classes],
        "closest": [c.name for c in found.selection.causes] if found.selection else [],
        "threshold": found.selection.rounds[0].threshold if found.selection else None,
        "top": [[s.name, s.z, s.drop] for s in suspects[:4]],
        "ratio": ratio, "seconds": time.process_time() - begin,
    }  # fmt: skip


def _beside_the_told(folder: Path, found: Diagnosis, effects: tuple[str, ...]) -> float | None:
    """Misfit of the records held out, over that of a model which was told the effects; None where that misses them."""
    if set(found.causes) == set(effects):
        return 1.0
    told = seek(folder, only=effects)
    if told.gain is None:
        return None
    return (found.gain.after if found.gain else told.gain.before) / told.gain.after


@functools.cache
def _cosines(simulator: str, cache: Path) -> tuple[tuple[str, ...], np.ndarray]:
    at = bench(simulator, cache)
    effects = tuple(e for e in at.system.effects if e not in ("outliers", *_absorbed(simulator, cache)))
    return effects, at.cosines(effects)


@functools.cache
def _absorbed(simulator: str, cache: Path) -> tuple[str, ...]:
    """Effects that calibration absorbs."""
    at, found = bench(simulator, cache), []
    for effect in at.system.effects:
        if effect != "outliers":
            try:
                at.size_for(effect, STRENGTHS[0])
            except Refused:
                found.append(effect)
    return tuple(found)


def _nearest(simulator: str, cache: Path, effect: str) -> tuple[str, float]:
    """Return the effect that imitates this one best after calibration, and |cos| between them."""
    effects, cosines = _cosines(simulator, cache)
    if effect not in effects:
        return "", 0.0
    row = np.nan_to_num(cosines[effects.index(effect)])
    row[effects.index(effect)] = 0.0
    return effects[int(row.argmax())], float(row.max())


def safely(case: dict, cache: Path) -> dict:
    """Play a case; a bug in it is an answer too."""
    try:
        return played(case, cache)
    except Exception:
        return {**case, "verdict": "failed", "reason": traceback.format_exc()}


def key(case: dict) -> tuple:
    """What tells a case from the others."""
    return (case["simulator"], case["kind"], *case["effect"], case["strength"], case["seed"])


def table(rows: list[dict]) -> str:
    """Rates, as text."""
    lines = []
    none = [r for r in rows if r["kind"] == "none"]
    if none:
        alarms = sum(r["verdict"] != "none" for r in none)
        lines.append(f"nothing hidden: {alarms} false alarms of {len(none)}")
    one = [r for r in rows if r["kind"] == "one" and r["verdict"] not in ("refused",)]
    for strength in sorted({r["strength"] for r in one}):
        group = [r for r in one if r["strength"] == strength]
        told = [r for r in group if r["nearest"][1] < CLEAR]
        right = sum(r["causes"] == r["effect"] for r in told)
        inside = sum(r["effect"] in r["class"] for r in group)
        seen = sum(r["verdict"] in ("named", "one_of", "unexplained") for r in group)
        lines.append(
            f"z = {strength:g}: found {seen}/{len(group)}, in the class {_share(inside, len(group))}, "
            f"one right name {_share(right, len(told))} of those that the records tell apart"
        )
    ratios = [r["ratio"] for r in rows if r.get("ratio")]
    if ratios:
        near = sum(ratio <= NEAR for ratio in ratios)
        lines.append(f"held out: within {NEAR - 1.0:.0%} of the model that was told {_share(near, len(ratios))}")
    two = [r for r in rows if r["kind"] == "two" and r["verdict"] != "refused"]
    if two:
        both = sum(set(r["effect"]) in (set(r["causes"]), *map(set, r["class"])) for r in two)
        lines.append(f"two: both found {_share(both, len(two))}")
    absent = [r for r in rows if r["kind"] == "absent" and r["verdict"] != "refused"]
    if absent:
        unexplained = sum(r["verdict"] == "unexplained" for r in absent)
        lines.append(f"absent, and no other like it: called unexplained {_share(unexplained, len(absent))}")
    failed = [r for r in rows if r["verdict"] == "failed"]
    refused = sorted({r["effect"][0] for r in rows if r["verdict"] == "refused"})
    lines.append(f"failed {len(failed)}; not hideable at some strength: {', '.join(refused) or 'none'}")
    return "\n".join(lines)


def _share(part: int, whole: int) -> str:
    return f"{part}/{whole} ({part / max(1, whole):.0%})"


def main():
    """Play what is missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("simulator", choices=["four_dof", "oscillator"])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--cache", type=Path, default=Path(tempfile.gettempdir()) / "hidden")
    parser.add_argument("--kinds", default="one,none,two,absent")
    parser.add_argument("--strengths", default=",".join(f"{z:g}" for z in STRENGTHS))
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--nothing", type=int, default=50)
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    rows = [json.loads(line) for line in given.out.read_text().splitlines()] if given.out.exists() else []
    done = {key(row) for row in rows}
    strengths = [float(z) for z in given.strengths.split(",")]
    wanted = cases(given.simulator, given.kinds.split(","), given.seeds, given.nothing, strengths, given.cache)
    todo = [case for case in wanted if key(case) not in done]
    rng = np.random.default_rng(0)
    rng.shuffle(todo)
    with ProcessPoolExecutor(given.jobs, mp_context=get_context("spawn")) as pool, given.out.open("a") as out:
        for future in as_completed([pool.submit(safely, case, given.cache) for case in todo]):
            row = future.result()
            rows.append(row)
            out.write(json.dumps(row) + "\n")
            out.flush()
            said = row.get("said") or row.get("reason", "").strip().splitlines()[-1]
            print(*row["effect"], row["strength"], row["seed"], row["verdict"], said[:110], file=sys.stderr)
    asked = {key(case) for case in wanted}
    print(table([row for row in rows if key(row) in asked]))


if __name__ == "__main__":
    main()
