"""What a plant has and no candidate of the library can express: the model of the seeker stays wrong by that much."""

from collections.abc import Mapping

import numpy as np
from hidden.causes import scale
from hidden.information import Bench
from hidden.motion import Refused

KINDS = {
    "oscillator": ("second_stop", "quintic", "parametric"),
    "four_dof": ("second_stop", "quintic", "parametric", "coupling"),
}
FIRST = 1e-3  # size that is tried first, in natural scales
CLOSE = 0.03  # of the wanted share
ROUNDS = 24
REACH = 0.5  # of the amplitude of the first record, where the second stop stands


def remainder(at: Bench, share: float, seed: int) -> tuple[str, dict[str, float]]:
    """Draw a kind that the plant can have with this share of the motion; return it with its parameters, SI.

    Raises
    ------
    Refused : no kind leaves a motion that a record can be made of
    """
    refusal = None
    for kind in np.random.default_rng([seed, 5]).permutation(KINDS[at.system.name]).tolist():
        try:
            return kind, scaled(at, kind, share)
        except Refused as reason:
            refusal = reason
    raise refusal


def scaled(at: Bench, kind: str, share: float) -> dict[str, float]:
    """Parameters of a remainder that changes the records by this share, see `change`.

    Raises
    ------
    Refused : there is no such size
    """
    size, low, high = FIRST, 0.0, np.inf
    for _ in range(ROUNDS):
        values = parameters(at, kind, size)
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


def parameters(at: Bench, kind: str, size: float) -> dict[str, float]:
    """Parameters of a remainder of that size in natural scales, SI."""
    system = at.system
    if kind == "second_stop":
        body = at.clean(system.plans[0]).rows[len(system.measured) - 1]
        return {"stop_stiffness": size * scale(system, (-0.5, -2)), "stop_place": REACH * float(np.abs(body).max())}
    name, power = {"quintic": ("k5", -4), "parametric": ("parametric", 0), "coupling": ("coupling", -2)}[kind]
    return {name: size * scale(system, (power, -2))}
