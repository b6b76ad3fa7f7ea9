"""The rate of a recorder's clock, known to its tolerance only: what an error of it changes in a record."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from calib.diagnosis.bench import Bench, Run, SimulatedRows, simulated
from calib.modelling.effect import Effect
from calib.records.excitation import Excitation
from calib.study import Pool

MAX_CLOCK_RATE = 50e-6  # relative error of a recorder's clock: quartz oscillators, uniform distribution  [1]
CLOCK_RATE_STD = MAX_CLOCK_RATE / 3.0**0.5  # [1]
RATE_STEP = 1e-4  # relative, of a recorded excitation: small beside 1 / (angular frequency * duration)  [1]


def clock_sensitivity(time: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Change of rows (row, n) with the rate of the clock, which is right at time zero  [per unit rate]."""
    return time_derivative(time, rows) * time


def time_derivative(time: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Derivative of rows (row, n) over the instants (n,) [s], by cubic splines.

    Differences of neighbours would lose a tenth of a harmonic that has eight samples a period.
    """
    return np.asarray(CubicSpline(time, rows, axis=1)(time, 1))


def uncertain_clock(excitation: Excitation, time: np.ndarray, rows: np.ndarray) -> np.ndarray | None:
    """Change of the rows (row, n) of a free decay with the rate of its clock [per unit rate]; None of other records.

    The rate of the recorder's clock against that of a steady tone is a nuisance.
    """
    return clock_sensitivity(time, rows) if excitation.quantity == "free decay" else None


def clock_slopes(
    pool: Pool,
    bench: Bench,
    views: Mapping[str, SimulatedRows],
    values: Mapping[str, float],
    effects: tuple[Effect, ...] = (),
) -> dict[str, np.ndarray]:
    """Change of the rows (row, n) of records with the rate of a clock that is uncertain and no nuisance.

    A recorded excitation is sampled by the clock of the motion: an error of its rate stretches
    both, and changes the response only as far as the structure has time scales of its own. That is simulated, with the
    recorded and with the stretched excitation.

    Parameters
    ----------
    views : simulations by record
    values, effects : of the simulated model

    Returns
    -------
    by record, per unit rate; without those of steady tones, and of records that a simulator samples otherwise
    """
    changes: dict[str, np.ndarray] = {}
    runs: list[Run] = []
    for name, view in views.items():
        reference = bench.objective.references[name]
        if reference.is_swept:
            continue
        excitation, time = reference.excitation, reference.record.time.values
        own = uncertain_clock(excitation, time, view.rows)
        if own is not None:
            changes[name] = own
        elif excitation.time is not None and excitation.recorded and not excitation.periodic:
            times = time if reference.request.times is None else reference.request.times
            for rate in (1.0, 1.0 + RATE_STEP):
                stretched = replace(excitation, time=rate * excitation.time)
                runs.append(Run(name, values, effects, excitation=stretched, start=view.start, times=rate * times))
    answers = simulated(pool, runs)
    for run, before, after in zip(runs[::2], answers[::2], answers[1::2], strict=True):
        rows = views[run.record].rows
        if before.usable and after.usable and before.rows.shape == after.rows.shape == rows.shape:
            changes[run.record] = (after.rows - before.rows) / RATE_STEP
    return changes
