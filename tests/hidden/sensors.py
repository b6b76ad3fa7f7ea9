"""What instruments do to a motion: each law turns one way of looking at it into another."""

from collections.abc import Callable, Mapping

import numpy as np
from hidden.motion import Look

Change = Callable[[np.ndarray, np.ndarray, np.ndarray, Look], tuple[np.ndarray, np.ndarray]]


def sensed(look: Look, hidden: Mapping[str, float], times: np.ndarray) -> Look:
    """Look through the instruments.

    Parameters
    ----------
    look : times [s] -> displacement and velocity, (body, m) each
    hidden : parameters of the hidden effects by name; those of no instrument are passed over
    times : (n,) instants of the record  [s]
    """
    for names, law in LAWS.items():
        if set(names) & set(hidden):
            look = _changed(look, law(times, *(hidden.get(name, ABSENT.get(name, 0.0)) for name in names), look))
    return look


def _changed(look: Look, change: Change) -> Look:
    return lambda times: change(times, *look(times), look)


def _gain(times, a, b, look):
    return lambda t, x, v, look: ((1.0 + a) * x, (1.0 + b) * v)


def _bent(times, a, b, look):
    return lambda t, x, v, look: (x + a * x**3, v + b * v**3)


def _offset(times, a, b, look):
    return lambda t, x, v, look: (x + a, v + b)


def _drift(times, a, b, look):
    return lambda t, x, v, look: (x + a * (t - times[0]), v + b * (t - times[0]))


def _lag(times, lag, look):
    return lambda t, x, v, look: (x, look(t - lag)[1])


def _differencing(times, share, look):
    step = times[1] - times[0]
    return lambda t, x, v, look: (x, v + share * ((x - look(t - step)[0]) / step - v))


def _shear(times, shear, look):
    return lambda t, x, v, look: (x + shear * v, v)


def _scale(times, a, look):
    return lambda t, x, v, look: ((1.0 + a) * x, (1.0 + a) * v)


def _tilt(times, angle, look):
    largest_x, largest_v = (np.abs(channel).max(axis=1, keepdims=True) for channel in look(times))
    ratio = largest_x / largest_v
    return lambda t, x, v, look: (x - angle * v * ratio, v + angle * x / ratio)


def _clipping(times, a, b, look):
    return lambda t, x, v, look: (np.clip(x, -a, a), np.clip(v, -b, b))


def _rounded(values, quantum):
    return np.round(values / quantum) * quantum if quantum > 0.0 else values


def _quantisation(times, a, b, look):
    return lambda t, x, v, look: (_rounded(x, a), _rounded(v, b))


def converted(rows: np.ndarray, hidden: Mapping[str, float]) -> np.ndarray:
    """Rows (2 b, n) with their noise as a converter gives them: cut off, then rounded."""
    out = rows.copy()
    for half, channel in zip(np.split(out, 2), ("displacement", "velocity"), strict=True):
        level = hidden.get(f"clip_{channel}", np.inf)
        half[:] = _rounded(np.clip(half, -level, level), hidden.get(f"quantum_{channel}", 0.0))
    return out


CONVERTER = ("clip_displacement", "clip_velocity", "quantum_displacement", "quantum_velocity")
ABSENT = {"clip_displacement": np.inf, "clip_velocity": np.inf}
LAWS = {  # in the order in which a signal meets them; the low-pass goes with the equations of motion
    ("lag",): _lag,
    ("differencing",): _differencing,
    ("cubic_displacement", "cubic_velocity"): _bent,
    ("gain_displacement", "gain_velocity"): _gain,
    ("offset_displacement", "offset_velocity"): _offset,
    ("drift_displacement", "drift_velocity"): _drift,
    ("shear",): _shear,
    ("plot_scale",): _scale,
    ("tilt",): _tilt,
    ("clip_displacement", "clip_velocity"): _clipping,
    ("quantum_displacement", "quantum_velocity"): _quantisation,
}
