"""Records with an effect hidden in them, and a study that seeks it."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import ceil
from pathlib import Path
from typing import NamedTuple

import numpy as np
from hidden import beam, four_dof, oscillator
from hidden.information import Bench
from hidden.laboratory import Laboratory
from hidden.motion import Refused
from hidden.noise import coloured
from hidden.remainder import EXPRESSED
from hidden.remainder import remainder as drawn_remainder
from hidden.sensors import CONVERTER, converted
from hidden.system import Plan

from calib.records import make, write

FAR = 20.0  # of an outlier from its place, over the noise
LEAST_OVER_REMAINDER = 3.0**0.5  # z of an effect over that of a remainder beside it: three times its chi-square
SYSTEMS = {"four_dof": four_dof.system, "oscillator": oscillator.system, "delaminated_beam": beam.system}


class Hidden(NamedTuple):
    """A study with what its seeker must not see.

    Attributes
    ----------
    folder : with the records and study.toml
    values : parameters of the hidden effects by name, SI
    z : of each hidden effect alone, by name; NaN for outliers
    laboratory : that was drawn, as `Laboratory.facts`; empty where none was
    remainder : kind of what no candidate expresses; empty where there is none
    remainder_values : its parameters by name, SI
    """

    folder: Path
    values: Mapping[str, float]
    z: Mapping[str, float]
    laboratory: Mapping[str, object] = {}
    remainder: str = ""
    remainder_values: Mapping[str, float] = {}


def bench(
    simulator: str,
    cache: Path,
    noise: float = 0.01,
    phi: float = 0.0,
    nuisance: Sequence[str] = (),
    laboratory: int | Laboratory | None = None,
    **options,
) -> Bench:
    """Return the system of a simulator with its records; `options` of its `system`.

    laboratory : that takes the records, or the seed that it is drawn from; its noise is then that of the records
    """
    system = SYSTEMS[simulator](**options)
    trigger = tuple(p.name for p in system.plans if p.kind == "harmonic") if "trigger" in nuisance else ()
    if laboratory is None:
        return Bench(system, cache, noise, phi, trigger)
    if not isinstance(laboratory, Laboratory):
        laboratory = Laboratory.drawn(laboratory, system)
    system = replace(system, clocks=laboratory.clocks)
    return Bench(system, cache, laboratory.noise, 0.0, trigger, laboratory.memory)


def hide(
    simulator: str,
    effect: str | tuple[str, ...] | None,
    strength: float | None,
    seed: int,
    noise: float = 0.01,
    phi: float = 0.0,
    *,
    folder: Path,
    cache: Path,
    size: float | None = None,
    stated: bool = False,
    nuisance: Sequence[str] = (),
    laboratory: int | Laboratory | None = None,
    remainder: float | None = None,
    over_remainder: float = 0.0,
    **options,
) -> Hidden:
    """Write records with hidden effects, and a study that calibrates without them.

    Parameters
    ----------
    simulator : one of `SYSTEMS`
    effect : one, several, or none
    strength : z of each effect, see `Bench.z_of`
    seed : of the noise
    noise, phi : standard deviation relative to each channel's rms; correlation between neighbouring samples
    folder, cache : for the study; for records without noise, which may be shared
    size : of the effect, SI, in place of its strength
    stated : whether the records state the noise of their channels
    nuisance : "trigger" where the beginning of periodic records is not told
    laboratory : that takes the records, or the seed that it is drawn from; it has its own clock, lengths of records and
        noise, in place of `noise`, `phi` and `stated`
    remainder : share of the motion that something makes which no candidate expresses; its kind is drawn from the seed
    over_remainder : z of each effect at least, over that of the remainder  [1]
    options : of the simulator's `system`

    Raises
    ------
    Refused : see `Bench.size_for`
    """
    if laboratory is not None and not isinstance(laboratory, Laboratory):
        laboratory = Laboratory.drawn(laboratory, SYSTEMS[simulator](**options))
    at = bench(simulator, cache, noise, phi, nuisance, laboratory, **options)
    stated = stated if laboratory is None else laboratory.stated
    effects = () if effect is None else (effect,) if isinstance(effect, str) else tuple(effect)
    kind, more = drawn_remainder(at, remainder, seed) if remainder else ("", {})
    if effects and more and over_remainder:
        strength = max(strength or 0.0, over_remainder * at.remainder_z(more))
    values, z = _sized(at, effects, strength, size)
    if effects and more and over_remainder:  # beside the effects it may be more than alone
        seen = {name: value for name, value in values.items() if name not in CONVERTER}
        beside = at.remainder_z(more, seen)
        if min(z.values()) < LEAST_OVER_REMAINDER * beside:
            raise Refused(f"beside {' and '.join(effects)} {kind!r} has z = {beside:.0f}")
        cosine = at.imitated_beside(more, seen) if seen else 0.0
        if cosine >= EXPRESSED:
            raise Refused(f"beside {' and '.join(effects)} more of it expresses {kind!r} (|cos| = {cosine:.2f})")
    share = values.get("outlier_share", 0.0)
    acting = {name: value for name, value in (values | more).items() if name != "outlier_share"}
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for index, plan in enumerate(at.system.plans):
        rng = np.random.default_rng([seed, index])
        late = rng.uniform() / plan.frequency if plan.name in at.trigger else 0.0
        before = {name: value for name, value in acting.items() if name not in CONVERTER}
        rows = at.clean(plan, before, late).rows
        sigma = at.noise * np.sqrt((rows**2).mean(axis=1, keepdims=True))
        rows = rows + sigma * coloured(rng, rows.shape, np.array(at.memory[plan.name]))
        far = rng.uniform(size=rows.shape) < share
        rows = np.where(far, rows + FAR * sigma * rng.choice([-1.0, 1.0], size=rows.shape), rows)
        rows = converted(rows, acting)
        write(_record(at, plan, rows, sigma if stated else None), folder / f"{plan.name}.nc")
    (folder / "study.toml").write_text(study(at))
    return Hidden(folder, values, z, {} if laboratory is None else laboratory.facts, kind, more)


def _sized(
    at: Bench, effects: tuple[str, ...], strength: float | None, size: float | None
) -> tuple[dict[str, float], dict[str, float]]:
    """Parameters of the effects, SI, each of this strength or size; and the z of each."""
    values, z = {}, {}
    for name in effects:
        if name not in at.system.hideable:
            raise Refused(f"{at.system.name} has no site for {name!r}")
        known = at.size_for(name, strength) if size is None else size
        values |= at.hidden(name, known)
        z[name] = np.nan if name == "outliers" else at.z_of(name, known)
    return values, z


def _record(at: Bench, plan: Plan, rows: np.ndarray, sigma: np.ndarray | None):
    system, clock = at.system, at.system.clock(plan)
    displacement, velocity = np.split(rows, 2)
    channels = {"displacement": displacement, "velocity": velocity}
    if sigma is not None:
        channels |= dict(zip(("displacement_sigma", "velocity_sigma"), np.split(sigma[:, 0], 2), strict=True))
    attrs = {"place": system.place, "quantity": system.quantity, "source": "measured"}
    if plan.kind == "harmonic":
        attrs |= {"frequency": plan.frequency, "amplitude": plan.amplitude, "phase": 0.0}
    elif plan.kind == "decay":
        attrs["quantity"] = "free decay"
    record = make(clock.stamps, list(system.measured), channels, **attrs)
    if plan.kind != "multisine":
        return record
    tones = system.plant({**system.truth, "amplitude": 1.0}, plan).tones
    value = (tones[:, :1] * np.cos(tones[:, 1:2] * clock.true + tones[:, 2:])).sum(axis=0)
    return record.assign(excitation=("time", value, {"units": "N"}))


def study(at: Bench, budget: int = 60) -> str:
    """Text of the study file."""
    system = at.system
    lines = ["[study]", f'name = "{system.name}"', "seed = 1", f"budget = {budget}"]
    lines += [] if system.clocks else [f"periods = {system.periods}", f"samples = {system.samples}"]
    for plan in system.plans:
        lines += ["", "[[record]]", f'name = "{plan.name}"', f'path = "{plan.name}.nc"', f'use = "{plan.use}"']
        lines += ['nuisance = ["trigger"]'] if plan.name in at.trigger else []
        if system.clocks and plan.kind == "harmonic":  # a simulation that goes round within the record has no drift
            lines += [f"periods = {ceil(system.clocks[plan.name].stamps[-1] * plan.frequency) + 1}"]
    options = ", ".join(f"{name} = {json.dumps(value)}" for name, value in system.options.items())
    fixed = ", ".join(f'"{name}" = {value!r}' for name, value in system.fixed.items())
    lines += ["", "[model]", f'simulator = "{system.name}"', f"options = {{ {options} }}", f"fixed = {{ {fixed} }}"]
    lines += ["", "[windows]"]
    for name, (low, high, scale) in system.windows.items():
        lines.append(f'{name} = {{ low = {low!r}, high = {high!r}, scale = "{scale}" }}')
    lines += ["", "[[term]]", f'feature = "{system.feature}"', "", "[optimiser]", 'name = "multistart"', ""]
    return "\n".join(lines)
