"""Oscillators whose motions are known: in closed form, or from an integration of their own."""

import math

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.model import Model
from calib.modelling.parameter import Parameter
from calib.records.excitation import Excitation
from calib.simulators.oscillator import Oscillator

GRAVITY = 9.81  # m/s^2
TURN = 2.0 * math.pi


class Ball:
    """Ball on a table that moves by A sin(w t): r'' = -g (1 - G sin(w t)) above it, r' -> -e r' on it, G = A w^2 / g.

    Of finite amplitude, that is not the map of the high bounce (Holmes 1982, J. Sound Vib. 84, 173-189; Guckenheimer
    and Holmes, section 2.4). With one impact in k periods the ball leaves the table with the absolute velocity g T / 2,
    T = 2 pi k / w, and comes back with -g T / 2, so that the closing speed and the phase of the impact are

        W = g T / (1 + e),   cos(phi) = pi k (1 - e) / ((1 + e) G)

    Between impacts (dr, dr') -> (dr + T dr', dr'), at one dr -> -e dr, dr' -> -e dr' - (1 + e) r'' dr / W: the
    multipliers have the product e^2 and the sum 1 + e^2 - (1 + e)^2 G sin(phi). One is 1 where sin(phi) = 0, and -1
    where G sin(phi) = 2 (1 + e^2) / (1 + e)^2 (Bapat, Sankar and Popplewell 1986, J. Sound Vib. 108, 99-115; Luo and
    Han 1996, Nonlinear Dynamics 10, 1-18).
    """

    frequency, mass, phase = 10.0, 0.2, 0.75  # Hz, kg, place of the section in the period [1]

    def __init__(self, drive: float, e: float, k: int = 1):
        self.drive, self.e, self.k = drive, e, k

    def map(self):
        """Its period map: x = -r, so that the load pulls towards the stop at 0."""
        weight = self.mass * GRAVITY
        values = {"mass": self.mass, "stiffness": 0.0, "damping": 0.0, "load": weight, "gap": 0.0}
        shaken = Excitation("mass", "force", frequency=self.frequency, amplitude=weight * self.drive, phase=math.pi / 2)
        return Model(Oscillator(stop=True)).period_map({**values, "restitution": self.e}, shaken, self.phase)

    @property
    def fold(self):
        return math.pi * self.k * (1.0 - self.e) / (1.0 + self.e)

    @property
    def flip(self):
        return math.hypot(self.fold, 2.0 * (1.0 + self.e**2) / (1.0 + self.e) ** 2)

    @property
    def impact(self):
        """Phase [rad] and closing speed [m/s]."""
        return math.acos(self.fold / self.drive), GRAVITY * self.k / self.frequency / (1.0 + self.e)

    @property
    def state(self):
        """Displacement [m] and velocity [m/s] at the section."""
        omega, (phi, _) = TURN * self.frequency, self.impact
        table = self.drive * GRAVITY / omega**2
        since, up = (TURN * self.phase - phi) % TURN / omega, 0.5 * GRAVITY * self.k / self.frequency
        ball = table * math.sin(phi) + up * since - 0.5 * GRAVITY * since**2
        rise = up - GRAVITY * since - table * omega * math.cos(TURN * self.phase)
        return np.array([table * math.sin(TURN * self.phase) - ball, -rise])

    @property
    def multipliers(self):
        total = 1.0 + self.e**2 - (1.0 + self.e) ** 2 * self.drive * math.sin(self.impact[0])
        return np.roots([1.0, -total, self.e**2])

    def flight(self, phi, speed):
        """Duration [rad] and closing speed of the flight that leaves the table at phi, speeds in units of g / w."""

        def height(s):
            return (
                (speed + self.drive * math.cos(phi)) * s
                - 0.5 * s * s
                - self.drive * (math.sin(phi + s) - math.sin(phi))
            )

        step = min(0.02, speed / (1.0 + self.drive)) or 0.02  # that far, no flight can be over
        n = 1
        while height((n + 1) * step) > 0.0:
            n += 1
        s = brentq(height, n * step, (n + 1) * step, xtol=1e-15, rtol=1e-14)
        return s, s - speed - self.drive * (math.cos(phi) - math.cos(phi + s))

    def bounces(self, count):
        """Phases [rad], closing speeds [g / w], durations [rad] (count, 3) of bounces that begin a hundredth off."""
        phi, closing = self.impact[0], 1.01 * TURN * self.k / (1.0 + self.e)
        rows = []
        for _ in range(count):
            s, closing = self.flight(phi, self.e * closing)
            phi = (phi + s) % TURN
            rows.append((phi, closing, s))
        return np.array(rows)


class Impacting:
    """x'' + c x' + x = F cos(w t) with x <= 1 and r' -> -e r' there: one impact per period in closed form.

    The free part of the motion, z = (x, x') less the steady motion X cos(theta), goes over a period T by expm(A T) from
    (1 - X cos(theta), -e W + w X sin(theta)) to (1 - X cos(theta), W + w X sin(theta)). That is linear in
    1 - X cos(theta) = p W and w X sin(theta) = q W, so that with cos^2 + sin^2 = 1 the closing speed W is a root of

        (p^2 + q^2 / w^2) W^2 - 2 p W + 1 - X^2 = 0

    A fold is where both roots are one; at X = 1 one of them is W = 0, which is the grazing of the linear motion (Shaw
    and Holmes 1983, J. Sound Vib. 90, 129-155). With the accelerations a- and a+ before and after the impact, the
    derivative of one return is

        ((-e, 0), ((e a- + a+) / W, -e)) expm(A T)
    """

    c, e = 0.2, 0.5
    names = {"mass": 1.0, "stiffness": 1.0, "damping": c, "gap": 1.0, "restitution": e}

    def __init__(self, F=0.3):
        self.F = F

    def map(self, w):
        shaken = Excitation("mass", "force", frequency=w / TURN, amplitude=self.F)
        return Model(Oscillator(stop=True)).period_map(self.names, shaken, 0.5)

    def amplitude(self, w):
        return self.F / math.hypot(1.0 - w * w, self.c * w)

    def quadratic(self, w):
        """Coefficients (3,) of the quadratic equation for W, of falling power."""
        p, q = self.shares(w)
        return np.array([p * p + q * q / w**2, -2.0 * p, 1.0 - self.amplitude(w) ** 2])

    def flight(self, w):
        """Derivative (2, 2) of the flight of a period."""
        return expm(np.array([[0.0, 1.0], [-1.0, -self.c]]) * TURN / w)

    def shares(self, w):
        """Factors p and q (2,)."""
        whole = self.flight(w)
        return np.linalg.solve(np.eye(2) - whole, [-self.e * whole[0, 1], -1.0 - self.e * whole[1, 1]])

    def multipliers(self, w):
        """Multipliers (2,) of the faster one of two motions."""
        speed, (p, q) = self.impact(w), self.shares(w)
        force = (1.0 - w * w) * (1.0 - p * speed) - self.c * q * speed
        before, after = force - self.c * speed - 1.0, force + self.c * self.e * speed - 1.0
        jump = np.array([[-self.e, 0.0], [(self.e * before + after) / speed, -self.e]])
        return np.linalg.eigvals(jump @ self.flight(w))

    def impact(self, w):
        """Closing speed of the faster one of two motions."""
        return np.roots(self.quadratic(w)).max()

    @property
    def fold(self):
        def discriminant(w):
            a, b, c = self.quadratic(w)
            return b * b - 4.0 * a * c

        return brentq(discriminant, 1.12, 1.5, xtol=1e-14)

    @property
    def grazing(self):
        """The two frequencies [rad/s] at which the linear amplitude is the gap."""
        square = np.roots([1.0, self.c**2 - 2.0, 1.0 - self.F**2])
        return np.sqrt(np.sort(square))


@force
def cubic(t, x, v, p, z, dz):
    """Return the force of a cubic spring per mass."""
    return -p[0] * x * x * x


@force
def self_excited(t, x, v, p, z, dz):
    """Return van der Pol's damping per mass."""
    return p[0] * (1.0 - x * x) * v


CUBIC, VAN_DER_POL = (
    Effect(law.name, "force", law, (Parameter(name, unit, 1.0, "of the law", null=0.0),), meaning="for the test")
    for law, name, unit in ((cubic, "k3", "1/(m^2 s^2)"), (self_excited, "mu", "1/s"))
)


def driven(effect, w, amplitude, start=(0.0, 0.0), **values):
    """Period map of the unit mass with `effect`, driven by `amplitude` [N] at w [rad/s]."""
    shaken = Excitation("mass", "force", frequency=w / TURN, amplitude=amplitude)
    given = {"mass": 1.0, "initial_displacement": start[0], "initial_velocity": start[1], **values}
    return Model(Oscillator(), [effect]).period_map(given, shaken)


def duffing(c, k, k3, amplitude, w=1.0, start=(0.0, 0.0)):
    """Period map of x'' + c x' + k x + k3 x^3 = amplitude cos(w t)."""
    return driven(CUBIC, w, amplitude, start, damping=c, stiffness=k, k3=k3)


def duffing_exponent(c, k, k3, amplitude, start=(0.0, 0.0), many=64, periods=60, dropped=40, steps=300):
    """Largest exponent [1/period] at w = 1 and its standard error: many motions at once by Runge and Kutta."""
    h, rng = TURN / steps, np.random.default_rng(1)
    y = np.stack([start[0] + 0.1 * rng.normal(size=many), start[1] + 0.1 * rng.normal(size=many)])
    y = np.vstack([y, np.ones(many), np.zeros(many)])

    def rate(t, y):
        x, v, dx, dv = y
        a = amplitude * math.cos(t) - c * v - k * x - k3 * x * x * x
        return np.stack([v, a, dv, -c * dv - k * dx - 3.0 * k3 * x * x * dx])

    total = np.zeros(many)
    for period in range(dropped + periods):
        for step in range(steps):
            t = step * h
            one = rate(t, y)
            two = rate(t + 0.5 * h, y + 0.5 * h * one)
            three = rate(t + 0.5 * h, y + 0.5 * h * two)
            y = y + h / 6.0 * (one + 2.0 * two + 2.0 * three + rate(t + h, y + h * three))
        length = np.hypot(y[2], y[3])
        y[2:] /= length
        total += np.log(length) if period >= dropped else 0.0
    return total.mean() / periods, total.std(ddof=1) / periods / math.sqrt(many)
