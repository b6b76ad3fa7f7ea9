"""The reduced kernel of the delaminated beam beside the full one: CPU time of a period, error of the phase curve.

    OPENBLAS_NUM_THREADS=1 PYTHONPATH=tests:. python tests/benchmarks/bench_delaminated_beam_reduced.py

CPU seconds, compiled before they are timed, the fastest of some periods that alternate, of the settled motions of the
paper's Figs. 12 to 14, straight and arched; both in this run. The error is the root mean square difference of the
layer's phase curves in the middle, displacement and velocity, once over the root mean square about the mean (as the
feature `phase_curve` has it), once over the amplitude (half of peak to peak). Then the CPU time of whole evaluations,
to the stationary state, at 256 Sobol points of the windows of studies/fe_calibration. With more than one thread, BLAS
counts its waiting as CPU time.

Measured on two shared cores, the lowest level (40 modes, with an arched layer 48):

    Fig. 12   straight   129 times faster   0.87 % of rms, 0.50 % of amplitude
              arched     129                0.81 %         0.43 %
    Fig. 13   straight   303                0.90 %         0.57 %
              arched     437                0.07 %         0.05 %
    Fig. 14   straight  1856                0.89 %         0.56 %
              arched    1248                0.62 %         0.39 %
    256 Sobol points     median 0.10 s, 95 % below 0.30 s, longest 0.38 s
"""

import time
from pathlib import Path

import numpy as np
from scipy.stats import qmc

from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.records import OK
from calib.records.excitation import Excitation
from calib.simulators.delaminated_beam import DelaminatedBeam
from calib.simulators.delaminated_beam.error_estimate import LEVELS
from calib.study_file import load

DRIVE = Excitation("centre", "displacement", frequency=26.51, amplitude=0.92e-3)
COMMON = {"alpha": 500.0, "beta": 0.02, "f": 0.01, "c_con": 5.0}
SETS = {
    "12": {"dt": 3.10e-7, "g_max": 1.0e-3, "s": 0.0},
    "13": {"dt": 3.10e-7, "g_max": 0.5e-3, "s": 0.5e-3},
    "14": {"dt": 9.38e-8, "g_max": 0.2e-3, "s": 0.8e-3},
}
REQUEST = Request(periods=2, samples=400)
REPEATS = {"full": 2, "reduced": 12}


def cpu_of_a_period(simulator: DelaminatedBeam, values, repeats: int) -> float:
    """Least CPU time of a period of the settled motion  [s]."""
    map = Model(simulator).period_map(values, DRIVE)
    engine = map.engine(map.initial, 10**9)
    for _ in range(4):
        engine.period(1)
    least = np.inf
    for _ in range(repeats):
        start = time.process_time()
        engine.period(REQUEST.samples)
        least = min(least, time.process_time() - start)
    return least


def errors(reduced, full) -> tuple[float, float]:
    """Error of the layer's phase curve over its rms about the mean, and over its amplitude  [1]."""
    squares = []
    for channel in ("displacement", "velocity"):
        a, b = (record[channel].sel(body="layer").values for record in (reduced, full))
        difference = np.mean((a - b) ** 2)
        squares.append((difference / b.var(), difference / (0.5 * np.ptp(b)) ** 2))
    over_rms, over_amplitude = np.sqrt(np.mean(squares, axis=0))
    return float(over_rms), float(over_amplitude)


def compare() -> None:
    """Print time and error of every level for every set."""
    for layer in ("straight", "arched"):
        for name, own in SETS.items():
            values = COMMON | own
            full = DelaminatedBeam(fidelity="full", layer=layer)
            reference = Model(full).run(values, DRIVE, REQUEST)
            whole = cpu_of_a_period(full, values, REPEATS["full"])
            print(f"Fig. {name}, {layer}: full {1e3 * whole:.0f} ms a period")
            for level in LEVELS[layer]:
                reduced = DelaminatedBeam(
                    layer=layer, modes=level.modes, steps=level.steps, parts=level.parts, every=level.every
                )
                record = Model(reduced).run(values, DRIVE, REQUEST)
                part = cpu_of_a_period(reduced, values, REPEATS["reduced"])
                over_rms, over_amplitude = errors(record, reference)
                print(
                    f"  {level.modes} modes, {level.steps} x {level.parts} steps, every {level.every}: "
                    f"{1e3 * part:.2f} ms, {whole / part:.0f} times faster; error {100 * over_rms:.2f} % of rms, "
                    f"{100 * over_amplitude:.2f} % of amplitude"
                )


def evaluations() -> None:
    """Print the CPU time of evaluations at Sobol points."""
    study = load(Path(__file__).parents[2] / "studies" / "fe_calibration").study
    reference = study.objective.references["clapping"]
    points = qmc.Sobol(study.space.dim, rng=np.random.default_rng(3)).random(256)
    study.model.run(study.space.values(points[0]), reference.excitation, reference.request)
    seconds, settled = [], 0
    for point in points:
        start = time.process_time()
        record = study.model.run(study.space.values(point), reference.excitation, reference.request)
        seconds.append(time.process_time() - start)
        settled += record.attrs["status"] == OK and record.attrs["stationary"]
    half, most = np.quantile(seconds, [0.5, 0.95])
    print(f"256 Sobol points: median {half:.2f} s, 95 % below {most:.2f} s, longest {max(seconds):.2f} s; "
          f"{settled} settled")  # fmt: skip


if __name__ == "__main__":
    compare()
    evaluations()
