"""Harmonic balance: periodic motions of a modal system as Fourier series that balance its forces harmonic by harmonic.

The motion is y(t) = Y_0 + sum over k = 1..H of (a_k cos k tau + b_k sin k tau), tau the phase of the drive. Its forces
are evaluated at instants of one period and transformed back (alternating frequency/time: Cameron & Griffin, J. Appl.
Mech. 56 (1989) 149), so that a residual is left in the equations of each harmonic up to H, and none is looked at above.
What a series of H harmonics misses is of the order of the first harmonic left out.
"""

import math
from collections.abc import Iterable, Iterator
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from calib.modelling.modal_system import Forces, InnerStates, ModalSystem

SAMPLES_PER_HARMONIC = 16  # instants of a period over the highest harmonic: those of the forces do not fold onto it
MIN_SMOOTH_SAMPLES, MIN_MARCHED_SAMPLES, MIN_KINKED_SAMPLES = 128, 512, 1024  # of a period: see `ModalSystem`
FORGETTING_RATE = 5.0  # of a slider that does not slide, over the angular frequency  [1]
DRIVE_DIFFERENCE = 1e-4  # of the amplitude of the drive, for the derivative of its distortion by it
CLEARANCE_STEPS = 3  # of Newton's method to the instant of the least clearance


class Motion(NamedTuple):
    """Modal motion (..., n, m), position and rate (..., p, m) at the places, at m instants of a period."""

    modal: np.ndarray
    position: np.ndarray
    rate: np.ndarray


class HarmonicBalance:
    """Equations of a modal system in the coefficients of its motion, n modes times 2 H + 1.

    Coefficients (n, 2 H + 1) are those of 1, cos tau, sin tau, cos 2 tau, sin 2 tau, ...

    Attributes
    ----------
    system : ModalSystem
    harmonics : H
    phase : (m,) instants of a period  [rad]
    drive : of an amplitude -> coefficients (2 H + 1,) of the drive U, and their derivative by it
    """

    def __init__(self, system: ModalSystem, harmonics: int) -> None:
        self.system, self.harmonics = system, harmonics
        least = MIN_MARCHED_SAMPLES if system.marched else MIN_SMOOTH_SAMPLES
        least = MIN_KINKED_SAMPLES if system.kinked else least
        samples = max(least, 1 << (SAMPLES_PER_HARMONIC * harmonics - 1).bit_length())
        self.phase = 2.0 * np.pi * np.arange(samples) / samples
        orders = np.arange(1, harmonics + 1)
        angle = self.phase[:, None] * orders
        self._synthesis = np.ones((samples, 2 * harmonics + 1))  # coefficients -> samples
        self._synthesis[:, 1::2], self._synthesis[:, 2::2] = np.cos(angle), np.sin(angle)
        self._analysis = self._synthesis.T * (2.0 / samples)  # samples -> coefficients
        self._analysis[0] *= 0.5
        self._turn = np.zeros((2 * harmonics + 1, 2 * harmonics + 1))  # coefficients of the derivative by tau
        for k in orders:
            self._turn[2 * k - 1, 2 * k], self._turn[2 * k, 2 * k - 1] = k, -k
        self._slope = self._synthesis @ self._turn
        self._identity, self._curvature = np.eye(self.size), self._turn @ self._turn
        self.drive = lru_cache(maxsize=1)(self._drive_series)
        self._loads = lru_cache(maxsize=1)(self._loads_of_drive)
        self._last: tuple[tuple[bytes, float, float], Forces] | None = None

    @property
    def size(self) -> int:
        """Number of coefficients of one mode."""
        return 2 * self.harmonics + 1

    def units(self, omega: float) -> np.ndarray:
        """Stiffness (n (2 H + 1),) of each equation's terms, up to the angular frequency `omega`  [1/s^2]."""
        return np.repeat(np.maximum(np.abs(self.system.stiffness), omega**2), self.size)

    def residual(self, y: np.ndarray, omega: float, amplitude: float) -> np.ndarray:
        """Left-hand sides (n, 2 H + 1) less right-hand sides, of coefficients of a drive of `amplitude` at `omega`."""
        return self.balanced(y, omega, amplitude, self.forces(y, omega, amplitude).value)

    def balanced(
        self, y: np.ndarray, omega: float | np.ndarray, amplitude: float | np.ndarray, forces: np.ndarray
    ) -> np.ndarray:
        """Left-hand sides less right-hand sides (..., n, 2 H + 1) with these `forces` (..., p, m), of many motions too.

        y (..., n, 2 H + 1), omega and amplitude (...,)
        """
        omega = np.asarray(omega)
        return np.asarray(
            self._linear(y, omega) - self._driven(omega, amplitude) - self.system.gain @ (forces @ self._analysis.T)
        )

    def derivatives(self, y: np.ndarray, omega: float, amplitude: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the derivatives of the residual by the coefficients, by omega and by the amplitude of the drive.

        They are (n (2 H + 1), n (2 H + 1)) and twice (n, 2 H + 1); that by omega leaves out an explicit time in the
        forces.
        """
        system, size, places = self.system, self.size, self.system.places
        n = len(system.stiffness)
        forces = self.forces(y, omega, amplitude)
        whole = np.zeros((n, size, n, size))
        modes = np.arange(n)
        whole[modes, :, modes, :] = (
            system.stiffness[:, None, None] * self._identity
            + (2.0 * omega * system.rate)[:, None, None] * self._turn
            + omega**2 * self._curvature
        )
        # with each coefficient of a place; with omega, by which rates rise and the period falls; with the drive
        drive, by_its_amplitude = self.drive(amplitude)
        position, rate = np.zeros((2, *forces.value.shape, size + 2))
        position[..., :size], rate[..., :size] = self._synthesis, omega * self._slope
        rate[..., size] = places.shape @ (y @ self._slope.T) + np.outer(places.drive, self._slope @ drive)
        position[..., -1] = np.outer(places.drive, self._synthesis @ by_its_amplitude)
        rate[..., -1] = omega * np.outer(places.drive, self._slope @ by_its_amplitude)
        stretch = np.zeros(size + 2)
        stretch[size] = -1.0 / omega
        varied = self._analysis @ forces.changed(position, rate, stretch)
        whole -= np.einsum("ja,ai,aks->jkis", system.gain, places.shape, varied[..., :size])
        of_omega, of_amplitude = system.gain @ varied[..., size], system.gain @ varied[..., -1]
        slope = self.slope(y)
        by_omega = 2.0 * omega * self.slope(slope) + 2.0 * system.rate[:, None] * slope - of_omega
        loads, by_its = self._loads(amplitude)
        by_omega -= loads[1] + 2.0 * omega * loads[2]
        by_amplitude = -of_amplitude - (by_its[0] + omega * by_its[1] + omega**2 * by_its[2])
        return whole.reshape(n * size, n * size), by_omega, by_amplitude

    def forces(self, y: np.ndarray, omega: float, amplitude: float) -> Forces:
        """Forces at the places (p, m) along the motion; those of the motion asked for last are kept."""
        key = y.tobytes(), omega, amplitude
        if self._last is None or self._last[0] != key:
            motion = self.motion(y, omega, amplitude)
            times = (self.phase - self.system.phase) / omega
            self._last = key, self.system.forces(motion.position, motion.rate, times)
        return self._last[1]

    def forces_of_all(self, y: np.ndarray, omega: np.ndarray, amplitude: np.ndarray) -> list[Forces]:
        """Forces along each of k motions: coefficients (k, n, 2 H + 1), angular frequencies and amplitudes (k,)."""
        motions = self._motions(y, omega, amplitude)
        if self.system.marched:
            return [self.system.forces(*own) for own in zip(*motions, strict=True)]
        parts = self.system.forces(*_joined(motions))[:3]
        return [Forces(*own) for own in zip(*(np.split(part, len(y), axis=-1) for part in parts), strict=True)]

    def loads_of_all(self, y: np.ndarray, omega: np.ndarray, amplitude: np.ndarray) -> np.ndarray:
        """Values (k, p, m) of the forces along each of k motions, as `forces_of_all`."""
        motions = self._motions(y, omega, amplitude)
        if self.system.marched:
            return np.stack([self.system.loads(*own) for own in zip(*motions, strict=True)])
        return np.stack(np.split(self.system.loads(*_joined(motions)), len(y), axis=-1))

    def _motions(
        self, y: np.ndarray, omega: np.ndarray, amplitude: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions and rates (k, p, m) at the places, and times (k, m), of k motions."""
        _, position, rate = self.motion(y, omega, amplitude)
        return position, rate, (self.phase - self.system.phase) / omega[:, None]

    def inner_states(self, y: np.ndarray, omega: float, amplitude: float) -> np.ndarray:
        """Internal states (q,) of the forces at the section, linear between the instants; none where there are none."""
        inner = self.forces(y, omega, amplitude).inner if self.system.marched else None
        if inner is None:
            return np.zeros(0)
        around = np.append(self.phase, 2.0 * np.pi), np.column_stack([inner.value, inner.value[:, 0]])
        at = self.system.phase % (2.0 * np.pi)
        return np.array([np.interp(at, around[0], row) for row in around[1]])

    def motion(self, y: np.ndarray, omega: float | np.ndarray, amplitude: float | np.ndarray) -> Motion:
        """Motion of the modes and at the places, of coefficients (..., n, 2 H + 1); omega and amplitude (...,)."""
        places = self.system.places
        omega, modal = np.asarray(omega)[..., None, None], y @ self._synthesis.T
        drive = places.drive[:, None] * self._drives(amplitude)[..., None, :]  # coefficients at the places
        return Motion(
            modal,
            places.shape @ modal + drive @ self._synthesis.T + places.mean[:, None],
            omega * (places.shape @ (y @ self._slope.T) + drive @ self._slope.T),
        )

    def linear_motion(self, omega: float | np.ndarray, amplitude: float | np.ndarray) -> np.ndarray:
        """Coefficients (..., n, 2 H + 1) of the motion without forces; omega and amplitude (...,).

        A mode without stiffness or damping has its rounding. A resonance without damping has the coefficients of one
        that is as broad as rounding.
        """
        omega = np.asarray(omega)
        y, system, square = self._driven(omega, amplitude), self.system, omega[..., None] ** 2
        impedance = system.stiffness - square + 2j * system.rate * omega[..., None]
        impedance = np.where(impedance == 0.0, np.finfo(float).eps * square, impedance)
        answer = (y[..., 1] - 1j * y[..., 2]) / impedance
        y[:] = 0.0
        y[..., 1], y[..., 2] = answer.real, -answer.imag
        return y

    def multipliers(self, y: np.ndarray, omega: float, amplitude: float) -> np.ndarray:
        """Floquet multipliers (2 n,) of the motion, by falling modulus; (2 n + q,) with q internal states.

        Small differences are carried over the period by the exponential of the Magnus series to fourth order (Iserles
        et al., Acta Numerica 9 (2000) 215), two instants a step.
        """
        return self.multipliers_by(self.forces(y, omega, amplitude), omega)

    def multipliers_by(self, forces: Forces, omega: float) -> np.ndarray:
        """Floquet multipliers as `multipliers`, of the motion along which the forces are these."""
        system, n = self.system, len(self.system.stiffness)
        shape, inner = system.places.shape, forces.inner
        dimension = 2 * n + (0 if inner is None else len(inner.place))
        rates = np.zeros((len(self.phase) + 1, dimension, dimension))
        rates[:, :n, n : 2 * n] = np.eye(n)
        rates[:-1, n : 2 * n, :n] = -np.diag(system.stiffness) + np.einsum(
            "ja,at,ai->tji", system.gain, forces.by_position, shape
        )
        rates[:-1, n : 2 * n, n : 2 * n] = -2.0 * np.diag(system.rate) + np.einsum(
            "ja,at,ai->tji", system.gain, forces.by_rate, shape
        )
        if inner is not None:
            rates[:-1, n : 2 * n, 2 * n :] = np.einsum("jq,qt->tjq", system.gain[:, inner.place], inner.force_by_state)
            rates[:-1, 2 * n :] = self._rates_of_states(inner, omega)
        rates[-1] = rates[0]
        step = 4.0 * np.pi / (omega * len(self.phase))
        first, middle, last = rates[:-1:2], rates[1::2], rates[2::2]
        exponent = step / 6.0 * (first + 4.0 * middle + last) - step**2 / 12.0 * (first @ last - last @ first)
        product = _exponential(exponent)
        while len(product) > 1:
            product = product[1::2] @ product[::2]
        multipliers = np.linalg.eigvals(product[0]).astype(complex)
        return multipliers[np.argsort(-np.abs(multipliers), kind="stable")]

    def _rates_of_states(self, inner: InnerStates, omega: float) -> np.ndarray:
        """Derivatives (m, q, 2 n + q) of the rates of internal states.

        A slider that does not slide keeps its place: the multiplier 1 says nothing of the motion's stability, and is
        left out by letting the slider forget.
        """
        shape = self.system.places.shape[inner.place]
        by_state = np.moveaxis(inner.by_state, 2, 0).copy()
        rests = np.flatnonzero(~(inner.by_position.any(axis=1) | inner.by_rate.any(axis=1) | by_state.any(axis=(0, 2))))
        by_state[:, rests, rests] = -FORGETTING_RATE * omega
        by_motion = [np.einsum("qt,qi->tqi", part, shape) for part in (inner.by_position, inner.by_rate)]
        return np.concatenate([*by_motion, by_state], axis=2)

    def clearance(self, y: np.ndarray, amplitude: float) -> float:
        """Least clearance of a rigid stop along the motion [m], inf without one."""
        stop = self.system.clearance
        if stop is None:
            return math.inf
        series = (stop.shape @ y)[0]
        series[0] += stop.mean[0]
        series += stop.drive[0] * self.drive(amplitude)[0]
        slope = self.slope(series)
        curvature = self.slope(slope)
        phase = self.phase[np.argmin(self.at(series, self.phase))]
        for _ in range(CLEARANCE_STEPS):
            rise, bend = self.at(np.stack([slope, curvature]), np.array([phase]))[:, 0]
            if bend <= 0.0:
                break
            phase -= np.clip(rise / bend, -self.phase[1], self.phase[1])
        return float(self.at(series, np.array([phase]))[0])

    def left_out(self, y: np.ndarray, omega: float, amplitude: float) -> float:
        """Velocity of the bodies by the harmonics above H over that by those up to H, both rms  [1].

        To first order: by the forces of those harmonics along the motion, which do not see what they add to it. That is
        seen in the velocity sooner than in the displacement, and forces may depend on either.
        """
        return self.left_out_by(self.forces(y, omega, amplitude), y, omega, amplitude)

    def left_out_by(self, forces: Forces, y: np.ndarray, omega: float, amplitude: float) -> float:
        """Share of the harmonics above H as `left_out`, of the motion along which the forces are these."""
        system = self.system
        order = omega * np.arange(self.harmonics + 1, self.phase.size // 2 + 1)
        load = system.gain @ self._above(forces.value)
        if system.distortion is not None:
            drive = self._above(system.distortion(amplitude, self.phase))
            load += system.load @ (np.stack([np.ones_like(order), 1j * order, -(order**2)]) * drive)
        impedance = system.stiffness[:, None] - order**2 + 2j * system.rate[:, None] * order
        added = order * (system.bodies.shape @ (load / impedance))
        size = float(np.linalg.norm(omega * self.slope(self.bodies(y, amplitude))))
        return float(np.linalg.norm(added)) / size if size > 0.0 else 0.0

    def _above(self, samples: np.ndarray) -> np.ndarray:
        """Complex amplitudes (..., k) of the harmonics above H of samples (..., m) over a period."""
        return np.fft.rfft(samples, axis=-1)[..., self.harmonics + 1 :] * (2.0 / self.phase.size)

    def body_amplitudes(self, y: np.ndarray, amplitude: float, begin: float) -> np.ndarray:
        """Complex amplitudes (body, H + 1) of the displacement [m], as `calib.dynamics.response.ResponseBranch`.

        begin : phase of the excitation at the section  [rad]; the drive's may be turned against it, by a factor on it
            that is negative
        """
        return self.complex_amplitudes(self.bodies(y, amplitude)) * self._turned(begin)

    def of_body_amplitudes(self, amplitudes: np.ndarray, amplitude: float, begin: float) -> np.ndarray:
        """Coefficients (n, 2 H + 1) whose bodies have the complex `amplitudes`, the inverse of `body_amplitudes`."""
        own = self.series(amplitudes / self._turned(begin))
        own[:, 0] -= self.system.bodies.mean
        own -= np.outer(self.system.bodies.drive, self.drive(amplitude)[0])
        return np.linalg.lstsq(self.system.bodies.shape, own, rcond=None)[0]

    def bodies(self, y: np.ndarray, amplitude: float) -> np.ndarray:
        """Coefficients (body, 2 H + 1) of the displacement of every body  [m]."""
        bodies = self.system.bodies
        coefficients = bodies.shape @ y + np.outer(bodies.drive, self.drive(amplitude)[0])
        coefficients[:, 0] += bodies.mean
        return coefficients

    def at(self, coefficients: np.ndarray, phase: np.ndarray) -> np.ndarray:
        """Values (..., k) of Fourier series with `coefficients` (..., 2 H + 1) at phases (k,) [rad]."""
        angle = np.multiply.outer(phase, np.arange(1, self.harmonics + 1))
        basis = np.ones((len(phase), self.size))
        basis[:, 1::2], basis[:, 2::2] = np.cos(angle), np.sin(angle)
        return coefficients @ basis.T

    def _turned(self, begin: float) -> np.ndarray:
        return np.exp(1j * np.arange(self.harmonics + 1) * (self.system.phase - begin))

    def slope(self, coefficients: np.ndarray) -> np.ndarray:
        """Coefficients (..., 2 H + 1) of the derivative by the phase."""
        return coefficients @ self._turn.T

    def complex_amplitudes(self, coefficients: np.ndarray) -> np.ndarray:
        """Complex amplitudes (..., H + 1), the mean first: the real part of the sum of H_k exp(i k tau)."""
        mean = coefficients[..., :1].astype(complex)
        return np.concatenate([mean, coefficients[..., 1::2] - 1j * coefficients[..., 2::2]], axis=-1)

    def series(self, amplitudes: np.ndarray) -> np.ndarray:
        """Coefficients (..., 2 H + 1) of complex amplitudes (..., H + 1), the inverse of `complex_amplitudes`."""
        whole = np.empty((*amplitudes.shape[:-1], self.size))
        whole[..., 0] = amplitudes[..., 0].real
        whole[..., 1::2], whole[..., 2::2] = amplitudes[..., 1:].real, -amplitudes[..., 1:].imag
        return whole

    def _linear(self, y: np.ndarray, omega: np.ndarray) -> np.ndarray:
        system, omega = self.system, omega[..., None, None]
        damping, stiffness = 2.0 * system.rate[:, None] * omega, system.stiffness[:, None]
        return omega**2 * (y @ self._curvature) + damping * self.slope(y) + stiffness * y

    def _driven(self, omega: np.ndarray, amplitude: float | np.ndarray) -> np.ndarray:
        """Modal load (..., n, 2 H + 1) of drives and the constants; omega and amplitude (...,)."""
        if np.ndim(amplitude) == 0:
            loads = self._loads(float(amplitude))[0]
        elif self.system.distortion is None:
            loads = np.asarray(amplitude)[:, None, None] * self._unit_loads[:, None]
        else:
            loads = np.stack([self._loads(own)[0] for own in np.asarray(amplitude).tolist()], axis=1)
        omega = omega[..., None, None]
        load = loads[0] + omega * loads[1] + omega**2 * loads[2]
        load[..., 0] += self.system.constant
        return np.asarray(load)

    def _loads_of_drive(self, amplitude: float) -> tuple[np.ndarray, np.ndarray]:
        """Modal loads (3, n, 2 H + 1) of U, U' and U'' at an angular frequency of 1, and their derivatives by A."""
        if self.system.distortion is None:
            return amplitude * self._unit_loads, self._unit_loads
        drive, by_amplitude = self.drive(amplitude)
        return self._loads_of(drive), self._loads_of(by_amplitude)

    @cached_property
    def _unit_loads(self) -> np.ndarray:
        """Modal loads (3, n, 2 H + 1) as `_loads_of`, of a drive cos tau."""
        return self._loads_of(np.eye(self.size)[1])

    def _loads_of(self, series: np.ndarray) -> np.ndarray:
        """Modal loads (3, n, 2 H + 1) of a drive of coefficients (2 H + 1,), and of its first two derivatives."""
        slopes = np.stack([series, self.slope(series), self.slope(self.slope(series))])
        return np.asarray(self.system.load.T[:, :, None] * slopes[:, None, :])

    def _drives(self, amplitude: float | np.ndarray) -> np.ndarray:
        """Coefficients (..., 2 H + 1) of drives of amplitudes (...,)."""
        if np.ndim(amplitude) == 0:
            return self.drive(float(amplitude))[0]
        return np.array([self.drive(own)[0] for own in np.asarray(amplitude).tolist()])

    def _drive_series(self, amplitude: float) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients (2 H + 1,) of the drive U of an amplitude, and their derivative by it."""
        drive, slope = np.zeros((2, self.size))
        drive[1], slope[1] = amplitude, 1.0
        added = self.system.distortion
        if added is None:
            return drive, slope
        step = DRIVE_DIFFERENCE * (abs(amplitude) or 1.0)
        ahead, behind = added(amplitude + step, self.phase), added(amplitude - step, self.phase)
        drive += self._analysis @ added(amplitude, self.phase)
        return drive, slope + self._analysis @ (ahead - behind) / (2.0 * step)


def _joined(motions: Iterable[np.ndarray]) -> Iterator[np.ndarray]:
    """Positions and rates (p, k m) and times (k m,) of k motions, one after the other."""
    return (np.concatenate(part, axis=-1) for part in motions)


def _exponential(matrices: np.ndarray) -> np.ndarray:
    """Exponentials (k, d, d) of small matrices by the diagonal Pade approximant of third degree."""
    square = matrices @ matrices
    even = np.eye(matrices.shape[-1]) + square / 10.0
    odd = matrices / 2.0 + matrices @ square / 120.0
    return np.linalg.solve(even - odd, even + odd)
