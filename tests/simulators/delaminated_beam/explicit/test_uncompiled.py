"""The kernel as plain Python gives what it gives compiled."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from simulators.delaminated_beam.beams import beam, cosine, seen

import calib
from calib.simulators.delaminated_beam import explicit
from calib.simulators.delaminated_beam.mesh import Counts

STEPS = 25


def few_steps() -> list[np.ndarray]:
    """Displacements, velocities, samples, impacts, steps closed and totals; the layer is against the beam in places."""
    b = beam(counts=Counts(masters=4, slaves=2, outer=2))
    gap = 1e-6 * np.linspace(-1.0, 1.0, len(b.structure.pairs.weight))
    plan = b.plan(0.5 * b.critical, alpha=50.0, beta=0.1, c_con=1.0, clearance=gap)
    state = b.begin(plan, 1e-6 * np.sin(100.0 * b.nodes + b.nodes[:, :1]))
    notes = seen(plan, [3, 20])
    explicit.advance(plan, state, 0.0, cosine(1000, STEPS / 1000, 1e-6), notes)
    return [state.w, state.v, notes.samples.ravel(), notes.impacts.ravel(), notes.closed, notes.total]


def test_the_kernel_is_the_same_without_the_compiler():
    script = "import numpy, sys; from simulators.delaminated_beam.explicit.test_uncompiled import few_steps; "
    script += "sys.stdout.write(' '.join(float(x).hex() for x in numpy.concatenate(few_steps())))"
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": os.pathsep.join(map(str, roots()))}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    compiled = few_steps()
    plain = np.array([float.fromhex(x) for x in done.stdout.split()])
    assert compiled[-1][2] > 0  # there was contact
    for part in compiled:
        assert np.abs(plain[: len(part)] - part).max() < 1e-11 * np.abs(part).max()
        plain = plain[len(part) :]
    assert not len(plain)


def roots() -> list[Path]:
    """Where the tests and the package lie."""
    return [Path(__file__).parents[3], Path(calib.__file__).parents[1]]
