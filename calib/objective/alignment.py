"""A simulated record brought onto the time base of a measured one, its nuisances solved for."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq

from calib.errors import CalibError
from calib.records import STATE, stated_period
from calib.records import channels as channels_of
from calib.records.cycles import cut, mean_cycle, sampled

# Catmull-Rom interpolation: weights of samples j - 1 .. j + 2 as polynomials in the share f of the step after sample j
CUBIC = 0.5 * np.array([[0, -1, 2, -1], [2, 0, -5, 3], [0, 1, 4, -3], [0, 0, -1, 1]], dtype=float)
# sum_j h_j h_{j+d} for d = -3..3, as polynomials in f
OVERLAP = np.array(
    [sum(np.convolve(CUBIC[j], CUBIC[j + d]) for j in range(max(0, -d), min(4, 4 - d))) for d in range(-3, 4)]
)
SLOPE = CUBIC[:, 1:] * np.arange(1, 4)  # of the weights over f
SHIFT_BRACKETS = (0.0, 0.25, 0.5, 0.75, 1.0)  # samples between which a zero of the slope is bracketed
MAX_UNTRUSTED_SAMPLES, MIN_TRUSTED_SAMPLES = 2.0, 3.0  # samples from a simulated impact, in a velocity
MAX_ALIGNMENT_STEPS = 25  # of Gauss and Newton


class Alignment:
    """Bring simulated records onto the time base of one reference.

    A measured channel is y_i(t) = sum_k theta_k phi_ik(t + trigger): with phi the simulated displacement x, velocity v
    and a constant, x_b -> scale x_b + offset_b + shear v_b and v_b -> scale v_b, whichever of these the reference names
    as nuisance. Trigger and theta minimise the squared difference of the mean loops, each channel over the reference's
    root mean square about its mean: theta by linear least squares at every whole sample of trigger (cyclic correlation
    by FFT), then the trigger to machine precision between samples, where cubic interpolation makes the squared
    difference a polynomial. Nothing jumps when the trigger passes a sample, so that residuals are smooth in the model's
    parameters (variable projection).

    The simulated loop is moved, never the measured one: its noise stays white. Where the excitation prescribes a
    channel that the reference has, that channel alone fixes the trigger (displacement before velocity).

    Samples do not say where between two of them a velocity has jumped. Next to a simulated impact its velocity is
    therefore not compared (`trust`), and where there are impacts the trigger and theta are solved for once more
    without these samples: otherwise half a jump in one sample would outweigh the rest of the loop and shift them.

    Parameters
    ----------
    record : the reference
    period : of the excitation [s], None without one
    periods : length of the loop, in periods
    nuisance : names of the nuisances to solve for
    bodies : that the nuisances are solved from
    prescribed : (body, channel) pairs that the excitation prescribes
    compared : (body, channel) pairs that alone fix the trigger where none is prescribed, if there are any
    """

    def __init__(
        self,
        record: xr.Dataset,
        period: float | None,
        periods: int,
        nuisance: Sequence[str],
        bodies: Collection[str],
        prescribed: frozenset[tuple[str, str]],
        compared: Collection[tuple[str, str]],
    ):
        self.time, self.period, self.periods = record.time.values, period, periods
        self.bodies = [str(body) for body in record.body.values]
        self.channels = channels_of(record)
        present = [c for c in STATE if c in self.channels]
        driven = [(b, c) for c in present for b in self.bodies if (b, c) in prescribed]
        used = [(b, c) for b in self.bodies for c in present if b in bodies or (b, c) in prescribed]
        self.used = used
        linear = tuple(name for name in nuisance if name in ("offset", "scale", "shear"))
        self.solves = bool(used) and ("trigger" in nuisance or bool(linear))
        if not self.solves:
            return
        values = np.array([record[c].sel(body=b).values for b, c in used])
        self.offset = 0.0
        if period is not None:
            mean = mean_cycle(self.time, values, period, periods)
            values, self.per_period = mean.loop, mean.phase.size // periods
            self.offset = mean.phase[0] * self.per_period
        self._all = _Fit(values, used, linear)
        self._trigger: _Fit | None = None
        if "trigger" in nuisance:
            first = [row for row in driven if row[1] == driven[0][1]]
            rows = first or [row for row in used if _is_needed(row, compared, linear)] or used
            index = [used.index(row) for row in rows]
            self._trigger = self._all if rows == used and not first else _Fit(values[index], rows, linear)
            self._given = bool(first)

    def __call__(self, simulated: xr.Dataset) -> tuple[dict[str, np.ndarray], dict[str, float], np.ndarray]:
        """Channels (body, time) at the reference's instants with the nuisances applied, the nuisances [SI], the trust.

        The trust (time,) in a velocity is 0 next to an impact of the simulation and 1 away from all of them.

        "trigger" is the time of the simulation at the reference's time zero [s]; "offset.<body>" [m],
        "scale.<channel>" [1] and "shear" [s] are what the instrument made of the simulated motion.
        """
        names = [str(body) for body in simulated.variables["body"].values]
        missing = [body for body in self.bodies if body not in names]
        if missing:
            raise CalibError(f"the simulated record has no body {missing[0]!r}; it has {', '.join(names)}")
        index = [names.index(body) for body in self.bodies]
        present = [c for c in self.channels if c in simulated.variables]
        values = {c: sampled(simulated, c)[index] for c in present}
        time = simulated.variables["time"].values
        impacts = _impacts(simulated)
        shift, theta = self._solved(time, values, present, impacts) if self.solves else (0.0, {})
        stacked = np.concatenate([values[c] for c in present])
        trust = self._trust(time, impacts, shift)
        moved = self._moved(time, stacked, shift, trust).reshape(len(present), len(self.bodies), self.time.size)
        nuisances = dict(theta)
        if self.solves and self._trigger is not None and self.period is not None:
            nuisances = {"trigger": float(shift * self.period), **theta}
        return self._measured(dict(zip(present, moved, strict=True)), theta), nuisances, trust

    def _trust(self, time: np.ndarray, impacts: np.ndarray, shift: float) -> np.ndarray:
        """Trust (time,) in the velocity at each instant of the reference, the simulation `shift` periods ahead."""
        if self.period is None:
            return _trusted(self.time, impacts)
        length = self._repeating(round((time[-1] - time[0]) / self.period)) * self.period
        end = length + 0.5 * (time[-1] - time[0]) / (time.size - 1)  # half a sample on: rounding loses none at the end
        return _trusted(self.time + shift * self.period, impacts[impacts - time[0] < end], length)

    def _repeating(self, simulated: int) -> int:
        """Periods of a simulation of so many after which it repeats as the reference does: whole loops."""
        return simulated // self.periods * self.periods or simulated

    def _solved(
        self, time: np.ndarray, values: Mapping[str, np.ndarray], present: Collection[str], impacts: np.ndarray
    ) -> tuple[float, dict[str, float]]:
        """Return the trigger in periods, and the linear nuisances by name."""
        missing = [c for _, c in self.used if c not in present]
        if missing:
            raise CalibError(f"the simulated record has no {missing[0]}, which the reference's nuisances need")
        loops = np.array([values[c][self.bodies.index(b)] for b, c in self.used])
        if self.period is None:
            loops = self._moved(time, loops, 0.0)
            return 0.0, self._all.linear(self._all.correlated(loops), 0.0)
        cycles, _ = cut(time, loops, self.period, self.periods, self.per_period)
        loops = cycles.mean(axis=1)
        shift, trigger = self.offset, self._trigger
        theta: dict[str, float] = {}
        if trigger is not None:
            own = loops[[self.used.index(row) for row in trigger.rows]]
            sums = trigger.correlated(own)
            shift = trigger.best(sums)
            if not self._given:
                theta = trigger.linear(sums, shift) if trigger.names else {}
                if impacts.size:
                    at = np.unique((impacts / self.period * self.per_period) % self._all.size)
                    shift, theta = trigger.polished(own, at, shift, theta)
        if len(theta) < len(self._all.names):  # nor compared, nor do they move the trigger
            theta = {**self._all.linear(self._all.correlated(loops), shift), **theta}
        return ((shift - self.offset) / self.per_period) % self.periods, theta

    def _moved(self, time: np.ndarray, values: np.ndarray, shift: float, trust: np.ndarray | float = 1.0) -> np.ndarray:
        """Rows of the simulation at the reference's instants plus `shift` periods."""
        same = time.size == self.time.size and np.abs(time - self.time).max() < 1e-6 * (time[1] - time[0])
        if same and shift == 0.0:
            return values
        if self.period is None:
            margin = (time[-1] - time[0]) / (time.size - 1)
            if time[0] - self.time[0] > margin or self.time[-1] - time[-1] > margin:
                raise CalibError(
                    f"the simulation lasts from {time[0]:.6g} s to {time[-1]:.6g} s, the reference from "
                    f"{self.time[0]:.6g} s to {self.time[-1]:.6g} s; ask for the reference's times"
                )
            at = np.clip(self.time, time[0], time[-1])
            straight = np.array([np.interp(at, time, row) for row in values])
            if (np.diff(time) <= 0.0).any():  # an instant before and behind an impact
                return straight
            cubic = CubicHermiteSpline(time, values, np.gradient(values, time, axis=1), axis=1)(at)
            return straight + trust * (cubic - straight)  # a cubic would overshoot on both sides of a jump
        cycles, phase = cut(time, values, self.period)
        steps = phase.size
        flat = cycles[:, : self._repeating(cycles.shape[1])].reshape(len(values), -1)
        position = (self.time / self.period + shift - phase[0]) * steps
        before = np.floor(position)
        share = position - before
        weights = CUBIC @ share ** np.arange(4)[:, None]
        straight = np.array([0.0 * share, 1.0 - share, share, 0.0 * share])
        weights = straight + trust * (weights - straight)  # a cubic would overshoot on both sides of a jump
        first = before.astype(int) - 1
        return sum((weights[j] * np.take(flat, first + j, axis=1, mode="wrap") for j in range(4)), np.zeros(()))

    def _measured(self, simulated: Mapping[str, np.ndarray], theta: Mapping[str, float]) -> dict[str, np.ndarray]:
        """Channels (body, time) as the instrument shows them, with scale, offset and shear."""
        if not theta:
            return dict(simulated)
        measured = {c: theta.get(f"scale.{c}", 1.0) * values for c, values in simulated.items()}
        if "displacement" in measured:
            offsets = [theta.get(f"offset.{body}", 0.0) for body in self.bodies]
            measured["displacement"] = measured["displacement"] + np.array(offsets)[:, None]
            if "shear" in theta:
                measured["displacement"] = measured["displacement"] + theta["shear"] * simulated["velocity"]
        return measured


def _is_needed(row: tuple[str, str], compared: Collection[tuple[str, str]], linear: Collection[str]) -> bool:
    """Whether a (body, channel) pair is compared, or the velocity that the shear of a compared displacement needs."""
    return row in compared or ("shear" in linear and row[1] == "velocity" and (row[0], "displacement") in compared)


def trusted(simulated: xr.Dataset) -> np.ndarray:
    """Trust (time,) in a simulated velocity at its own instants: 0 next to an impact, 1 away from all of them."""
    time = simulated.variables["time"].values
    period = stated_period(simulated)
    return _trusted(time, _impacts(simulated), None if period is None else _length(time, period))


def _impacts(simulated: xr.Dataset) -> np.ndarray:
    """Instants of the impacts (impact,), none where the simulator does not list them  [s]."""
    return simulated.variables["impact_time"].values if "impact_time" in simulated.variables else np.empty(0)


def _length(time: np.ndarray, period: float) -> float:
    """Duration of a simulation, in whole periods after which it repeats  [s]."""
    return round((time[-1] - time[0]) / period) * period


def _trusted(time: np.ndarray, impacts: np.ndarray, length: float | None = None) -> np.ndarray:
    """Trust (n,) at these instants, smooth in them; the simulation repeats after `length` where it is given."""
    if not impacts.size:
        return np.ones(time.size)
    instants, impacts = time, np.sort(impacts)
    if length is not None:
        instants, impacts = time % length, np.sort(impacts % length)
        impacts = np.concatenate([impacts[-1:] - length, impacts, impacts[:1] + length])
    after = np.clip(np.searchsorted(impacts, instants), 1, impacts.size - 1) if impacts.size > 1 else 0
    nearest = np.minimum(np.abs(impacts[after] - instants), np.abs(impacts[after - 1] - instants))
    nearest = nearest * (time.size - 1) / (time[-1] - time[0])  # in samples
    share = np.clip((nearest - MAX_UNTRUSTED_SAMPLES) / (MIN_TRUSTED_SAMPLES - MAX_UNTRUSTED_SAMPLES), 0.0, 1.0)
    return share**2 * (3.0 - 2.0 * share)


@dataclass(frozen=True, eq=False)
class _Sums:
    """Weighted sums that the squared difference is made of, up to what does not change with shift and unknowns.

    right : (unknown + 1, n) products of reference and basis at each whole shift; the last is the basis that is certain
    gram : (unknown + 1, unknown + 1, 7) products of the bases, shifted by -3..3 samples against each other
    """

    right: np.ndarray
    gram: np.ndarray


class _Fit:
    """Rows of a reference, to which simulated rows are fitted by a shift and linear unknowns."""

    def __init__(self, reference: np.ndarray, rows: Sequence[tuple[str, str]], linear: Sequence[str]):
        self.rows = list(rows)
        names = []
        if "offset" in linear:
            names += [f"offset.{body}" for body, channel in rows if channel == "displacement"]
        if "scale" in linear:
            names += [f"scale.{channel}" for channel in STATE if channel in {c for _, c in rows}]
        if "shear" in linear and any((body, "velocity") in rows for body, channel in rows if channel == "displacement"):
            names += ["shear"]
        self.names = names
        spread = reference.std(axis=1)
        size = np.where(spread > 1e-9 * np.abs(reference).max(axis=1), spread, np.abs(reference).max(axis=1))
        weight = 1.0 / np.where(size > 0.0, size, 1.0) ** 2
        self.reference = reference
        self.size = reference.shape[1]
        self._basis = [self._of(row) for row in self.rows]  # row -> [(unknown, simulated row or -1 for a constant)]
        self._weighted = weight[:, None] * np.conj(np.fft.rfft(reference, axis=1))
        self._weight = weight

    def _of(self, row: tuple[str, str]) -> list[tuple[int, int]]:
        body, channel = row
        certain = len(self.names)
        index = {name: i for i, name in enumerate(self.names)}
        basis = [(index.get(f"scale.{channel}", certain), self.rows.index(row))]
        if channel == "displacement":
            if f"offset.{body}" in index:
                basis.append((index[f"offset.{body}"], -1))
            if "shear" in index and (body, "velocity") in self.rows:
                basis.append((index["shear"], self.rows.index((body, "velocity"))))
        return basis

    def correlated(self, loops: np.ndarray) -> _Sums:
        """Sums for simulated rows (row, n)."""
        spectrum = np.fft.rfft(np.vstack([loops, np.ones(self.size)]), axis=1)
        number = len(self.names) + 1
        right = np.zeros((number, spectrum.shape[1]), dtype=complex)
        gram = np.zeros((number, number, spectrum.shape[1]), dtype=complex)
        for row, basis in enumerate(self._basis):
            for k, source in basis:
                right[k] += self._weighted[row] * spectrum[source]
                for m, other in basis:
                    gram[k, m] += self._weight[row] * np.conj(spectrum[source]) * spectrum[other]
        lags = np.fft.irfft(gram, self.size, axis=-1)[..., np.arange(-3, 4) % self.size]
        return _Sums(np.fft.irfft(right, self.size, axis=-1), lags)

    def best(self, sums: _Sums) -> float:
        """Shift in samples at which the squared difference is least."""
        gram = sums.gram[..., 3]
        theta = self._theta(gram, sums.right)
        squares = -2.0 * (theta * sums.right).sum(axis=0) + ((gram @ theta) * theta).sum(axis=0)
        whole = int(np.argmin(squares))
        slope = _slope(self, sums, whole)
        for start in (whole, whole - 1) if slope(0.0) < 0.0 else (whole - 1, whole):
            own = slope if start == whole else _slope(self, sums, start)
            for low, high in zip(SHIFT_BRACKETS[:-1], SHIFT_BRACKETS[1:], strict=True):
                if own(low) < 0.0 <= own(high):
                    return start + brentq(own, low, high, xtol=1e-13, rtol=1e-13)
        return float(whole)

    def linear(self, sums: _Sums, shift: float) -> dict[str, float]:
        """Linear unknowns by name for a shift in samples."""
        start = int(np.floor(shift))
        right, gram = _between(sums, start)
        powers = (shift - start) ** np.arange(7)
        theta = self._theta(gram @ powers, (right @ powers[:4])[:, None])
        return dict(zip(self.names, theta[:-1, 0].tolist(), strict=True))

    def polished(
        self, loops: np.ndarray, impacts: np.ndarray, shift: float, theta: Mapping[str, float]
    ) -> tuple[float, dict[str, float]]:
        """Shift in samples and linear unknowns without the velocities next to impacts, by Gauss and Newton.

        Parameters
        ----------
        loops : (row, n) simulated
        impacts : (m,) where they are in the simulated loop, in samples
        shift, theta : where to begin
        """
        samples = np.arange(self.size)
        unknowns = np.array([*theta.values(), 1.0])
        velocity = np.array([channel == "velocity" for _, channel in self.rows])
        for _ in range(MAX_ALIGNMENT_STEPS):
            trust = _trusted(samples + shift, impacts, self.size)
            weight = np.sqrt(self._weight)[:, None] * np.where(velocity[:, None], trust, 1.0)
            before = int(np.floor(shift))
            powers = (shift - before) ** np.arange(4)
            near = [np.roll(loops, 1 - before - j, axis=1) for j in range(4)]
            x = sum(h * row for h, row in zip(CUBIC @ powers, near, strict=True))
            rate = sum(h * row for h, row in zip(SLOPE @ powers[:3], near, strict=True))
            columns = np.zeros((unknowns.size, *x.shape))
            slope = np.zeros_like(x)
            for row, basis in enumerate(self._basis):
                for k, source in basis:
                    columns[k, row] += x[source] if source >= 0 else 1.0
                    if source >= 0:
                        slope[row] += unknowns[k] * rate[source]
            residual = (weight * (self.reference - np.tensordot(unknowns, columns, 1))).ravel()
            jacobian = (weight * np.concatenate([slope[None], columns[:-1]])).reshape(unknowns.size, -1)
            move = np.linalg.lstsq(jacobian.T, residual, rcond=1e-12)[0]
            move[0] = np.clip(move[0], -0.5, 0.5)
            shift += move[0]
            unknowns[:-1] += move[1:]
            if abs(move[0]) < 1e-11:
                break
        return shift, dict(zip(self.names, unknowns[:-1].tolist(), strict=True))

    def _theta(self, gram: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Unknowns (unknown + 1, n) that minimise the squared difference for each column of `right`; the last is 1."""
        one = np.ones((1, right.shape[1]))
        if not self.names:
            return one
        free = gram[:-1, :-1]
        # an undetermined unknown (the scale of a body at rest) must not make the equations singular
        ridge = 1e-14 * np.diag(np.maximum(np.diag(free), 1e-300 + 1e-14 * np.trace(free)))
        return np.concatenate([np.linalg.solve(free + ridge, right[:-1] - gram[:-1, -1:]), one])


def _between(sums: _Sums, start: int) -> tuple[np.ndarray, np.ndarray]:
    """Sums between shifts `start` and `start` + 1 as polynomials there: (unknown, 4) and (unknown, unknown, 7)."""
    near = np.take(sums.right, np.arange(start - 1, start + 3), axis=1, mode="wrap")
    return near @ CUBIC, sums.gram @ OVERLAP


def _slope(fit: _Fit, sums: _Sums, start: int) -> Callable[[float], float]:
    """Slope of the squared difference over the share of a step after the shift `start`, its unknowns at their best."""
    right, gram = _between(sums, start)
    down, up = right[:, 1:] * np.arange(1, 4), gram[..., 1:] * np.arange(1, 7)
    if not fit.names:
        c = up[0, 0].copy()
        c[:3] -= 2.0 * down[0]
        c0, c1, c2, c3, c4, c5 = c.tolist()
        return lambda f: c0 + f * (c1 + f * (c2 + f * (c3 + f * (c4 + f * c5))))

    def slope(f: float) -> float:
        powers = f ** np.arange(7)
        theta = fit._theta(gram @ powers, (right @ powers[:4])[:, None])[:, 0]
        return float(theta @ (up @ powers[:6]) @ theta - 2.0 * theta @ (down @ powers[:3]))

    return slope
