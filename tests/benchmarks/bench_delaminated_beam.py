"""Speed of the delaminated beam's full kernel beside C, akantu and CalculiX, in one run: ratios, not seconds.

    PYTHONPATH=tests:. python tests/benchmarks/bench_delaminated_beam.py

CPU seconds, compiled before they are timed, the fastest of some calls that alternate. Ours and C: one period of the
half beam (291 elements, corotational, contact, double precision), sets of the paper's Figs. 12 and 14. C has the same
arrays and operations (delaminated_beam.c) and must come to the same motion; without -fno-math-errno gcc does not
vectorise the square root. akantu and CalculiX: the whole beam (582 bilinear elements), explicit, without contact.

Measured on two shared cores with 512-bit vectors, in million element-steps per CPU second:

    ours       152 (Fig. 12), 169 (Fig. 14): 1.9 and 1.7 us a step; agrees with C to 8e-14 over a period
    C          164, 174 with -fno-math-errno: ours takes 0.94 to 1.07 times as long; 51 without it
    akantu     2.7: ours 62 times as fast
    CalculiX   0.065: ours 2600 times as fast
"""

import ctypes
import os
import re
import resource
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from simulators.delaminated_beam.akantu_peer import model
from simulators.delaminated_beam.beams import ALUMINIUM, FIGURE_12, FIGURE_14, WIDTH, advance, beam, cosine

from calib.simulators.delaminated_beam import explicit

SOURCE = Path(__file__).with_name("delaminated_beam.c")
OPTIONS = {"-O3 -march=native": "C", "-O3 -march=native -fno-math-errno": "C without errno"}
REPEATS = 5
POINTER = ctypes.c_void_p


class PlanInC(ctypes.Structure):
    """`Plan` of delaminated_beam.c."""

    _fields_ = (
        *[(n, ctypes.c_long) for n in ("size", "strips", "lines", "stretches", "pairs", "driven")],
        *[(n, POINTER) for n in ("strip", "line", "shared", "joint", "slave", "master", "following", "acting")],
        *[(n, POINTER) for n in ("factors", "across", "inverse_mass", "weight", "clearance", "stiffness", "damping")],
        *[(n, ctypes.c_double) for n in ("shear", "mean", "alpha", "beta", "step", "limit")],
    )


class StateInC(ctypes.Structure):
    """`State` of delaminated_beam.c."""

    _fields_ = tuple(
        (n, POINTER)
        for n in ("w", "v", "elastic", "gap", "rate", "push", "mobility", "pair_weights", "active", "counters")
    )


def in_c(plan):
    """Fill C's plan; the arrays stay those of `plan`."""
    names = {"strip": "strips", "line": "lines"}
    counts = {"strips": plan.strips, "lines": plan.lines, "stretches": plan.shared, "pairs": plan.slave}
    made = PlanInC()
    for name, kind in PlanInC._fields_:
        if kind is POINTER:
            array = getattr(plan, names.get(name, name))
            assert array.flags.c_contiguous
            assert array.itemsize == (1 if name == "acting" else 8)
            setattr(made, name, array.ctypes.data)
        else:
            setattr(made, name, len(counts[name]) if name in counts else getattr(plan, name))
    return made


def compiled(options, folder):
    """Compile delaminated_beam.c and return its `advance`."""
    library = Path(folder) / f"{abs(hash(options))}.so"
    subprocess.run(["cc", *options.split(), "-shared", "-fPIC", "-o", library, SOURCE, "-lm"], check=True)
    return ctypes.CDLL(str(library)).advance


def cpu(function):
    """CPU seconds of a call."""
    begin = time.process_time()
    function()
    return time.process_time() - begin


class Run:
    """A set of the paper, settled for a period, then taken period by period by ours or by C."""

    def __init__(self, b, figure):
        self.b = b
        self.plan, self.state, self.steps = b.figure(*figure)
        self.drive = cosine(self.steps)
        advance(self.plan, self.state, self.drive)

    def copy(self):
        return explicit.ExplicitState(*(array.copy() for array in self.state))

    def ours(self, state):
        advance(self.plan, state, self.drive)

    def c(self, function, state):
        plan, inside = in_c(self.plan), StateInC(*(getattr(state, n).ctypes.data for n, _ in StateInC._fields_))
        pointer = self.drive.ctypes.data_as(POINTER)
        assert function(ctypes.byref(plan), ctypes.byref(inside), pointer, ctypes.c_long(len(self.drive))) == 0


def against_c(run, name, folder):
    """Print element-steps per CPU second of ours and of C, and by how much the motions differ."""
    functions = {label: compiled(options, folder) for options, label in OPTIONS.items()}
    mine = run.copy()
    run.ours(mine)
    for label, function in functions.items():
        his = run.copy()
        run.c(function, his)
        difference = np.abs(his.w - mine.w).max() / np.abs(mine.w).max()
        print(f"  after one period {label} differs from ours by {difference:.1e} of the largest displacement")
    best = dict.fromkeys(["ours", *functions], np.inf)
    for _ in range(REPEATS):
        best["ours"] = min(best["ours"], cpu(lambda: run.ours(run.copy())))
        for label, function in functions.items():
            best[label] = min(best[label], cpu(lambda function=function: run.c(function, run.copy())))
    elements = 291 * run.steps
    for label, seconds in best.items():
        print(
            f"  {name} {label:15s} {elements / seconds / 1e6:7.1f} million element-steps per CPU s, "
            f"{1e6 * seconds / run.steps:.2f} us a step; ours takes {best['ours'] / seconds:.2f} times as long"
        )
    return elements / best["ours"]


def akantu_speed(steps=2000):
    """Element-steps per CPU second of akantu: 582 bilinear elements, explicit, lumped, without contact."""
    b = beam(symmetric=False, bilinear=True)
    peer, _mesh = model(b.structure.mesh, ALUMINIUM, 3.1e-7, 1e-6 * b.nodes)

    def go():
        for _ in range(steps):
            peer.solveStep()

    go()
    return 582 * steps / min(cpu(go) for _ in range(3))


DECK = """*NODE, NSET=ALL
{nodes}
*ELEMENT, TYPE=CPS4, ELSET=BEAM
{quads}
*MATERIAL, NAME=ALUMINIUM
*ELASTIC
{young}, {poisson}
*DENSITY
{density}
*SOLID SECTION, ELSET=BEAM, MATERIAL=ALUMINIUM
{width}
*INITIAL CONDITIONS, TYPE=VELOCITY
ALL, 2, 0.01
*STEP, NLGEOM, INC=100000
*DYNAMIC, EXPLICIT
1e-7, {end}
*END STEP
"""


def calculix_speed(folder, ends=(5e-5, 3e-4)):
    """Element-steps per CPU second of CalculiX: the same 582, explicit, geometrically non-linear, no contact.

    From the difference of two runs, at the step that it chooses; with a given one (DIRECT) it does not come back.
    """
    mesh, seconds = beam(symmetric=False).structure.mesh, []
    quads = np.concatenate([mesh.quadrilaterals(strip) for strip in mesh.strips]) + 1
    for end in ends:
        (Path(folder) / "beam.inp").write_text(
            DECK.format(
                nodes="\n".join(f"{i + 1}, {x:.9e}, {y:.9e}, 0." for i, (x, y) in enumerate(mesh.nodes)),
                quads="\n".join(", ".join(map(str, (i + 1, *quad))) for i, quad in enumerate(quads)),
                young=ALUMINIUM.young,
                poisson=ALUMINIUM.poisson,
                density=ALUMINIUM.density,
                width=WIDTH,
                end=end,
            )
        )
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        done = subprocess.run(
            ["ccx", "beam"], cwd=folder, env=environment, capture_output=True, text=True, check=True, timeout=200
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        seconds.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    step = float(re.search(r"SELECTED time increment:\s*(\S+)", done.stdout)[1])
    return 582 * (ends[1] - ends[0]) / step / (seconds[1] - seconds[0])


def main():
    """Print accuracy and ratios."""
    half = beam()
    with tempfile.TemporaryDirectory() as folder:
        for name, figure in (("figure 12", FIGURE_12), ("figure 14", FIGURE_14)):
            speed = against_c(Run(half, figure), name, folder)
        peer = akantu_speed()
        print(f"akantu {peer / 1e6:.2f} million element-steps per CPU s: ours {speed / peer:.0f} times as fast")
        peer = calculix_speed(folder)
        print(f"CalculiX {peer / 1e6:.3f} million element-steps per CPU s: ours {speed / peer:.0f} times as fast")


if __name__ == "__main__":
    main()
