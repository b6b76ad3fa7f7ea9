"""How well hidden effects can be seen: what the records know of them at the truth, beside what calibration absorbs."""

import hashlib
import itertools
import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from hidden.causes import CAUSES, first_step, one_sided, parameters
from hidden.motion import Refused
from hidden.noise import whitened
from hidden.system import Plan, System

LATER = 1e-6  # of derivatives by the beginning of a record, in periods
BLIND = 2.0  # samples on both sides of an impact that are not looked at in velocities: the sample that jumps is chance
ALIKE = 0.05  # singular value, over the largest, below which two signatures of unit length are one
ABSORBED = 1e-4  # share of an effect beyond what calibration imitates, below which nothing is left
ABSURD = 0.5  # change of a channel by an effect, relative to its rms, that nobody would overlook
CLOSE = 0.02  # of the wanted z
RELATIVE_STEP = 1e-3  # of derivatives by parameters of what is there
REFITS, REFITTED = 6, 0.003  # steps of a calibration, and the relative change of z at which it ends
ROUNDS = 16
HARMONICS = 40  # of the mean of what is rounded


class Clean(NamedTuple):
    """A record without noise: rows (2 b, n), impacts (k,) [s], the state at time zero."""

    rows: np.ndarray
    impacts: np.ndarray
    state: np.ndarray


class Bench:
    """A system with its records, those without noise kept in a folder.

    Parameters
    ----------
    system : what is looked at
    cache : folder of records without noise
    noise : standard deviation, relative to the rms of each channel of each body
    phi : correlation of the noise between neighbouring samples
    trigger : records whose beginning is not known
    memory : of the noise in place of `phi`: record -> coefficients of the autoregression
    """

    def __init__(
        self,
        system: System,
        cache: Path,
        noise: float = 0.01,
        phi: float = 0.0,
        trigger: tuple = (),
        memory: Mapping[str, tuple[float, ...]] | None = None,
    ):
        self.system, self.cache, self.noise, self.phi, self.trigger = system, Path(cache), noise, phi, tuple(trigger)
        self.memory = {plan.name: (phi,) for plan in system.plans} if memory is None else dict(memory)
        self.cache.mkdir(parents=True, exist_ok=True)
        self._signatures: dict[str, tuple[np.ndarray, np.ndarray]] = {}

    # --- records ---------------------------------------------------------------------------------------------------

    def clean(self, plan: Plan, hidden: Mapping[str, float] = {}, shift: float = 0.0, **changed: float) -> Clean:
        """Record at the truth with hidden parameters; `changed` values of the plant, `shift` of its beginning [s].

        Raises
        ------
        Refused : there is no motion that a record can be made of
        """
        values = {**self.system.truth, **changed}
        path = self._path(plan, values, dict(hidden), shift)
        if path.exists():
            with np.load(path) as kept:
                return Clean(**{name: kept[name] for name in Clean._fields})
        start = self.clean(plan).state if hidden or changed or shift else None
        motion = self.system.moved(plan, values, hidden, start)
        record = Clean(self.system.rows(plan, motion, hidden, shift), motion.impacts, motion.state)
        _keep(path, **record._asdict())
        return record

    def _path(self, *facts) -> Path:
        """File of a result that depends on these facts, and on the system."""
        system = self.system
        facts = [*facts, system.name, system.periods, system.samples, len(system.time)]
        facts += [system.fingerprint] if system.clocks else []
        return self.cache / f"{hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()}.npz"

    def _number(self, make: Callable[[str, float], float], effect: str, x: float) -> float:
        """Return make(effect, x), which is kept: it depends on the records, the noise and what is calibrated."""
        knows = [self.system.plans, dict(self.system.truth), list(self.system.windows), self.trigger]
        knows += [self.memory, [clock.jitter for clock in self.system.clocks.values()]] if self.system.clocks else []
        path = self._path(make.__name__, effect, x, self.noise, self.phi, knows)
        if not path.exists():
            _keep(path, number=make(effect, x))
        with np.load(path) as kept:
            return float(kept["number"])

    @property
    def plans(self) -> list[Plan]:
        """Records that a diagnosis sees."""
        return [plan for plan in self.system.plans if plan.use != "holdout"]

    def hidden(self, effect: str, size: float, weights: Mapping[str, float] | None = None) -> dict[str, float]:
        """Parameters by name of an effect of that size, SI; that of "clipping" is the share of the peak cut off."""
        if effect == "clipping":
            bodies = len(self.system.measured)
            return {"clip_velocity": (1.0 - size) * max(np.abs(self.clean(p).rows[bodies:]).max() for p in self.plans)}
        return parameters(self.system, effect, size, weights)

    # --- columns: derivatives and differences, over the noise ------------------------------------------------------

    def _column(self, plan: Plan, difference: np.ndarray, impacts: np.ndarray) -> np.ndarray:
        """Independent parts of a difference of records (2 b, n) over their noise; flat."""
        whole = whitened(difference / self._deviation(plan), np.array(self.memory[plan.name]))
        whole[len(whole) // 2 :, self.blind(plan, impacts)] = 0.0
        return whole.ravel()

    def blind(self, plan: Plan, impacts: np.ndarray) -> np.ndarray:
        """Whether a sample (n,) is so near an impact (k,) [s] that its velocity says nothing."""
        times = self.system.times(plan)
        step = times[1] - times[0]
        apart = times - impacts[:, None]
        if plan.kind == "harmonic":
            apart = (apart * plan.frequency + 0.5) % 1.0 / plan.frequency - 0.5 / plan.frequency
        return np.abs(apart).min(axis=0, initial=np.inf) < BLIND * step

    def _sigma(self, plan: Plan) -> np.ndarray:
        """Standard deviation (2 b, 1) of the noise of a record."""
        return self.noise * np.sqrt((self.clean(plan).rows ** 2).mean(axis=1, keepdims=True))

    def _deviation(self, plan: Plan) -> np.ndarray:
        """Standard deviation (2 b, 1) or (2 b, n) of the noise with what errors of the stamps make of the motion.

        These are white, but taken as coloured as the noise is: they matter at few samples per period, where neither
        has much memory.
        """
        sigma, clock = self._sigma(plan), self.system.clock(plan)
        if not clock.jitter:
            return sigma
        velocity = np.split(self.clean(plan).rows, 2)[1]
        rate = np.concatenate([velocity, np.gradient(velocity, clock.true, axis=1)])
        return np.sqrt(sigma**2 + (clock.jitter * rate) ** 2)

    def _between(self, one: Mapping, other: Mapping) -> np.ndarray:
        """Difference of all records at two sets of arguments of `clean`, flat."""
        parts = []
        for plan in self.plans:
            a, b = self._expected(plan, **one), self._expected(plan, **other)
            parts.append(self._column(plan, a.rows - b.rows, np.concatenate([a.impacts, b.impacts])))
        return np.concatenate(parts)

    def _expected(self, plan: Plan, hidden: Mapping[str, float] = {}, **rest: float) -> Clean:
        """Mean of a record over its noise, which is there before a converter rounds: steps below the noise are lost.

        The mean of what is rounded: Widrow & Kollar, Quantization Noise (2008), chapter 4.
        """
        quanta = [hidden.get(f"quantum_{channel}", 0.0) for channel in ("displacement", "velocity")]
        if not any(quanta):
            return self.clean(plan, hidden, **rest)
        record = self.clean(plan, {k: v for k, v in hidden.items() if not k.startswith("quantum_")}, **rest)
        sigma = self._sigma(plan)
        rows = record.rows.copy()
        for half, deep, q in zip(np.split(rows, 2), np.split(sigma, 2), quanta, strict=True):
            half += sum(
                q / (np.pi * k) * (-1.0) ** k * np.sin(2.0 * np.pi * k * half / q)
                * np.exp(-2.0 * (np.pi * k * deep / q) ** 2)
                for k in (range(1, HARMONICS) if q else ())
            )  # fmt: skip
        return record._replace(rows=rows)

    @cached_property
    def sensitivity(self) -> np.ndarray:
        """Derivative (m, p) of all records by what calibration changes: its parameters, and beginnings not known."""
        columns = []
        for name in self.system.windows:
            columns.append(self._secant({}, name, self.system.step * self.system.truth[name]))
        for plan in self.plans:
            if plan.name in self.trigger:
                parts = [np.zeros(self.clean(p).rows.size) for p in self.plans]
                later = LATER / plan.frequency
                ahead, behind = self.clean(plan, shift=later), self.clean(plan, shift=-later)
                moved = self._column(plan, ahead.rows - behind.rows, ahead.impacts)
                parts[self.plans.index(plan)] = moved / (2.0 * later)
                columns.append(np.concatenate(parts))
        return np.column_stack(columns)

    @cached_property
    def absorbed(self) -> np.ndarray:
        """Orthonormal columns (m, p) that span the sensitivity."""
        return np.linalg.qr(self.sensitivity / np.linalg.norm(self.sensitivity, axis=0))[0]

    def beyond(self, column: np.ndarray) -> np.ndarray:
        """Part of a column that calibration does not imitate."""
        for _ in range(2):  # once more: of nearly all only rounding is left
            column = column - self.absorbed @ (self.absorbed.T @ column)
        return column

    def derivative(self, effect: str, weights: Mapping[str, float] | None = None) -> np.ndarray:
        """Derivative of all records by the size of an effect, where it is absent; a secant where there is none."""
        step = first_step(self.system, effect)
        if CAUSES[effect].derived and not one_sided(effect):
            ahead, behind = ({"hidden": self.hidden(effect, s, weights)} for s in (step, -step))
            return self._between(ahead, behind) / (2.0 * step)
        return self._between({"hidden": self.hidden(effect, step, weights)}, {}) / step

    # --- judgement -------------------------------------------------------------------------------------------------

    def linear_z_of(self, effect: str, size: float) -> float:
        """Size times the square root of what the records know of it beyond calibration, at the truth without it."""
        return abs(size) * float(np.linalg.norm(self.beyond(self.derivative(effect))))

    def z_of(self, effect: str, size: float) -> float:
        """Distance, in the noise, of the records with an effect of that size from the nearest ones without it.

        The nearest ones: at other values of the calibrated parameters within their windows, by the method of Gauss and
        Newton with the derivatives at the truth.

        Raises
        ------
        Refused : the motion is none that a record can be made of
        """
        return self._number(self._distance, effect, size)

    def remainder_z(self, hidden: Mapping[str, float], beside: Mapping[str, float] = {}) -> float:
        """Length in the noise, beyond calibration, of what these hidden parameters [SI] change beside others."""
        changed = self._between({"hidden": {**beside, **hidden}}, {"hidden": dict(beside)})
        return float(np.linalg.norm(self.beyond(changed)))

    def imitated_beside(self, hidden: Mapping[str, float], beside: Mapping[str, float]) -> float:
        """How well other sizes of what is there imitate what these hidden parameters [SI] change beside it.

        |cos| beyond calibration, in [0, 1], with all derivatives where `beside` is there; `imitations` takes those
        where nothing is.
        """
        windows = {name: self.system.truth[name] for name in self.system.windows}
        typical = max(map(abs, beside.values()))
        columns = [self._secant({"hidden": beside}, name, self.system.step * value) for name, value in windows.items()]
        for name, value in beside.items():
            step = RELATIVE_STEP * (abs(value) or typical)
            ahead, behind = ({"hidden": {**beside, name: value + sign * step}} for sign in (1.0, -1.0))
            columns.append(self._between(ahead, behind) / (2.0 * step))
        unit = np.column_stack(columns)
        unit /= np.maximum(np.linalg.norm(unit, axis=0), np.finfo(float).tiny)
        calibrated = np.linalg.qr(unit[:, : len(windows)])[0]
        changed = self._between({"hidden": {**beside, **hidden}}, {"hidden": dict(beside)})
        changed, unit = (both - calibrated @ (calibrated.T @ both) for both in (changed, unit[:, len(windows) :]))
        imitation = unit @ np.linalg.lstsq(unit, changed)[0]
        return float(np.linalg.norm(imitation) / np.linalg.norm(changed))

    def _secant(self, at: Mapping, name: str, step: float) -> np.ndarray:
        """Derivative of all records by a calibrated value, taken over two steps."""
        value = self.system.truth[name]
        ahead, behind = ({**at, name: value + sign * step} for sign in (1.0, -1.0))
        return self._between(ahead, behind) / (2.0 * step)

    def drift_z(self, drift: float) -> float:
        """Length in the noise, beyond calibration, of what a share `drift` by which clocks are fast does."""
        system = self.system
        clocks = {name: clock._replace(true=clock.true / (1.0 + drift)) for name, clock in system.clocks.items()}
        still = Bench(replace(system, clocks=clocks), self.cache, self.noise, trigger=self.trigger, memory=self.memory)
        parts = []
        for plan in self.plans:
            record = self.clean(plan)
            parts.append(self._column(plan, record.rows - still.clean(plan).rows, record.impacts))
        return float(np.linalg.norm(self.beyond(np.concatenate(parts))))

    def _distance(self, effect: str, size: float) -> float:
        hidden, moved, before = {"hidden": self.hidden(effect, size)}, {}, np.inf
        lengths = np.linalg.norm(self.sensitivity, axis=0)
        for _ in range(REFITS):
            difference = self._between(hidden, moved)
            z = float(np.linalg.norm(self.beyond(difference)))
            if abs(z - before) < REFITTED * z:
                break
            before = z
            change = np.linalg.lstsq(self.sensitivity / lengths, difference)[0] / lengths
            for (name, (low, high, _)), step in zip(self.system.windows.items(), change, strict=False):
                moved[name] = float(np.clip(moved.get(name, self.system.truth[name]) + step, low, high))
        return z

    def size_for(self, effect: str, z: float) -> float:
        """Size at which an effect is seen with that z, to 2 %.

        Raises
        ------
        Refused : calibration absorbs it, nobody would overlook it, or the motion is another
        """
        return self._number(self._size, effect, z)

    def _size(self, effect: str, z: float) -> float:
        if effect not in self.system.hideable:
            raise Refused(f"{self.system.name} has no site for {effect!r}")
        if effect == "outliers":
            raise Refused("outliers are noise, of which there is no z; give their share as the size")
        column = self.derivative(effect)
        whole, left = (float(np.linalg.norm(c)) for c in (column, self.beyond(column)))
        if not left > ABSORBED * whole:
            raise Refused(f"{effect!r} changes {whole:.1e} a unit, of which {left:.1e} is beyond calibration")
        small = first_step(self.system, effect)
        return self._searched(effect, z, z / left if CAUSES[effect].derived else small)

    def _searched(self, effect: str, z: float, size: float) -> float:
        """Size with that z from a first one on, in proportion and, once it lies between two, by halving."""
        low, high, refusal = 0.0, np.inf, Refused(f"no size of {effect!r} has z = {z:g}")
        for _ in range(ROUNDS):
            try:
                self._check_modest(effect, size)
                reached = self.z_of(effect, size)
            except Refused as reason:
                reached, refusal = np.inf, reason
            if abs(reached - z) < CLOSE * z:
                return size
            low, high = (size, high) if reached < z else (low, size)
            ahead = size * np.clip(z / max(reached, 1e-3 * z), 0.3, 3.0)
            size = ahead if low < ahead < high else np.sqrt(low * high)
            if high < (1.0 + 0.1 * CLOSE) * low:
                break
        raise refusal

    def _check_modest(self, effect: str, size: float) -> None:
        if size > CAUSES[effect].most:
            raise Refused(f"{effect!r} of size {size:.3g} is more than there can be, {CAUSES[effect].most:g}")
        for plan in self.plans:
            before, after = self.clean(plan).rows, self.clean(plan, self.hidden(effect, size)).rows
            change = np.sqrt(((after - before) ** 2).mean(axis=1) / (before**2).mean(axis=1)).max()
            if change > ABSURD:
                raise Refused(f"{effect!r} of size {size:.3g} changes record {plan.name!r} by {change:.0%}")

    def cosines(self, effects: tuple[str, ...]) -> np.ndarray:
        """How well each effect's parameters (columns) imitate what another changes (rows), beyond calibration.

        (n, n) in [0, 1]; NaN where calibration absorbs the effect.
        """
        changes, spans = zip(*(self._signature(effect) for effect in effects), strict=True)
        table = np.array([[np.linalg.norm(span.T @ change) for span in spans] for change in changes])
        table[:, np.isnan(np.diag(table))] = np.nan
        return table

    def imitations(self, hidden: Mapping[str, float], together: Sequence[tuple[str, ...]]) -> np.ndarray:
        """How well effects (n,), alone or several together, imitate what these hidden parameters [SI] change.

        Beyond calibration, in [0, 1]; NaN where calibration absorbs one of them.
        """
        change = self.beyond(self._between({"hidden": hidden}, {}))
        signatures = {effect: self._signature(effect) for effect in dict.fromkeys(itertools.chain(*together))}
        basis = np.linalg.qr(np.column_stack([span for _, span in signatures.values()]))[0]
        change = basis.T @ (change / np.linalg.norm(change))
        spans = {effect: basis.T @ span + 0.0 * own.sum() for effect, (own, span) in signatures.items()}
        return np.array([_imitated(change, np.column_stack([spans[effect] for effect in own])) for own in together])

    def _signature(self, effect: str) -> tuple[np.ndarray, np.ndarray]:
        """What an effect changes beyond calibration (N,), of unit length, and a basis (N, p) of what its parameters do.

        The former is NaN where calibration absorbs the effect. It is made once: every remainder that is drawn is
        compared with those of all effects.
        """
        if effect not in self._signatures:
            self._signatures[effect] = self._new_signature(effect)
        return self._signatures[effect]

    def _new_signature(self, effect: str) -> tuple[np.ndarray, np.ndarray]:
        names = tuple(CAUSES[effect].grows)
        alone = [{name: float(name == one) for name in names} for one in names]
        columns = [self.derivative(effect, weights) for weights in alone] if len(names) > 1 else []
        whole = self.derivative(effect)
        change = self.beyond(whole)
        span = np.column_stack([self.beyond(column) for column in columns] or [change])
        shows = np.linalg.norm(change) > ABSORBED * np.linalg.norm(whole)
        unit = change / np.linalg.norm(change) if shows else np.full_like(change, np.nan)
        return unit, np.linalg.qr(span / np.linalg.norm(span, axis=0))[0]


def _imitated(change: np.ndarray, columns: np.ndarray) -> float:
    """Length of the part of a vector (n,) that columns (n, k) span; of two that are nearly one, as one."""
    if np.isnan(columns).any():
        return np.nan
    left, singular, _ = np.linalg.svd(columns, full_matrices=False)
    return float(np.linalg.norm(left[:, singular > ALIKE * singular[0]].T @ change))


def _keep(path: Path, **arrays) -> None:
    """Write arrays so that the file is either whole or absent."""
    temporary = path.with_suffix(f".{os.getpid()}.npz")
    np.savez(temporary, **arrays)
    os.replace(temporary, path)
