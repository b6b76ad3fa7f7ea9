"""The clock of a recorder, whose rate no maker states exactly: what a wrong one does to a simulated record."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from calib.diagnosis.bench import Bench, Run, SimulatedRows, simulated
from calib.modelling.effect import Effect
from calib.records.excitation import Excitation
from calib.study import Pool

MAX_CLOCK_RATE = 50e-6  # of a recorder's clock, relative: of quartz oscillators, uniformly distributed within it
CLOCK_RATE_STD = MAX_CLOCK_RATE / 3.0**0.5
RATE_STEP = 1e-4  # by which a recorded excitation is stretched: small beside 1 / (angular frequency * length)


def clock_sensitivity(time: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Change of rows (row, n) with the rate of the clock, which is right at time zero  [per unit rate]."""
    return np.gradient(rows, time, axis=1) * time


def uncertain_clock(excitation: Excitation, time: np.ndarray, rows: np.ndarray) -> np.ndarray | None:
    """Change of the rows (row, n) of a free decay with the rate of its clock [per unit rate]; None of other records.

    The rate of the recorder's clock against that of a steady tone is a nuisance.
    """
    return clock_sensitivity(time, rows) if excitation.quantity == "free decay" else None


def clock_slopes(
    pool: Pool,
    bench: Bench,
    seen: Mapping[str, SimulatedRows],
    values: Mapping[str, float],
    effects: tuple[Effect, ...] = (),
) -> dict[str, np.ndarray]:
    """Change of the rows (row, n) of records with the rate of a clock that is uncertain and no nuisance.

    A recorded excitation is sampled by the clock of the motion: what a wrong rate stretches is both, and it shows
    only as far as the structure has a time of its own. That is simulated, with the excitation as it came and stretched.

    Parameters
    ----------
    seen : simulations by record
    values, effects : of the model that they are of

    Returns
    -------
    by record, per unit rate; without those of steady tones, and of records that a simulator samples otherwise
    """
    found, runs = {}, []
    for name, view in seen.items():
        reference = bench.objective.references[name]
        excitation, time = reference.excitation, reference.record.time.values
        own = uncertain_clock(excitation, time, view.rows)
        if own is not None:
            found[name] = own
        elif excitation.recorded and not excitation.periodic:
            times = time if reference.request.times is None else reference.request.times
            for rate in (1.0, 1.0 + RATE_STEP):
                stretched = replace(excitation, time=rate * excitation.time)
                runs.append(Run(name, values, effects, excitation=stretched, start=view.start, times=rate * times))
    views = simulated(pool, runs)
    for run, before, after in zip(runs[::2], views[::2], views[1::2], strict=True):
        rows = seen[run.record].rows
        if before.usable and after.usable and before.rows.shape == after.rows.shape == rows.shape:
            found[run.record] = (after.rows - before.rows) / RATE_STEP
    return found
