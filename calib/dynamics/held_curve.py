"""Curves of periodic motions on which a condition on one body's first harmonic holds, by harmonic balance.

Frequency and level of the excitation are both unknown, and the condition (`calib.dynamics.harmonic_condition`) stands
beside the equations of `calib.dynamics.harmonic_balance`.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter

import numpy as np

from calib.dynamics.arclength import EDGE_ROUNDING, MAX_ARCLENGTH_STEP, Mark, OneWay, along_cubic, root, run
from calib.dynamics.harmonic_balance import HarmonicBalance
from calib.dynamics.harmonic_condition import Condition, ReadHarmonic, modulus
from calib.dynamics.level_curve import LevelCurve
from calib.dynamics.neighbour_curve import MAX_SPACING_RATIO, first_order_curve, neighbour_curve
from calib.dynamics.orbits import newton
from calib.dynamics.response import AMPLITUDE, FREQUENCY
from calib.dynamics.series_curve import (
    AT_STOP,
    MAX_FIRST_STEPS,
    MAX_SIZE_RATIO,
    MIN_SIZE_RATIO,
    SeriesMotion,
    at_own_scale,
    modal_system,
    null_vector,
)
from calib.dynamics.setting import Setting
from calib.errors import CalibError, nearest
from calib.modelling.modal_system import Forces, ModalSystem

MIN_RAMP_STEP = 1 / 64  # of an amplitude that is to be held, where a curve begins  [1]
MAX_LEVEL_EXPONENT = 300.0  # of a level: beyond it the squares of forces are no numbers  [1]


@dataclass(frozen=True, eq=False)
class HeldBranch:
    """Periodic motions of one body's condition, m of them: a backbone, or a constant-response curve.

    Attributes
    ----------
    body : whose first harmonic the condition is on
    frequency, level : (m,) of the excitation  [Hz], [its unit]
    bodies : in the order of the harmonics
    harmonics : (body, harmonic, m) complex amplitudes H_0, H_1, ... as `calib.dynamics.response.ResponseBranch`  [m]
    stable : (m,) at constant frequency and level
    left_out : (m,) velocity of the harmonics left out over that of the motion  [1]
    coefficients : (m, n, 2 H + 1) of the modal motion  [kg^1/2 m]
    scale : of these by which the steps along it were chosen  [kg^1/2 m]
    end : why it ends
    """

    body: str
    frequency: np.ndarray
    level: np.ndarray
    bodies: tuple[str, ...]
    harmonics: np.ndarray
    stable: np.ndarray
    left_out: np.ndarray
    coefficients: np.ndarray
    scale: float
    end: str

    @property
    def amplitude(self) -> np.ndarray:
        """Modulus (m,) of the first harmonic of the body  [m]."""
        return np.asarray(np.abs(self.harmonics[self.bodies.index(self.body), 1]))


@dataclass(frozen=True, eq=False)
class HeldCurve:
    """Motions whose first harmonic fulfils a condition, as `calib.dynamics.arclength.SolutionCurve`.

    The last two components of z are frequency and level, over their windows; the level on a logarithmic scale. What is
    left of the condition is weighed as a change of the level is in the balance: with a sharp resonance the forces left
    are small, and a change of phase moves the condition in second order.

    scale, level : of the coefficients and of the excitation  [kg^1/2 m], [its unit]
    run_over : number of the component of z over whose window the curve runs
    """

    held: "HeldBalance"
    condition: Condition
    scale: float
    level: float
    parameters: int = 2
    run_over: int = -2

    def unpacked(self, z: np.ndarray) -> tuple[np.ndarray, float, float]:
        """Coefficients, frequency [Hz] and level."""
        (low, high), (least, largest) = self.held.window, self.held.levels
        exponent = (1.0 - z[-1]) * math.log(least) + z[-1] * math.log(largest)
        level = math.exp(exponent) if exponent < MAX_LEVEL_EXPONENT else math.inf
        frequency = float((1.0 - z[-2]) * low + z[-2] * high)
        return self.scale * z[:-2].reshape(-1, self.held.balance.size), frequency, level

    def packed(self, y: np.ndarray, frequency: float, level: float) -> np.ndarray:
        """Point z (d,)."""
        (low, high), (least, largest) = self.held.window, self.held.levels
        place = math.log(level / least) / math.log(largest / least)
        return np.append(y.ravel() / self.scale, [(frequency - low) / (high - low), place])

    def unpacked_all(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coefficients (m, n, 2 H + 1), frequencies [Hz] and levels (m,) of points (m, d)."""
        own = [self.unpacked(point) for point in z]
        y, frequency, level = (np.array(part) for part in zip(*own, strict=True))
        return y, frequency, level

    def packed_all(self, y: np.ndarray, frequency: np.ndarray, level: np.ndarray) -> np.ndarray:
        """Points (m, d) of coefficients (m, n, 2 H + 1), frequencies [Hz] and levels (m,)."""
        own = zip(y, frequency.tolist(), level.tolist(), strict=True)
        return np.array([self.packed(*point) for point in own])

    @cached_property
    def _units(self) -> np.ndarray:
        return self.scale * self.held.balance.units(2.0 * math.pi * self.held.window[1])

    @cached_property
    def _weight(self) -> float:
        balance, drive = self.held.balance, self.held.drive(self.level)
        still = np.zeros((len(balance.system.stiffness), balance.size))
        loads = balance.derivatives(still, 2.0 * math.pi * self.held.window[0], drive)[2]
        return float(np.linalg.norm(drive * loads.ravel() / self._units)) or 1.0

    def residual(self, z: np.ndarray) -> np.ndarray:
        """What is left of the balance, and of the condition (d - 1,)."""
        y, frequency, level = self.unpacked(z)
        if not math.isfinite(level):
            return np.full(z.size - 1, np.nan)
        left = self.held.balance.residual(y, 2.0 * math.pi * frequency, self.held.drive(level)).ravel() / self._units
        condition = self.condition(self.held.first_harmonic(y, frequency, level), frequency, level)
        return np.append(left, self._weight * condition.value)

    def residuals(self, z: np.ndarray) -> np.ndarray:
        """Residuals (m, d - 1) of points (m, d); NaN where one of them has no level."""
        y, frequency, level = self.unpacked_all(z)
        if not np.isfinite(level).all():
            return np.full((len(z), z.shape[1] - 1), np.nan)
        motions = y, 2.0 * np.pi * frequency, self.held.per_unit * level
        balance = self.held.balance
        left = balance.balanced(*motions, balance.loads_of_all(*motions)).reshape(len(z), -1) / self._units
        own = zip(y, frequency.tolist(), level.tolist(), strict=True)
        conditions = [self.condition(self.held.first_harmonic(*point), *point[1:]).value for point in own]
        return np.column_stack([left, self._weight * np.array(conditions)])

    def forces(self, z: np.ndarray) -> list[Forces]:
        """Forces along the motions of points (m, d)."""
        y, frequency, level = self.unpacked_all(z)
        return self.held.balance.forces_of_all(y, 2.0 * np.pi * frequency, self.held.per_unit * level)

    def derivative(self, z: np.ndarray) -> np.ndarray:
        """Derivative (d - 1, d) of the residual."""
        y, frequency, level = self.unpacked(z)
        (low, high), (least, largest) = self.held.window, self.held.levels
        drive, by_level = self.held.drive(level), self.held.drive(level) * math.log(largest / least)
        parts = self.held.balance.derivatives(y, 2.0 * math.pi * frequency, drive)
        balance = np.column_stack(
            [self.scale * parts[0], 2.0 * math.pi * (high - low) * parts[1].ravel(), by_level * parts[2].ravel()]
        )
        row, of_drive = self.held.first_harmonic_row
        change = np.concatenate([self.scale * row, [0.0, by_level * of_drive]])
        condition = self.condition(self.held.first_harmonic(y, frequency, level), frequency, level)
        slope = condition.slope(change)
        slope[-2] += (high - low) * condition.by_frequency
        slope[-1] += level * math.log(largest / least) * condition.by_level
        return np.vstack([balance / self._units[:, None], self._weight * slope])

    def start(self, y: np.ndarray, frequency: float, level: float, vary: int) -> SeriesMotion | None:
        """Point at which parameter `vary` (0 frequency, 1 level) is free, followed towards more of the other one."""
        z = self.packed(y, frequency, level)
        free = np.delete(np.arange(z.size), -2 if vary == 1 else -1)

        def whole(u: np.ndarray) -> np.ndarray:
            full = z.copy()
            full[free] = u
            return full

        u, _, reason = newton(
            lambda u: self.residual(whole(u)), lambda u: self.derivative(whole(u))[:, free], z[free], MAX_FIRST_STEPS
        )
        heading = np.eye(z.size)[-2 if vary == 1 else -1]
        return None if reason else self.point(whole(u), (0.0,), heading)

    def point(self, z: np.ndarray, steps: tuple[float, ...], heading: np.ndarray) -> SeriesMotion | None:
        """Point at a solution, its tangent along `heading` (d,); None where the derivative is not known."""
        matrix = self.derivative(z)
        if not np.isfinite(matrix).all():
            return None
        y, frequency, level = self.unpacked(z)
        omega, drive, balance = 2.0 * math.pi * frequency, self.held.drive(level), self.held.balance
        return SeriesMotion(
            z, null_vector(matrix, heading), balance.multipliers(y, omega, drive), matrix, len(steps) - 1,
            balance.clearance(y, drive), self.parameters, balance.left_out(y, omega, drive),
        )  # fmt: skip

    def predicted(self, base: SeriesMotion, before: SeriesMotion, step: float) -> np.ndarray:
        """Guess on the cubic through the last two points."""
        return along_cubic(base, before, step)

    def obstacle(self, base: SeriesMotion, point: SeriesMotion) -> str:
        """Nothing."""
        return ""

    def marks(self, base: SeriesMotion, ahead: SeriesMotion) -> list[Mark[SeriesMotion]] | None:
        """Where a rigid stop is touched, and the curve ends."""
        if ahead.clearance >= 0.0:
            return []
        touch = root(self, base, ahead, lambda point, _: point.clearance)
        return None if touch is None else [Mark("grazing", touch, AT_STOP, last=True)]

    def where(self, point: SeriesMotion) -> str:
        """Frequency and level of a point."""
        _, frequency, level = self.unpacked(point.z)
        return f"{frequency:g} Hz, {level:g} {self.held.unit}"


def held_system(setting: Setting, frequency: float, level: float) -> ModalSystem:
    """Return the modal system of a setting, of which an amplitude or a phase can be held.

    frequency, level : of the excitation  [Hz], [N or m]

    Raises
    ------
    CalibError : the simulator tells none, or has forces that harmonic balance does not serve, or a drive with harmonics
    """
    system = modal_system(setting, frequency, level)
    if system.distortion is not None:
        raise CalibError(
            "the drive has harmonics, beside which neither a phase nor an amplitude is held; leave out the effects "
            "on the excitation"
        )
    return system


class HeldBalance:
    """Harmonic balance that the curves of one body share, over windows of frequency and level."""

    def __init__(
        self, setting: Setting, body: str, window: tuple[float, float], levels: tuple[float, float], harmonics: int
    ) -> None:
        if not 0.0 < window[0] < window[1] < math.inf:
            raise CalibError(f"expected frequencies that rise from above 0, got {window[0]:g} to {window[1]:g} Hz")
        if not 0.0 < levels[0] < levels[1] < math.inf:
            raise CalibError(f"expected levels that rise from above 0, got {levels[0]:g} to {levels[1]:g}")
        bodies = setting.map({FREQUENCY: window[0], AMPLITUDE: levels[1]}).bodies
        if body not in bodies:
            raise CalibError(f"no body {body!r}{nearest(body, bodies)}; there are {', '.join(bodies)}")
        self.balance = HarmonicBalance(held_system(setting, window[0], levels[1]), harmonics)
        self.body, self.bodies, self.window, self.levels = body, tuple(bodies), window, levels
        self.unit = setting.unit(AMPLITUDE)
        self.per_unit = self.balance.system.amplitude / levels[1]
        self.begin = setting.section_phase

    def drive(self, level: float) -> float:
        """Amplitude of U at a level."""
        return self.per_unit * level

    def linear(self, frequency: float, level: float) -> np.ndarray:
        """Coefficients of the linear motion."""
        return self.balance.linear_motion(2.0 * math.pi * frequency, self.drive(level))

    @cached_property
    def first_harmonic_row(self) -> tuple[np.ndarray, complex]:
        """Complex derivatives of H_1 of the body by the coefficients (n (2 H + 1),) and by the drive's amplitude."""
        index, system = self.bodies.index(self.body), self.balance.system
        turn = complex(np.exp(1j * (system.phase - self.begin)))
        row = np.zeros((len(system.stiffness), self.balance.size), dtype=complex)
        row[:, 1], row[:, 2] = system.bodies.shape[index] * turn, -1j * system.bodies.shape[index] * turn
        return row.ravel(), complex(system.bodies.drive[index]) * turn

    def first_harmonic(self, y: np.ndarray, frequency: float, level: float) -> complex:
        """Complex amplitude H_1 of the body  [m]."""
        row, of_drive = self.first_harmonic_row
        return complex(row @ y.ravel() + of_drive * self.drive(level))

    def per_level(self, frequency: np.ndarray) -> np.ndarray:
        """H_1 (k,) of the body in the linear motion for a level of 1 at frequencies (k,)  [m over the unit of it]."""
        row, of_drive = self.first_harmonic_row
        drive = self.drive(self.levels[1])
        y = self.balance.linear_motion(2.0 * np.pi * frequency, drive).reshape(frequency.size, -1)
        return (y @ row + of_drive * drive) / self.levels[1]

    def held_at(
        self, amplitude: LevelCurve, read: ReadHarmonic | None, frequency: float, level: float
    ) -> tuple[np.ndarray, float]:
        """Coefficients and level of the motion at an amplitude: at once, or by steps from a small one.

        level : of the linear motion at this amplitude

        Raises
        ------
        CalibError : Newton's method finds none
        """
        y, reached, step = self.linear(frequency, level), 0.0, 1.0
        while reached < 1.0:
            share = min(1.0, reached + step)
            guess, ahead = self._driven_into(share / (reached or 1.0) * y, frequency, share / (reached or 1.0) * level)
            curve = HeldCurve(self, modulus(amplitude, read, share), float(np.abs(y).max()) or 1.0, ahead)
            found = curve.start(guess, frequency, ahead, vary=1)
            if found is not None:
                y, _, level = curve.unpacked(found.z)
                reached, step = share, 2.0 * step
                continue
            step /= 2.0
            if step < MIN_RAMP_STEP:
                raise CalibError(f"Newton's method finds no motion beyond {reached:.0%} of that amplitude")
        return y, level

    def _driven_into(self, y: np.ndarray, frequency: float, level: float) -> tuple[np.ndarray, float]:
        """Coefficients of a motion whose first harmonics the excitation balances best, shifted in time, and its level.

        Of a single body, whose one force is what is left of its equation, that is a solution but for other harmonics,
        however large the damping is, and whichever sign it has.
        """
        omega = 2.0 * math.pi * frequency
        left, driven = (self.balance.residual(y, omega, self.drive(own)) for own in (0.0, level))
        forces, loads = (own[:, 1] - 1j * own[:, 2] for own in (left, driven - left))
        size = float(np.vdot(loads, loads).real)
        factor = -complex(np.vdot(loads, forces)) / size if size else 0.0j
        if not factor:
            return y, level
        order = np.arange(1, self.balance.harmonics + 1)
        shifted = (y[:, 1::2] - 1j * y[:, 2::2]) * (factor / abs(factor)) ** -order
        moved = y.copy()
        moved[:, 1::2], moved[:, 2::2] = shifted.real, -shifted.imag
        return moved, level * abs(factor)

    def followed(
        self, condition: Condition, begin: tuple[np.ndarray, float, float], vary: int, most: int
    ) -> HeldBranch:
        """Curve from a motion.

        Parameters
        ----------
        begin : coefficients, frequency [Hz] and level near those of the motion
        vary : as in `HeldCurve.start`
        most : points of the curve

        Raises
        ------
        CalibError : there is no such motion, or it has impacts; says why without naming the curve
        """
        y, frequency, level = begin

        def at_scale(scale: float) -> tuple[tuple[HeldCurve, OneWay[SeriesMotion]], list[SeriesMotion]] | None:
            curve = HeldCurve(self, condition, scale, level)
            start = curve.start(y, frequency, level, vary)
            if start is None:
                return None
            if start.clearance < 0.0:
                raise CalibError(AT_STOP)
            onward = run(curve, start, most)
            return (curve, onward), onward.points

        found = at_own_scale(float(np.abs(y).max()) or 1.0, at_scale)
        if found is None:
            raise CalibError("Newton's method finds no motion near the linear one")
        curve, way = found
        z, stable, left_out = (
            np.array([part(motion) for motion in way.points])
            for part in (attrgetter("z"), attrgetter("stable"), attrgetter("left_out"))
        )
        return self._branch(curve, z, stable, left_out, way.reason)

    def beside(self, condition: Condition, known: HeldBranch, to_first_order: bool) -> HeldBranch | None:
        """Curve over the window beside a known one of other parameters; None where it is sought without that.

        That is where the known one is not over the whole window or has other modes or harmonics, and where the new one
        needs other steps or comes to a stop. To first order in the change of parameters, as derivatives need it, it is
        as stable as the known one, and is described by as many harmonics.
        """
        balance, curve = self.balance, HeldCurve(self, condition, known.scale, float(known.level[0]))
        if known.coefficients.shape[1:] != (len(balance.system.stiffness), balance.size):
            return None
        begin = curve.packed_all(known.coefficients, known.frequency, known.level)
        if np.abs(begin[[0, -1], curve.run_over] - [0.0, 1.0]).max() > EDGE_ROUNDING:
            return None
        if to_first_order:
            z = first_order_curve(curve, begin)
            return None if z is None else self._branch(curve, z, known.stable, known.left_out, known.end)
        found = neighbour_curve(curve, begin)
        if found is None:
            return None
        z, forces = found
        y, frequency, level = curve.unpacked_all(z)
        motions = list(
            zip(forces, y, (2.0 * np.pi * frequency).tolist(), (self.per_unit * level).tolist(), strict=True)
        )
        suits = MIN_SIZE_RATIO <= np.abs(z[:, :-2]).max() <= MAX_SIZE_RATIO
        close = np.linalg.norm(np.diff(z, axis=0), axis=1).max() <= MAX_SPACING_RATIO * MAX_ARCLENGTH_STEP
        if not (suits and close) or any(balance.clearance(own, at) < 0.0 for _, own, _, at in motions):
            return None
        stable = np.array([abs(balance.multipliers_by(own, at)[0]) < 1.0 for own, _, at, _ in motions])
        left_out = np.array([balance.left_out_by(*motion) for motion in motions])
        return self._branch(curve, z, stable, left_out, known.end)

    def _branch(
        self, curve: HeldCurve, z: np.ndarray, stable: np.ndarray, left_out: np.ndarray, end: str
    ) -> HeldBranch:
        """Branch of the motions at points (m, d) of a curve."""
        y, frequency, level = curve.unpacked_all(z)
        drives = (self.per_unit * level).tolist()
        harmonics = [self.balance.body_amplitudes(own, d, self.begin) for own, d in zip(y, drives, strict=True)]
        return HeldBranch(
            self.body, frequency, level, self.bodies, np.moveaxis(np.array(harmonics), 0, -1), stable, left_out, y,
            curve.scale, end,
        )  # fmt: skip
