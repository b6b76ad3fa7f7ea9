"""Cases in laboratories that are drawn by chance, and how often the seeker is right in them."""

import time
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from hidden.hider import SYSTEMS, Hidden, bench, hide
from hidden.information import Bench
from hidden.laboratory import Laboratory
from hidden.motion import Refused
from hidden.remainder import expressed_by
from hidden.seeker import seek
from scipy.stats import binomtest

from calib.diagnosis.diagnose import Diagnosis
from calib.diagnosis.excess import excess_chi2
from calib.diagnosis.suspect import Refitted

KINDS = ("none", "one", "two", "absent", "remainder", "remainder_only")
EMPTY = ("none", "remainder_only")  # kinds without an effect of the library
SHARES = (0.005, 0.02, 0.05)  # of the motion that a remainder makes
OVER_REMAINDER = (2.0, 5.0)  # z of an effect over that of the remainder beside it: 4 to 25 times its chi-square
PAIRS = {
    "four_dof": (("quadratic_drag", "gap_offset"), ("cubic_stiffness", "channel_lag"), ("preload", "linear_drag")),
    "oscillator": (
        ("cubic_stiffness", "coulomb_friction"), ("quadratic_drag", "channel_lag"), ("preload", "softening"),
    ),
}  # fmt: skip
IN_RECORDS = ("outliers", "quantisation")  # seen in the samples themselves, not in what a model leaves
FOUND = ("named", "one_of", "unexplained")
CLEAR = 0.9  # |cos| after calibration above which two effects are not to be told apart
UNLIKE = 0.7  # |cos| below which no other effect explains half of what one does; naming asks for two thirds
SURE = 1.96  # standard errors on each side of a 95 % interval
CLEARLY = 3.0  # chi-square that an effect explains, over what remains, from which it has to be found
OFF = 3.0  # standard errors by which a size may be off

Case = dict[str, object]


def cases(
    simulator: str, kinds: list[str], seeds: range, strength: float, drift: float, options: Mapping
) -> list[Case]:
    """Return the cases of some kinds, one a seed.

    Parameters
    ----------
    strength : z of each hidden effect; beside a remainder at least twice to five times that of the remainder
    drift : of free-running clocks  [1]
    options : of the system
    """
    common = {"simulator": simulator, "options": dict(options), "drift": drift}
    return [
        {**common, "kind": kind, "seed": seed, "strength": 0.0 if kind in EMPTY else strength}
        for seed in seeds for kind in kinds
    ]  # fmt: skip


def key(case: Case) -> tuple:
    """What tells a case from the others."""
    options = tuple(sorted(case["options"].items()))
    return (case["simulator"], options, case["kind"], case["seed"], case["strength"], case["drift"])


def played(case: Case) -> Case:
    """Hide and seek once, in the laboratory of the case's seed."""
    begin = time.monotonic()
    with TemporaryDirectory() as place, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        folder = Path(place)
        system = SYSTEMS[case["simulator"]](**case["options"])
        laboratory = Laboratory.drawn(case["seed"], system, case["drift"])
        try:
            effects, hidden = _hidden(case, laboratory, folder)
        except Refused as error:
            return {**case, "effect": [], "verdict": "refused", "said": str(error), "seconds": time.monotonic() - begin}
        at = bench(case["simulator"], folder / "clean", laboratory=laboratory, **case["options"])
        drift = hidden.laboratory["clock"]["drift"]
        seen = at.drift_z(drift) if drift else 0.0
        nearest = _nearest(at, effects[0]) if case["kind"] in ("one", "absent", "remainder") else None
        if case["kind"] == "remainder_only":
            nearest = list(expressed_by(at, hidden.remainder_values, 1))
        found = seek(folder, without=effects if case["kind"] == "absent" else ())
    return {
        **case, "effect": list(effects), "values": dict(hidden.values), "z": dict(hidden.z),
        "remainder": hidden.remainder, "laboratory": hidden.laboratory, "drift_z": seen, "nearest": nearest,
        "verdict": found.verdict, "said": found.summary, "causes": list(found.causes),
        "class": [list(names) for names in found.classes], "sizes": _sizes(found, effects, hidden.values),
        "over": _over_what_remains(found, effects) if case["kind"] == "remainder" else None,
        "seconds": time.monotonic() - begin,
    }  # fmt: skip


def _hidden(case: Case, laboratory: Laboratory, folder: Path) -> tuple[tuple[str, ...], Hidden]:
    """Hide the first effects, in an order drawn by chance, that can be hidden.

    Raises
    ------
    Refused : none can
    """
    rng, refusal = np.random.default_rng([case["seed"], KINDS.index(case["kind"])]), None
    share = SHARES[case["seed"] % len(SHARES)] if case["kind"].startswith("remainder") else None
    over = float(np.random.default_rng([case["seed"], len(KINDS)]).uniform(*OVER_REMAINDER))
    for effects in _tries(case, rng):
        try:
            return effects, hide(
                case["simulator"], effects or None, case["strength"] or None, case["seed"], folder=folder,
                cache=folder / "clean", laboratory=laboratory, remainder=share, over_remainder=over,
                **case["options"],
            )  # fmt: skip
        except Refused as reason:
            refusal = reason
    raise refusal


def _tries(case: Case, rng: np.random.Generator) -> Iterator[tuple[str, ...]]:
    """Effects that may be hidden in a case, in an order drawn by chance."""
    if case["kind"] in EMPTY:
        return iter([()])
    if case["kind"] == "two":
        return (tuple(pair) for pair in rng.permutation(PAIRS[case["simulator"]]).tolist())
    effects = SYSTEMS[case["simulator"]](**case["options"]).effects
    known = [name for name in effects if name not in (IN_RECORDS if case["kind"] == "absent" else ("outliers",))]
    return ((name,) for name in rng.permutation(known).tolist())


def _nearest(at: Bench, effect: str) -> list | None:
    """Effect that imitates this one best after calibration, and |cos| between them; None where that is not known."""
    effects = tuple(name for name in at.system.effects if name != "outliers")
    try:
        row = np.nan_to_num(at.cosines(effects)[effects.index(effect)])
    except Refused:
        return None
    row[effects.index(effect)] = 0.0
    return [effects[int(row.argmax())], float(row.max())]


def _over_what_remains(found: Diagnosis, effects: tuple[str, ...]) -> float | None:
    """Chi-square that a hidden effect explains to the seeker, over the excess beside it; None: it was not fitted."""
    if found.selection is None or len(effects) != 1:
        return None
    suspects = [s for s in found.selection.rounds[0].suspects if s.name == effects[0] and isinstance(s, Refitted)]
    if not suspects:
        return None
    best = max(suspects, key=lambda s: s.chi2_reduction)
    return best.chi2_reduction / max(1.0, excess_chi2(found.evidence, best.fit))


def _sizes(found: Diagnosis, effects: tuple[str, ...], values: Mapping[str, float]) -> dict[str, list[float]]:
    """True value, estimate and its standard error of each parameter of a hidden effect that is in the class [SI].

    The error counts what remains beside the noise, which may bias the estimate.
    """
    selection = found.selection
    if selection is None or not found.classes:
        return {}
    suspects = {s.name: s for alike in selection.alternatives for s in alike if s.name in effects}
    return {
        name: [values[name], float(size), float(np.hypot(error, selection.bias_std(suspect.fit, name)))]
        for suspect in suspects.values()
        for name, size, error in zip(suspect.candidate.free, suspect.size, suspect.error, strict=True)
        if name in values
    }


# --- what is told ----------------------------------------------------------------------------------------------------


def line(row: Case) -> str:
    """One case in one line."""
    truth = "+".join(row["effect"]) or "nothing"
    truth += f" + {SHARES[row['seed'] % len(SHARES)]:.1%} {row['remainder']}" if row.get("remainder") else ""
    if "laboratory" not in row:
        return f"{row['kind']} {row['seed']}: {truth} -> {row['verdict']}: {row['said'].strip().splitlines()[-1][:120]}"
    clock, noise = row["laboratory"]["clock"], row["laboratory"]["noise"]
    about = f"free, drift z {row['drift_z']:.1f}" if clock["free"] else "in step"
    about += f", noise {noise['level']:.1%} {noise['colour']}{' stated' if noise['stated'] else ''}"
    classes = " | ".join("+".join(names) for names in row["class"])
    answer = f"{row['verdict']} [{classes}]" if classes else f"{row['verdict']}: {row['said'][:120]}"
    return f"{row['simulator']} {row['kind']} {row['seed']} ({about}): {truth} -> {answer} ({row['seconds']:.0f} s)"


def share(part: int, whole: int) -> str:
    """Share with the 95 % bounds of Clopper and Pearson (Biometrika 26 (1934) 404)."""
    if not whole:
        return "0/0"
    bounds = binomtest(part, whole).proportion_ci(method="exact")
    return f"{part}/{whole} = {part / whole:.0%} ({bounds.low:.0%} to {bounds.high:.0%})"


def rates(rows: list[Case]) -> str:
    """Rates of all kinds, and of those in step and on free-running clocks alone, as text."""
    played_rows = [row for row in rows if "laboratory" in row]
    lines = []
    for kind in KINDS:
        of_kind = [row for row in played_rows if row["kind"] == kind]
        free = [row["laboratory"]["clock"]["free"] for row in of_kind]
        clocks = {
            "all": of_kind,
            "in step": [row for row, f in zip(of_kind, free, strict=True) if not f],
            "free": [row for row, f in zip(of_kind, free, strict=True) if f],
        }
        lines += [f"{kind}, {name}: {text}" for name, own in clocks.items() if own for text in _told(kind, own)]
    lost = {verdict: sum(row["verdict"] == verdict for row in rows) for verdict in ("failed", "refused")}
    seconds = sorted(row["seconds"] for row in played_rows)
    lines.append(f"failed {lost['failed']}, refused {lost['refused']}")
    if seconds:
        lines.append(f"seconds a case: median {seconds[len(seconds) // 2]:.0f}, longest {seconds[-1]:.0f}")
    return "\n".join(lines)


def _told(kind: str, rows: list[Case]) -> list[str]:
    """Rates of the cases of one kind."""
    whole = len(rows)
    verdict = [row["verdict"] for row in rows]
    no_diagnosis = f"no diagnosis {share(verdict.count('not_diagnosable'), whole)}"
    if kind == "none":
        return [f"false alarms {share(sum(v in FOUND for v in verdict), whole)}; {no_diagnosis}"]
    if kind in ("absent", "remainder_only"):
        wrong = sum(v in ("named", "one_of") for v in verdict)
        unlike = [row["verdict"] for row in rows if row["nearest"] and row["nearest"][1] < UNLIKE]
        return [
            f"unexplained {share(verdict.count('unexplained'), whole)}; a cause named that is none "
            f"{share(wrong, whole)}; {no_diagnosis}",
            *([f"like no other: unexplained {share(unlike.count('unexplained'), len(unlike))}"] if unlike else []),
        ]
    hidden_by_it = [row for row in rows if (row.get("over") or CLEARLY) < CLEARLY]
    rows = [row for row in rows if row not in hidden_by_it]
    whole, verdict = len(rows), [row["verdict"] for row in rows]
    inside = sum(set(row["effect"]) in map(set, row["class"]) for row in rows)
    named = sum(set(row["causes"]) == set(row["effect"]) for row in rows)
    other = sum(bool(row["class"]) and set(row["effect"]) not in map(set, row["class"]) for row in rows)
    apart = [row for row in rows if row["nearest"] and row["nearest"][1] < CLEAR]
    alone = sum(row["causes"] == row["effect"] for row in apart)
    sizes = [abs(size - truth) / error for row in rows for truth, size, error in row["sizes"].values() if error > 0.0]
    return [
        f"truth in the class {share(inside, whole)}; named singly {share(named, whole)}, of those that "
        f"the records tell apart {share(alone, len(apart))}; a class without the truth "
        f"{share(other, whole)}; {no_diagnosis}",
        f"sizes within {OFF:g} standard errors {share(sum(s <= OFF for s in sizes), len(sizes))}; "
        f"covered by their 95 % interval {share(sum(s <= SURE for s in sizes), len(sizes))}",
        *([f"without {len(hidden_by_it)} that explain less than {CLEARLY:g} times what remains, of which "
           f"{sum(bool(r['class']) and set(r['effect']) not in map(set, r['class']) for r in hidden_by_it)} named "
           "otherwise"] if hidden_by_it else []),
    ]  # fmt: skip
