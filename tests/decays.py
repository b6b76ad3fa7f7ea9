"""Free decays whose frequency and damping over amplitude are known in closed form."""

import numpy as np
from scipy.integrate import solve_ivp

from calib.records import make


def record(time, values, sigma=None, channel="displacement", **attrs):
    """Record of one body, `mass`, let go."""
    channels = {channel: values[None]}
    if sigma is not None:
        channels[f"{channel}_sigma"] = np.array([sigma])
    return make(time, ["mass"], channels, place="mass", quantity="free decay", **attrs)


def linear(time, frequency, damping_ratio, phase=0.0):
    """Viscous decay from amplitude 1, of a damped frequency  [Hz]."""
    rate = 2.0 * np.pi * frequency * damping_ratio / np.sqrt(1.0 - damping_ratio**2)
    return np.exp(-rate * time) * np.cos(2.0 * np.pi * frequency * time + phase)


def rubbing(time, frequency, shift):
    """Dry friction, half wave by half wave: the amplitude falls from 1 by two shifts of the rest position each."""
    half = 0.5 / frequency
    stop = int(np.ceil(0.5 * (1.0 / shift - 1.0)))
    number = np.minimum((time / half).astype(int), stop)
    sign = np.where(number % 2 == 0, 1.0, -1.0)
    turning = 1.0 - 2.0 * shift * number
    moving = sign * ((turning - shift) * np.cos(2.0 * np.pi * frequency * (time - number * half)) + shift)
    return np.where(number < stop, moving, sign * turning)


def integrated(time, force, start=1.0):
    """Motion of x'' = force(x, x'), let go at `start`."""
    span = (time[0], time[-1])
    return solve_ivp(lambda _, s: [s[1], force(*s)], span, [start, 0.0], t_eval=time, rtol=1e-10, atol=1e-13).y[0]


def bouncing(time, frequency, restitution):
    """Mass on a spring that a stop at its rest position throws back: half waves of one sign, of falling height."""
    return restitution ** np.floor(2.0 * frequency * time) * np.abs(np.sin(2.0 * np.pi * frequency * time))


def noisy(values, noise, seed):
    return values + noise * np.random.default_rng(seed).standard_normal(values.size)
