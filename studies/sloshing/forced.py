"""Forced responses of the liquid, predicted from its decays: the tank is shaken at three levels.

    python studies/sloshing/forced.py
    python studies/sloshing/forced.py docs/images/forced_responses.png    # and the picture
    python studies/sloshing/forced.py --of RESULT    # and how sure: result.json of study.higher_order.toml

The models are those of the extended study and of study.higher_order.toml, with the values that they were given there
(README.md). Their response at each level is followed over the frequency; all that is free is one factor between the
acceleration of the tank and the force on the liquid's centre of mass, common to the three levels. Phases are relative
to the displacement of the tank.
"""

import argparse
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import minimize_scalar

from calib.dynamics.response import FrequencyResponse, frequency_response
from calib.dynamics.setting import Setting
from calib.modelling.model import Model
from calib.plugins import load as registered
from calib.records.excitation import Excitation
from calib.report.plots.style import DPI, STYLE

HERE = Path(__file__).parent
CUBIC, HIGHER = "cubic spring", "terms of higher order"
EFFECTS = {
    CUBIC: ("cubic_stiffness",),
    HIGHER: ("cubic_stiffness", *(f"higher_order:{name}" for name in ("INERTIA", "AMPLITUDE_DAMPING", "FIFTH_POWER"))),
}
VALUES = {  # SI, from the decays
    CUBIC: {"mass": 1.0, "stiffness": 61.05, "damping": 0.131, "k3": -3757.0},
    HIGHER: {
        "mass": 1.0,
        "stiffness": 61.127,
        "damping": 0.1260,
        "k3": -2888.0,
        "kv": -67.93,
        "cx": 28.01,
        "k5": 3.793e5,
    },
}
NATURAL = 7.8  # rad/s: unit of the frequencies in the files
LEVELS = (0.09, 0.17, 0.32)  # amplitudes of the tank's motion, in per cent of its width
WINDOW = (0.90, 1.03)  # over the natural frequency
LOW, HIGH = 0.32, 0.36  # factor between which the common one is sought
UNSTABLE = (0, (2, 2))
LINES: dict[str, dict] = {CUBIC: {"linewidth": 0.8, "linestyle": (0, (6, 2))}, HIGHER: {"linewidth": 1.5}}


class Sweep(NamedTuple):
    """Measured points of a level: frequency over the natural one, amplitude [% of the width], phase [deg]."""

    frequency: np.ndarray
    amplitude: np.ndarray
    phase: np.ndarray


class Comparison(NamedTuple):
    """Prediction at one level beside what was measured.

    Attributes
    ----------
    peak, measured_peak : frequency over the natural one, and amplitude [% of the width], of the largest response
    phase_error : rms over the measured points [deg]
    amplitude_error : the same, over the largest measured amplitude  [1]
    """

    level: float
    peak: tuple[float, float]
    measured_peak: tuple[float, float]
    phase_error: float
    amplitude_error: float


def measured(folder: Path) -> dict[float, Sweep]:
    """Read the files of the three levels."""
    return {level: Sweep(*np.loadtxt(folder / f"forced_{level}.txt", skiprows=1).T) for level in LEVELS}


def predicted(name: str, factor: float, values: Mapping[str, float] | None = None) -> FrequencyResponse:
    """Responses of a model at the three levels; the force over the mass is `factor` times the tank's acceleration."""
    effects = [registered("calib.effects", effect, HERE) for effect in EFFECTS[name]]
    simulator = registered("calib.simulators", "oscillator")()
    drive = Excitation("mass", "force", frequency=NATURAL / (2.0 * np.pi), amplitude=1.0)
    low, high = (share * NATURAL / (2.0 * np.pi) for share in WINDOW)
    return frequency_response(
        Setting(Model(simulator, effects), drive, values or VALUES[name]), (low, high), [0.01 * own for own in LEVELS],
        harmonics=1, amplitude=lambda level, frequency: factor * level * (2.0 * np.pi * frequency) ** 2,
    )  # fmt: skip


def stable_at(response: FrequencyResponse, level: float, share: float) -> Iterator[complex]:
    """First harmonics of the stable motions at a frequency over the natural one, in per cent of the width."""
    for one in response.at(0.01 * level):
        offset = one.frequency * 2.0 * np.pi / NATURAL - share
        stable = one.branch.stable[:-1] & one.branch.stable[1:]
        for i in np.flatnonzero(stable & (offset[:-1] * offset[1:] <= 0.0)):
            part = offset[i] / (offset[i] - offset[i + 1])
            yield 100.0 * ((1.0 - part) * one.harmonics[0, 1, i] + part * one.harmonics[0, 1, i + 1])


def compared(response: FrequencyResponse, sweeps: Mapping[float, Sweep]) -> list[Comparison]:
    """Compare each measured point with the nearest stable motion at its frequency."""
    rows = []
    for level, sweep in sweeps.items():
        nearest = []
        for share, amplitude in zip(sweep.frequency, sweep.amplitude, strict=True):
            there = list(stable_at(response, level, share))
            nearest.append(there[int(np.argmin(np.abs(np.abs(there) - amplitude)))])
        found, top = np.array(nearest), int(sweep.amplitude.argmax())
        branches = response.at(0.01 * level)
        peak, at = max(
            (100.0 * float(a), float(f) * 2.0 * np.pi / NATURAL)
            for one in branches
            for a, f in zip(abs(one.harmonics[0, 1]), one.frequency, strict=True)
        )
        rows.append(
            Comparison(
                level, (at, peak), (float(sweep.frequency[top]), float(sweep.amplitude[top])),
                float(np.sqrt(np.mean((np.degrees(np.angle(found)) - sweep.phase) ** 2))),
                float(np.sqrt(np.mean((abs(found) - sweep.amplitude) ** 2)) / sweep.amplitude.max()),
            )
        )  # fmt: skip
    return rows


def fitted(name: str, sweeps: Mapping[float, Sweep], values: Mapping[str, float] | None = None) -> float:
    """Return the common factor of a model, by least squares of the amplitudes over the largest of each level."""

    def misfit(factor: float) -> float:
        return sum(row.amplitude_error**2 for row in compared(predicted(name, factor, values), sweeps))

    return float(minimize_scalar(misfit, bounds=(LOW, HIGH), method="bounded", options={"xatol": 1e-3}).x)


def uncertainty(result: Path, sweeps: Mapping[float, Sweep]) -> dict[float, tuple[float, float]]:
    """Two standard errors of the largest response by level: of its frequency over the natural one, and its size [%].

    The covariance that `calib run` states is propagated to first order, with the factor fitted anew to the two weaker
    levels: beside its last measured point the loudest jumps down, or not.
    """
    weaker = {level: sweeps[level] for level in LEVELS[:2]}
    confidence = json.loads(result.read_text())["confidence"]
    names, slopes = confidence["correlation"]["names"], []
    for name in names:
        ends = []
        for sign in (1.0, -1.0):
            values = {**VALUES[HIGHER], name: VALUES[HIGHER][name] + sign * confidence["standard_error"][name]}
            rows = compared(predicted(HIGHER, fitted(HIGHER, weaker, values), values), sweeps)
            ends.append([row.peak for row in rows])
        slopes.append(0.5 * (np.array(ends[0]) - np.array(ends[1])))
    whole = np.einsum("pls,pq,qls->ls", slopes, np.array(confidence["correlation"]["matrix"]), slopes)
    return {
        level: (float(2.0 * at), float(2.0 * size)) for level, (at, size) in zip(sweeps, np.sqrt(whole), strict=True)
    }


def drawn(responses: Mapping[str, FrequencyResponse], sweeps: Mapping[float, Sweep]) -> Figure:
    """Draw measured points over predicted curves, amplitude above phase."""
    colours = ("#0072B2", "#E69F00", "#009E73")
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(7.4, 5.4), layout="constrained")
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3.0, 2.0])
        for (level, sweep), colour in zip(sweeps.items(), colours, strict=True):
            upper.plot(sweep.frequency, sweep.amplitude, "o", color=colour, markersize=4, label=f"{level} %, measured")
            lower.plot(sweep.frequency, sweep.phase, "o", color=colour, markersize=4)
            for name, response in responses.items():
                for one in response.at(0.01 * level):
                    share, h = one.frequency * 2.0 * np.pi / NATURAL, one.harmonics[0, 1]
                    for axes, values in ((upper, 100.0 * abs(h)), (lower, np.degrees(np.angle(h)))):
                        stable = np.where(one.branch.stable, values, np.nan)
                        axes.plot(share, stable, color=colour, **LINES[name])
                        unstable = np.where(one.branch.stable, np.nan, values)
                        axes.plot(share, unstable, color=colour, linewidth=0.7, linestyle=UNSTABLE)
        for name, look in LINES.items():
            upper.plot([], [], color="#333333", label=f"predicted, {name}", **look)
        upper.plot([], [], color="#333333", linewidth=0.7, linestyle=UNSTABLE, label="unstable")
        upper.set_ylabel("Centre of mass [% of the width]")
        lower.set(xlabel="Frequency over the natural one [1]", ylabel="Phase [deg]", xlim=WINDOW)
        upper.legend(title="Tank moves by")
    return figure


def main() -> None:
    """Print the comparison, and draw or work out what else is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("picture", nargs="?", help="file of the picture")
    parser.add_argument("--of", type=Path, help="result.json of study.higher_order.toml: how sure its prediction is")
    asked = parser.parse_args()
    if "CALIB_DATA" not in os.environ:
        raise SystemExit("set CALIB_DATA to the folder that holds sloshing/forced_0.09.txt and its siblings")
    sweeps = measured(Path(os.environ["CALIB_DATA"]) / "sloshing")
    responses = {}
    for name in EFFECTS:
        factor = fitted(name, sweeps)
        responses[name] = predicted(name, factor)
        print(f"{name}: factor {factor:.4f}, common to the levels")
        for row in compared(responses[name], sweeps):
            peaks = ", ".join(
                f"{kind} {size:.3f} % at {at:.4f}"
                for kind, (at, size) in (("predicted", row.peak), ("measured", row.measured_peak))
            )
            print(
                f"{row.level} %: largest {peaks}; rms of amplitude {100.0 * row.amplitude_error:.1f} % of the largest, "
                f"of phase {row.phase_error:.1f} deg"
            )
    if asked.picture:
        drawn(responses, sweeps).savefig(asked.picture, dpi=DPI)
    if asked.of:
        for level, (at, size) in uncertainty(asked.of, sweeps).items():
            print(f"{level} %: largest +- {size:.2f} % at +- {at:.4f}, two standard errors")


if __name__ == "__main__":
    main()
