"""How often hidden effects are found: every effect of a system hidden at several strengths, and sought.

    PYTHONPATH=tests python -m hidden.table four_dof --out /tmp/found.jsonl

writes a line a case (and goes on from those that are there), then prints the table. With `--laboratories 50` each case
has a laboratory of its own, drawn from its seed (see `hidden.drawn`), and so many cases of each kind are played:

    PYTHONPATH=tests python -m hidden.table four_dof --laboratories 50 --strengths 40
        --kinds none,one,two,absent,remainder,remainder_only --out /tmp/drawn.jsonl

What may be asked of the seeker:
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
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from hidden import drawn
from hidden.drawn import CLEAR, IN_RECORDS, PAIRS, UNLIKE
from hidden.hider import SYSTEMS, bench, hide
from hidden.laboratory import DRIFT
from hidden.motion import Refused
from hidden.seeker import seek

from calib.diagnosis.diagnose import Diagnosis

STRENGTHS = (8.0, 40.0)
PHI = 0.8  # correlation of the noise of every other case with nothing hidden
NEAR = 1.2  # misfit of the records held out, over that of a model which was told the effect


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
        "values": dict(hidden.values), "z": dict(hidden.z), "verdict": found.verdict, "said": found.summary,
        "causes": list(found.causes), "class": [list(names) for names in found.classes],
        "closest": [c.name for c in found.selection.causes] if found.selection else [],
        "threshold": found.selection.rounds[0].threshold if found.selection else None,
        "top": [[s.name, s.z, s.known_reduction] for s in suspects[:4]],
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


def safely(case: dict, play: Callable[[dict], dict]) -> dict:
    """Play a case; a bug in it is an answer too."""
    try:
        return play(case)
    except Exception:
        reason = traceback.format_exc()
        return {"effect": [], **case, "verdict": "failed", "reason": reason, "said": reason, "seconds": 0.0}


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


def line(row: dict) -> str:
    """One case in one line."""
    said = row.get("said") or row.get("reason", "").strip().splitlines()[-1]
    return " ".join([*row["effect"], str(row["strength"]), str(row["seed"]), row["verdict"], said[:110]])


def written(out: Path) -> list[dict]:
    """Rows of a file; a last line that was not written to its end is taken out."""
    text = out.read_text() if out.exists() else ""
    whole = text[: text.rfind("\n") + 1]
    if whole != text:
        out.write_text(whole)
    return [json.loads(line) for line in whole.splitlines()]


def all_played(wanted: list[dict], key: Callable, play: Callable, line: Callable, out: Path, jobs: int) -> list[dict]:
    """Rows of the wanted cases: those in the file, and those that are played now and written to it, side by side."""
    rows = written(out)
    done = {key(row) for row in rows}
    todo = [case for case in wanted if key(case) not in done]
    np.random.default_rng(0).shuffle(todo)
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool, out.open("a") as file:
        for future in as_completed([pool.submit(safely, case, play) for case in todo]):
            row = future.result()
            rows.append(row)
            file.write(json.dumps(row) + "\n")
            file.flush()
            print(line(row), file=sys.stderr, flush=True)
    asked = {key(case) for case in wanted}
    return [row for row in rows if key(row) in asked]


def main():
    """Play what is missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("simulator", choices=sorted(SYSTEMS))
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--cache", type=Path, default=Path(tempfile.gettempdir()) / "hidden")
    parser.add_argument("--kinds", default="one,none,two,absent")
    parser.add_argument("--strengths", default=",".join(f"{z:g}" for z in STRENGTHS))
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--nothing", type=int, default=50)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--laboratories", type=int, help="drawn, one a case: so many cases of each kind and strength")
    parser.add_argument("--first", type=int, default=0, help="seed of the first laboratory")
    parser.add_argument("--drift", type=float, default=1e6 * DRIFT, help="of free-running clocks [ppm]")
    parser.add_argument("--options", type=json.loads, default={}, help="of the system, in JSON")
    given = parser.parse_args()
    kinds, strengths = given.kinds.split(","), [float(z) for z in given.strengths.split(",")]
    if given.laboratories is None:
        wanted = cases(given.simulator, kinds, given.seeds, given.nothing, strengths, given.cache)
        play = functools.partial(played, cache=given.cache)
        print(table(all_played(wanted, key, play, line, given.out, given.jobs)))
        return
    seeds = range(given.first, given.first + given.laboratories)
    wanted = []
    for z in strengths:
        wanted += drawn.cases(given.simulator, kinds, seeds, z, 1e-6 * given.drift, given.options)
    wanted = list({drawn.key(case): case for case in wanted}.values())
    print(drawn.rates(all_played(wanted, drawn.key, drawn.played, drawn.line, given.out, given.jobs)))


if __name__ == "__main__":
    main()
