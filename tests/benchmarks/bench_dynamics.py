"""A bifurcation diagram of 500 values, 1100 periods each, with its picture; and its cost beside DOP853 with events.

    PYTHONPATH=tests python tests/benchmarks/bench_dynamics.py

Wall-clock seconds of the whole diagram on two processes (their start, kinds of motion, exponents, file and picture
included), compiled before. Then CPU seconds a value in this process: 1100 periods alone, what the diagram does for a
value (kind of motion and exponent included), and the 1100 periods with scipy's DOP853 and its events (20, times 55).
"""

import tempfile
import time
from pathlib import Path

import numpy as np
from simulators.four_dof_peer import dop853

from calib.dynamics.motion import kind_of_orbit
from calib.dynamics.setting import Setting
from calib.modelling.model import Model
from calib.records.excitation import Excitation
from calib.report.plots.bifurcation import bifurcation_diagram
from calib.simulators.four_dof import FourDof
from calib.sweep import Sweep, run

FREQUENCY, AMPLITUDE = 26.24, 1.5e-3  # Hz, m
VALUES, PERIODS, PEER = 500, 1100, 20
SETTING = Setting(Model(FourDof()), Excitation("end", "displacement", frequency=FREQUENCY, amplitude=AMPLITUDE))


def cpu(function):
    """CPU seconds of a call."""
    begin = time.process_time()
    function()
    return time.process_time() - begin


def main():
    """Print seconds and ratios."""
    kind_of_orbit(SETTING.map({"restitution": 0.5}))  # compiles
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        found = run(Sweep(SETTING, {"restitution": np.linspace(0.0, 0.75, VALUES)}), Path(folder) / "sweep.nc", jobs=2)
        swept = time.perf_counter()
        bifurcation_diagram(found, ["q2", "q3"]).savefig(Path(folder) / "sweep.png", dpi=150)
        drawn = time.perf_counter()
    print(f"{VALUES} values: {swept - begin:.1f} s and {drawn - swept:.1f} s for the picture, on two processes")
    for e in (0.05, 0.20, 0.50):
        map = SETTING.map({"restitution": e})
        ours = min(cpu(lambda map=map: map.orbit(map.initial, PERIODS)) for _ in range(5))
        judged = min(cpu(lambda map=map: kind_of_orbit(map)) for _ in range(3))
        values = {**SETTING.model.nominal, "restitution": e}
        peer = cpu(lambda values=values: dop853(values, FREQUENCY, AMPLITUDE, 10**9, end=PEER / FREQUENCY))
        peer *= PERIODS / PEER
        print(
            f"e {e:.2f}: {1e3 * ours:.1f} ms for {PERIODS} periods, DOP853 {peer / ours:.0f} times as long; "
            f"with its kind of motion and exponent {1e3 * judged:.1f} ms, DOP853 without them {peer / judged:.0f} times"
        )


if __name__ == "__main__":
    main()
