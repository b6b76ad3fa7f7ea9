"""Records of motions in closed form: smooth loops, loops with a jump of velocity, and motions of other kinds."""

import numpy as np

from calib.records import make

FREQUENCY = 25.0  # Hz
OMEGA = 2.0 * np.pi * FREQUENCY
SIGMA = {"displacement": 0.01e-3, "velocity": 3e-3}  # m, m/s


def clapping(
    size=1.0,
    trigger=0.0,
    impact=0.3012,
    jump=0.4,
    periods=6,
    samples=400,
    start=0.0,
    subharmonic=0.0,
    wander=None,
    section=0,
    contacts=True,
    **attrs,
):
    """Record of a beam in harmonic motion and a layer whose velocity jumps up once per period.

    Parameters
    ----------
    size : factor on all motion
    trigger : instant of the motion at which time is zero  [s]
    impact : phase of the jump  [1, in periods]
    jump : change of the layer's velocity  [m/s]; 0 is a smooth loop
    start : first instant of the record  [s]
    subharmonic : share of a motion of twice the period
    wander : (cycle,) factors on the layer's motion from cycle to cycle
    section : periods of the section at phase 0 that follow the record, 0 for none
    """
    period = 1.0 / FREQUENCY
    time = start + np.arange(periods * samples) * period / samples
    layer = _layer(time + trigger, period, impact, jump, subharmonic, wander)
    beam = 2e-3 * np.array([np.cos(OMEGA * (time + trigger)), -OMEGA * np.sin(OMEGA * (time + trigger))])
    stated = {"frequency": FREQUENCY, "amplitude": 1.5e-3, "place": "end", "quantity": "displacement", **attrs}
    both = size * np.stack([beam, layer], axis=1)
    record = make(time, ["beam", "layer"], {"displacement": both[0], "velocity": both[1]}, **stated)
    if contacts:
        first = np.ceil((start + trigger) / period - impact)
        instants = (first + impact + np.arange(periods if jump else 0)) * period - trigger
        record["impact_time"] = ("impact", instants)
    if section:
        at = np.arange(section) * period + trigger
        points = _layer(at, period, impact, jump, subharmonic, wander)
        for channel, layer, beam in zip(("displacement", "velocity"), points, (2e-3, 0.0), strict=True):
            rows = size * np.array([np.full(section, beam), layer])
            record[f"section_{channel}"] = (("body", "period"), rows)
    return record


def _layer(time, period, impact, jump, subharmonic, wander):
    """Displacement [m] and velocity [m/s] of the layer."""
    turns = time / period
    since = (turns - impact) % 1.0  # after the last impact; velocity falls evenly until the next one puts it back up
    omega = 2.0 * np.pi / period
    x = 3e-3 * np.cos(omega * time + 0.4) + jump * period * (0.5 * since - 0.5 * since**2 - 1.0 / 12.0)
    v = -3e-3 * omega * np.sin(omega * time + 0.4) + jump * (0.5 - since)
    x = x + subharmonic * 3e-3 * np.cos(0.5 * omega * time + 0.2)
    v = v - subharmonic * 1.5e-3 * omega * np.sin(0.5 * omega * time + 0.2)
    if wander is not None:
        factor = np.asarray(wander)[np.floor(turns + 1e-9).astype(int) % len(wander)]
        x, v = factor * x, factor * v
    return np.array([x, v])


def chaotic(number, seed=0.3):
    """Factors (number,) about 1 that follow the logistic map."""
    values = [seed]
    while len(values) < number:
        values.append(3.9 * values[-1] * (1.0 - values[-1]))
    return 1.0 + 0.2 * (np.array(values) - 0.5)


def noisy(record, seed=0, stated=True, factor=1.0):
    """Return the record with white noise, as an instrument gives it: no contacts, no section, its sigma stated."""
    rng = np.random.default_rng(seed)
    measured = record.drop_vars([v for v in record.data_vars if v not in ("displacement", "velocity")])
    for channel, sigma in SIGMA.items():
        noise = factor * sigma * rng.standard_normal(record[channel].shape)
        measured[channel] = record[channel].copy(data=record[channel].values + noise)
        if stated:
            measured[f"{channel}_sigma"] = ("body", np.full(2, factor * sigma), {"units": record[channel].units})
    return measured
