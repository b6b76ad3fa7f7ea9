"""What a plant has and no two effects of the library express: the model of the seeker stays wrong by that much."""

import itertools
from collections.abc import Mapping

import numpy as np
from hidden.causes import scale
from hidden.information import Bench
from hidden.motion import Refused

from calib.diagnosis.criteria import CRITERIA

POWERS = {  # of metre and second, of the parameter that makes the size of a kind
    "second_stop": (-0.5, -2), "quintic": (-4, -2), "parametric": (0, -2), "magnet": (1, -2), "cogging": (1, -2),
    "valve": (-1, -1), "coupling": (-2, -2), "wave": (1, 0),
    "thicker_layer": (0, 0),
}  # fmt: skip
LEAST = CRITERIA.min_over_remainder
EXPRESSED = float(np.sqrt(LEAST / (1.0 + LEAST)))  # |cos| after calibration from which effects may be named for it
DRAWS = 12  # of a kind and its shape, until no two effects express it
FIRST = 1e-3  # size that is tried first, in natural scales
CLOSE = 0.03  # of the wanted share
ROUNDS = 24


def remainder(at: Bench, share: float, seed: int) -> tuple[str, dict[str, float]]:
    """Draw a kind, and a shape of it, that the plant can have with this share of the motion and no two effects express.

    Returns
    -------
    The kind, and its parameters by name, SI

    Raises
    ------
    Refused : none of those that were drawn is such
    """
    rng, refusal = np.random.default_rng([seed, 5]), None
    for _ in range(DRAWS):
        kind = str(rng.choice(at.system.remainders))
        try:
            values = scaled(at, kind, share, rng)
            name, cosine = expressed_by(at, values)
        except Refused as reason:
            refusal = reason
            continue
        if cosine < EXPRESSED:
            return kind, values
        refusal = Refused(f"{name} express {kind!r} (|cos| = {cosine:.2f})")
    raise refusal


def expressed_by(at: Bench, values: Mapping[str, float], number: int = 2) -> tuple[str, float]:
    """Effects, so many together, that imitate these hidden parameters best after calibration, and |cos| between."""
    effects = [name for name in at.system.effects if name != "outliers"]
    together = list(itertools.combinations(effects, number))
    cosines = np.nan_to_num(at.imitations(values, together))
    return " and ".join(together[int(cosines.argmax())]), float(cosines.max())


def scaled(at: Bench, kind: str, share: float, rng: np.random.Generator) -> dict[str, float]:
    """Parameters of a remainder that changes the records by this share, see `change`; its shape is drawn.

    Raises
    ------
    Refused : there is no such size
    """
    size, low, high = FIRST, 0.0, np.inf
    shape = drawn_shape(at, kind, rng)
    for _ in range(ROUNDS):
        values = {kind: size * scale(at.system, POWERS[kind]), **shape}
        try:
            reached = change(at, values)
        except Refused:
            reached = np.inf
        if abs(reached - share) < CLOSE * share:
            return values
        low, high = (size, high) if reached < share else (low, size)
        ahead = size * np.clip(share / max(reached, 1e-9), 0.05, 20.0)
        size = ahead if low < ahead < high else 0.5 * (low + high)
    raise Refused(f"{kind!r} cannot make {share:.1%} of the motion of {at.system.name}")


def change(at: Bench, values: Mapping[str, float]) -> float:
    """Change of the records at the truth, over their rms: root mean square over all channels of all records.

    Velocities next to an impact are left out: which sample jumps is chance.

    Raises
    ------
    Refused : the motion is none that a record can be made of
    """
    shares = []
    for plan in at.system.plans:
        before, after = at.clean(plan), at.clean(plan, values)
        changed = after.rows - before.rows
        changed[len(changed) // 2 :, at.blind(plan, np.concatenate([before.impacts, after.impacts]))] = 0.0
        shares += ((changed**2).mean(axis=1) / (before.rows**2).mean(axis=1)).tolist()
    return float(np.sqrt(np.mean(shares)))


def drawn_shape(at: Bench, kind: str, rng: np.random.Generator) -> dict[str, float]:
    """Parameters of a remainder beside its size: where it acts, relative to the first record's motion, and how fast."""
    reached = float(np.abs(at.clean(at.system.plans[0]).rows[len(at.system.measured) - 1]).max())
    if kind == "second_stop":
        return {"stop_place": reached * rng.uniform(0.3, 0.9)}
    if kind == "magnet":
        place = reached * rng.uniform(0.2, 0.7) * rng.choice([-1.0, 1.0])
        return {"magnet_place": place, "magnet_width": reached * rng.uniform(0.1, 0.25)}
    if kind == "cogging":
        return {"cogging_pitch": reached * rng.uniform(0.3, 1.2)}
    if kind == "parametric":
        return {"parametric_order": float(rng.integers(1, 4))}
    if kind == "wave":
        return {"wave_order": float(rng.uniform(2.0, 8.0)), "full": 1.0}
    if kind == "thicker_layer":
        return {"full": 1.0}
    return {}
