"""What a lagged contact damper does at two steps: contact force, phase curve and the velocity around the impact.

    python studies/paper_fe/damper.py

The lagged damper sees the velocity half a step before, as the paper's code does; the semi-implicit one the mean of the
velocities before and after the step. Full fidelity; each motion starts from rest and is recorded after SETTLE periods.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calib.dynamics.setting import Setting
from calib.modelling.model import Model
from calib.records import OK
from calib.report.plots.style import STYLE
from calib.simulators.delaminated_beam import DelaminatedBeam
from calib.simulators.delaminated_beam.period_map import BeamMap
from calib.study_file import load

HERE = Path(__file__).parent
SETTLE = 6  # periods: at alpha 500 1/s the state returns within 1e-7 after five
SAMPLES = 4000  # a period
BUDGET = 10**9  # steps
STEPS = (9.38e-8, 3.10e-7)  # s; the paper's two
DAMPERS = ("semi_implicit", "lagged")
CASES = ((14, 1.0), (14, 5.0), (14, 8.0), (14, 11.0), (14, 20.0), (12, 5.0))  # figure, c_con
LOOKS = {
    ("semi_implicit", STEPS[0]): ("#333333", "-", 2.2),
    ("semi_implicit", STEPS[1]): ("#0072B2", "-", 1.1),
    ("lagged", STEPS[0]): ("#009E73", "--", 1.3),
    ("lagged", STEPS[1]): ("#D55E00", "-", 0.8),
}


@dataclass(frozen=True, eq=False)
class Loop:
    """One period of a motion.

    Attributes
    ----------
    status : "ok", or why there is none
    samples : (n, 2) displacement [m] and velocity [m/s] of the layer's middle
    force : (n,) on the whole layer, mean between samples  [N]
    largest : at any step  [N]
    closed : share of the time with contact anywhere  [1]
    """

    status: str
    samples: np.ndarray
    force: np.ndarray
    largest: float
    closed: float


Loops = dict[tuple[str, float], Loop]  # (damper, step [s]) -> its motion


def loop(number: int, c_con: float, damper: str, step: float, settle: int = SETTLE) -> Loop:
    """One period of a figure's set with this damper and step [s], after `settle` periods from rest."""
    held = load(HERE / f"fig{number:02d}.toml").setting({"c_con": c_con, "dt": step})
    map = Setting(Model(DelaminatedBeam(fidelity="full", damper=damper)), held.excitation, held.values).map()
    if not isinstance(map, BeamMap):
        raise TypeError(f"expected the map of a beam, got {type(map).__name__}")
    engine, began = map.engine(map.initial, BUDGET), time.process_time()
    for _ in range(settle):
        period = engine.period(1)
        if period.status != OK:
            break
    else:
        engine.begin_record()
        period = engine.period(SAMPLES)
    took = time.process_time() - began
    print(f"Fig. {number}, C {c_con:g}, {damper}, {step:.3g} s: {period.status}, {took:.0f} s of CPU", flush=True)
    contact = engine.contact_recorded(1)
    # the right half of the beam is computed: forces of the whole layer are twice its own
    return Loop(
        period.status,
        period.samples[:, [1, 3]],
        2.0 * period.force,
        2.0 * contact.force,
        contact.fraction,
    )


def distance(one: Loop, reference: Loop) -> float:
    """Distance of phase curves as the feature phase_curve has it: rms, each channel over the reference's  [1]."""
    return float(np.sqrt((((one.samples - reference.samples) / reference.samples.std(axis=0)) ** 2).mean()))


def row(number: int, c_con: float, loops: Loops) -> str:
    """One line of the table: force and distance, or the status, of each damper and step."""
    reference, cells = loops["semi_implicit", STEPS[0]], []
    for one in loops.values():
        cells.append(f"{one.largest:.4g} N, {100 * distance(one, reference):.2f} %" if one.status == OK else one.status)
    return f"| {number} | {c_con:g} | " + " | ".join(cells) + " |"


def picture(found: dict[tuple[int, float], Loops]) -> Figure:
    """Velocity of the layer and contact force around the strongest contact, a column a case."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(15.0, 6.6), layout="constrained")
        panels = figure.subplots(2, len(found), sharex="col")
        for column, ((number, c_con), loops) in zip(panels.T, found.items(), strict=True):
            peak = int(np.argmax(loops["semi_implicit", STEPS[0]].force))
            for key, one in loops.items():
                if one.status == OK:
                    _around(column, one, peak, *LOOKS[key], f"{key[0].replace('_', '-')}, {key[1]:.3g} s")
            bad = {key: one.status for key, one in loops.items() if one.status != OK}
            failed = [f"{damper}, {step:.3g} s: {status}" for (damper, step), status in bad.items()]
            column[0].set_title("\n".join([f"Fig. {number} set, C = {c_con:g} C_crit", *failed]))
            column[1].set_xlabel("time since the largest force [ms]")
        panels[0, 0].set_ylabel("velocity of the layer's middle [m/s]")
        panels[1, 0].set_ylabel(f"contact force of the whole layer,\nmean over T/{SAMPLES} [N]")
        figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=len(LOOKS))
    return figure


def _around(column: Sequence[Axes], one: Loop, peak: int, colour: str, line: str, width: float, label: str) -> None:
    spacing = 1e3 / (26.51 * SAMPLES)  # ms
    part = np.arange(-round(1.0 / spacing), round(3.0 / spacing))
    look: dict[str, Any] = {"color": colour, "linestyle": line, "linewidth": width, "label": label}
    column[0].plot(spacing * part, one.samples[(peak + part) % SAMPLES, 1], **look)
    column[1].plot(spacing * part, one.force[(peak + part) % SAMPLES], **look)


def main() -> None:
    """Print the table and draw the picture in out/."""
    every = list(product(DAMPERS, STEPS))
    found = {case: {(damper, step): loop(*case, damper, step) for damper, step in every} for case in CASES}
    heads = [f"{damper.replace('_', '-')}, {step:.3g} s" for damper, step in every]
    print("| set of Fig. | C / C_crit | " + " | ".join(heads) + " |\n" + "|---" * 6 + "|")
    for case, loops in found.items():
        print(row(*case, loops))
    (HERE / "out").mkdir(exist_ok=True)
    picture(found).savefig(HERE / "out" / "damper.png", dpi=100)


if __name__ == "__main__":
    main()
