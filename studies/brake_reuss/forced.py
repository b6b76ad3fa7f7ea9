"""Force that each law needs for the measured amplitude at the measured frequency, beside the force that was measured.

    python studies/brake_reuss/forced.py             # the laws of CHOICES
    python studies/brake_reuss/forced.py --follow    # and the sweeps by each law, as `calib run` follows them
    python studies/brake_reuss/forced.py --draw      # and forced.png

The motion is taken as harmonic, x = X cos(w t) with the measured X and w, as that of a mode with a quality factor of 70
to 300 is. The force F is then the first harmonic of m x'' + c x' + k x - m f(x, x', z), with f the registered effects
and z their internal states after CYCLES cycles; with `residual_compliance` r it is that for X - r F, r F being the
displacement by all other modes. Mass, stiffness, damping and the parameters of a law are fitted by least squares to the
complex force of the five levels of record `held`, each level over the rms of its force, with the measured F in r F; the
seven other levels are predicted. The error of a level is the rms of predicted minus measured modulus over the rms
of the measured one; that of all seven together is over the rms of all their forces, to which the loud levels
contribute most.
"""

import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numba import njit
from scipy.optimize import least_squares

from calib.dynamics.swept_response import swept_response
from calib.modelling.effect import Effect
from calib.modelling.model import Model
from calib.plugins import load as registered
from calib.records.held_response import as_measured
from calib.records.response import complex_amplitude, sweeps
from calib.report.plots.style import DPI, STYLE
from calib.study_file import StudyFile, load

HERE = Path(__file__).parent
STEPS = 256  # a cycle
CYCLES = 3  # until hysteresis repeats
ROUNDS = 8  # of the force for the displacement less what that force adds, each a tenth to a third of the one before
RECORDS = ("held", "between", "driven")  # the first is fitted
START = {"mass": 2.0, "frequency": 80.25, "damping": 2.0}  # kg, Hz, N s/m
LIMITS = {"mass": (1.0, 4.0), "frequency": (40.0, 81.5), "damping": (0.01, 30.0)}  # as START
# start and limits of the parameters of a law; all positive ones are sought on a logarithmic scale, the others in units
# of the third number
LAWS: dict[str, dict[str, tuple[float, ...]]] = {
    "coulomb_friction": {"friction": (0.05, 1e-4, 10.0), "friction_slip": (1e-3, 1e-4, 0.5)},
    "quadratic_drag": {"c2": (40.0, 1e-3, 1e3)},
    "power_law_damping": {"power_damping": (100.0, 1e-3, 1e5), "power_exponent": (2.3, 0.2, 6.0)},
    "presliding": {"dahl_force": (20.0, 1e-3, 1e4), "dahl_distance": (1e-3, 1e-5, 0.3)},
    "bouc_wen": {
        "hysteresis_force": (20.0, 1e-3, 1e4), "hysteresis_distance": (1e-3, 1e-5, 0.3),
        "hysteresis_exponent": (1.0, 0.3, 5.0), "hysteresis_shape": (0.5, 0.01, 1.0),
    },
    "iwan": {
        "iwan_force": (20.0, 1e-3, 1e4), "iwan_distance": (1e-3, 1e-5, 0.3), "iwan_exponent": (-0.3, -0.94, 0.0, 1.0),
        "iwan_ratio": (0.5, 1e-3, 50.0),
    },
    "cubic_stiffness": {"k3": (0.0, -1e13, 1e13, 1e10)},
    "softening": {"kx": (0.0, -1e9, 1e9, 1e6)},
    "residual_compliance": {"residual_compliance": (0.0, -2e-5, 2e-5, 1e-5)},
}  # fmt: skip
CHOICES = (
    "linear", "coulomb_friction", "quadratic_drag", "power_law_damping", "presliding", "bouc_wen", "iwan",
    "quadratic_drag + cubic_stiffness", "power_law_damping + cubic_stiffness", "presliding + cubic_stiffness",
    "bouc_wen + cubic_stiffness", "iwan + cubic_stiffness", "quadratic_drag + softening + cubic_stiffness",
    "power_law_damping + softening + cubic_stiffness",
    *(f"{laws}residual_compliance" for laws in (
        "", "quadratic_drag + cubic_stiffness + ", "power_law_damping + cubic_stiffness + ",
        "presliding + cubic_stiffness + ", "bouc_wen + cubic_stiffness + ", "iwan + cubic_stiffness + ",
        "quadratic_drag + softening + cubic_stiffness + ", "power_law_damping + softening + cubic_stiffness + ",
    )),
)  # fmt: skip
LOOKS: tuple[Any, Any] = ((0, (3, 2)), "-")  # of their lines
DRAWN = ("linear", "power_law_damping + softening + cubic_stiffness + residual_compliance")
LEGEND_ROOM = 1.25  # height of an axis over that of its curves  [1]
CALIBRATED = {  # of study.joint.toml, by `calib run`
    "mass": 1.86699, "stiffness": 476245.5, "damping": 2.79107,
    "power_damping": 156.9756, "power_exponent": 2.681665,
    "kx": -2.20421e+07, "k3": 8.560452e+10, "residual_compliance": -6.97386e-06,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Level:
    """One sweep: frequency [Hz], complex displacement [m] and force [N] (n,), and its name."""

    name: str
    frequency: np.ndarray
    displacement: np.ndarray
    force: np.ndarray

    @property
    def resonance(self) -> float:
        """Frequency at which the displacement lags by 90 degrees, linear between points  [Hz]."""
        lag = -np.degrees(np.angle(self.displacement))
        (after,) = np.flatnonzero((lag[:-1] < 90.0) & (lag[1:] >= 90.0)) + 1
        around = slice(after - 1, after + 1)
        return float(np.interp(90.0, lag[around], self.frequency[around]))

    @property
    def needed(self) -> np.ndarray:
        """Complex force (n,) over the phase of the displacement  [N]."""
        return np.asarray(self.force * np.exp(-1j * np.angle(self.displacement)))


@dataclass(frozen=True)
class Fit:
    """Laws and values that were fitted: mass [kg], frequency [Hz], damping [N s/m], those of each law by name."""

    effects: tuple[Effect, ...]
    values: dict[str, float]

    def force(self, level: Level) -> np.ndarray:
        """Complex force (n,) over the phase of the displacement  [N]."""
        needed = np.zeros(level.frequency.size, dtype=complex)
        for _ in range(ROUNDS if self.values.get("residual_compliance") else 1):
            needed = self.of_mode(level, needed)
        return needed

    def of_mode(self, level: Level, force: np.ndarray) -> np.ndarray:
        """Complex force (n,) for the displacement less what other modes have of a force, over its phase  [N]."""
        displacement = np.abs(level.displacement) - self.values.get("residual_compliance", 0.0) * force
        mass, natural = self.values["mass"], 2.0 * np.pi * self.values["frequency"]
        omega, size = 2.0 * np.pi * level.frequency, np.abs(displacement)
        turned = np.exp(1j * np.angle(displacement))
        needed = (mass * (natural**2 - omega**2) + 1j * omega * self.values["damping"]) * size
        for effect in self.effects:
            if effect.site == "response":
                continue
            parameters = np.zeros(8)
            parameters[: len(effect.parameters)] = [self.values[p.name] for p in effect.parameters]
            law = effect.law
            needed = needed - mass * first_harmonic(law.function, omega, size, parameters, law.states > 0)
        return np.asarray(needed * turned)

    def error(self, level: Level, shift: float = 0.0) -> float:
        """Return the rms of the modulus of the force minus the measured one, over the rms of that  [1].

        shift : by which the resonance was higher in the test of this level than in those fitted  [Hz]
        """
        moved = replace(level, frequency=level.frequency - shift)
        return rms(np.abs(self.force(moved)) - level.force) / rms(level.force)

    def error_together(self, levels: Sequence[Level]) -> float:
        """Return the same over the points of all `levels`  [1]."""
        apart = [np.abs(self.force(level)) - level.force for level in levels]
        return rms(np.concatenate(apart)) / rms(np.concatenate([level.force for level in levels]))


@njit
def first_harmonic(law: Any, omega: np.ndarray, size: np.ndarray, parameters: np.ndarray, hysteretic: bool) -> Any:
    """First harmonic (n,) of a law's force per unit mass [m/s^2] over the phase of x, states by Runge-Kutta.

    It begins at x = 0 with all states 0, from where hysteresis comes to its loop at once; from a crest it has to slip.
    """
    found = np.empty(omega.size, np.complex128)
    z, k1, k2, k3, k4 = np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(4)
    step = 2.0 * np.pi / STEPS
    for n in range(omega.size):
        w, a = omega[n], size[n]
        h = step / w
        z[:] = 0.0
        total = 0j
        for _ in range(CYCLES if hysteretic else 1):
            total = 0j
            for i in range(STEPS):
                at, half, end = step * i, step * (i + 0.5), step * (i + 1)
                force = law(at / w, a * np.sin(at), a * w * np.cos(at), parameters, z, k1)
                total += force * np.exp(-1j * at)
                if hysteretic:
                    law(half / w, a * np.sin(half), a * w * np.cos(half), parameters, z + 0.5 * h * k1, k2)
                    law(half / w, a * np.sin(half), a * w * np.cos(half), parameters, z + 0.5 * h * k2, k3)
                    law(end / w, a * np.sin(end), a * w * np.cos(end), parameters, z + h * k3, k4)
                    z += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        found[n] = 2.0j * total / STEPS
    return found


def rms(values: np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.abs(values) ** 2)))


def levels(record: xr.Dataset, name: str) -> Iterator[Level]:
    """Sweeps of a record, named by what was held: the acceleration, or the force."""
    record = as_measured(record)
    amplitude = complex_amplitude(record)[0]
    for _, points in sweeps(record):
        frequency, own, force = (x[points] for x in (record.frequency.values, amplitude, record.level.values))
        acceleration = np.abs(own) * (2.0 * np.pi * frequency) ** 2
        held = f"{10 * round(np.median(acceleration) / 10) or 5:g} m/s^2"
        label = held if name != "driven" else f"{np.median(force):.2f} N"
        yield Level(label, frequency, own, force)


def calibrated() -> Fit:
    """Return the laws of study.joint.toml with the values that it was given."""
    natural = float(np.sqrt(CALIBRATED["stiffness"] / CALIBRATED["mass"])) / (2.0 * np.pi)
    names = ("power_law_damping", "softening", "cubic_stiffness", "residual_compliance")
    return Fit(tuple(registered("calib.effects", name) for name in names), {**CALIBRATED, "frequency": natural})


def followed(fit: Fit, file: StudyFile) -> tuple[float, float, str]:
    """Distance of the study's term on `held`, CPU seconds of the sweeps that it is of, and their status."""
    values = {name: value for name, value in fit.values.items() if name != "frequency"}
    values["stiffness"] = values["mass"] * (2.0 * np.pi * fit.values["frequency"]) ** 2
    reference = file.reference("held")
    model = Model(file.study.model.simulator, list(fit.effects))
    swept_response(model, values, reference.excitation, reference.record)  # compiles
    begin = time.process_time()
    simulated = swept_response(model, values, reference.excitation, reference.record)
    spent = time.process_time() - begin
    return float(file.study.objective({"held": simulated}).cost), spent, str(simulated.attrs["status"])


def fitted(names: Sequence[str], held: Sequence[Level]) -> Fit:
    """Return the laws of these names and the values that fit the complex forces of levels best."""
    effects = tuple(registered("calib.effects", name) for name in names)
    stated: dict[str, tuple[float, ...]] = {key: (START[key], *LIMITS[key]) for key in START}
    for name in names:
        stated |= LAWS[name]
    keys = list(stated)

    def values(u: np.ndarray) -> dict[str, float]:
        pairs = zip(keys, u.tolist(), strict=True)
        return {key: float(np.exp(x)) if len(stated[key]) == 3 else x * stated[key][3] for key, x in pairs}

    def residual(u: np.ndarray) -> np.ndarray:
        fit = Fit(effects, values(u))
        parts = [(fit.of_mode(level, level.needed) - level.needed) / rms(level.force) for level in held]
        return np.concatenate([part for one in parts for part in (one.real, one.imag)])

    rows = [np.log(s) if len(s) == 3 else np.array(s[:3]) / s[3] for s in stated.values()]
    begin, low, high = np.array(rows).T
    found = least_squares(residual, begin, bounds=(low, high), x_scale="jac", max_nfev=100)
    return Fit(effects, values(found.x))


def damping_alone(level: Level) -> float:
    """Damping [N s/m] of the linear mode that is fitted to one level alone."""
    return fitted([], [level]).values["damping"]


def interpolated(level: Level, held: Sequence[Level]) -> float:
    """Error of a level as `Fit.error`, where force over displacement is interpolated between the held levels.

    At each frequency it is linear in the amplitude: what can be predicted without any law of the joint.
    """
    size = np.abs(level.displacement)
    known = np.array([[np.interp(level.frequency, own.frequency, np.abs(own.displacement)) for own in held]])[0]
    stiffness = np.array(
        [
            np.interp(level.frequency, own.frequency, (own.needed / np.abs(own.displacement)).real)
            + 1j * np.interp(level.frequency, own.frequency, (own.needed / np.abs(own.displacement)).imag)
            for own in held
        ]
    )
    pairs = zip(size, known.T, stiffness.T, strict=True)
    force = np.array([x * (np.interp(x, own, s.real) + 1j * np.interp(x, own, s.imag)) for x, own, s in pairs])
    return rms(np.abs(force) - level.force) / rms(level.force)


def drawn(measured: dict[str, list[Level]], fits: dict[str, Fit]) -> Figure:
    """Draw the force over frequency of every level: measured points, and the lines of two fits."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(7.4, 4.0), layout="constrained")
        for axes, name in zip(figure.subplots(1, 3), RECORDS, strict=True):
            for place, level in enumerate(measured[name]):
                colour = mpl.colormaps["viridis"](0.82 * place / max(1, len(measured[name]) - 1))
                axes.plot(level.frequency, level.force, "o", color=colour, markersize=2.5, label=level.name)
                for fit, look in zip(fits.values(), LOOKS, strict=True):
                    axes.plot(level.frequency, np.abs(fit.force(level)), color=colour, linewidth=1.0, linestyle=look)
            axes.set(xlabel="Frequency [Hz]", title={"held": "Calibrated"}.get(name, "Predicted"))
            axes.set_ylim(0.0, LEGEND_ROOM * axes.get_ylim()[1])
            axes.legend(fontsize=7, loc="upper center", ncols=2)
        handles = [Line2D([], [], color="#333333", linewidth=1.0, linestyle=look) for look in LOOKS]
        figure.legend(handles, list(fits), loc="outside lower center", ncols=2, fontsize=7)
        figure.axes[0].set_ylabel("Force [N]")
    return figure


def main() -> None:
    """Print the error of each law at each level."""
    file = load(HERE / "study.toml")
    measured = {name: list(levels(file.reference(name).record, name)) for name in RECORDS}
    shown = [level for name in RECORDS for level in measured[name]]
    print(f"{'':50}" + " ".join(f"{level.name:>9}" for level in shown) + "  predicted, together")
    others = [level for level in shown if level not in measured["held"]]
    print(f"{'interpolated between the held levels':50}" + " ".join(
        f"{100.0 * interpolated(level, measured['held']):8.1f}%" if level in others else f"{'':>9}" for level in shown
    ))  # fmt: skip
    print(f"{'damping of a linear mode at each level [N s/m]':50}" + " ".join(
        f"{damping_alone(level):9.2f}" for level in shown
    ))  # fmt: skip
    print(f"{'lag of 90 degrees at [Hz]':50}" + " ".join(f"{level.resonance:9.3f}" for level in shown))
    fits = {}
    for choice in (*CHOICES, "study.joint.toml"):
        names = [] if choice == "linear" else choice.split(" + ")
        fit = fits[choice] = fitted(names, measured["held"]) if choice in CHOICES else calibrated()
        told = " ".join(f"{100.0 * fit.error(level):8.1f}%" for level in shown)
        print(f"{choice:50}{told} {100.0 * fit.error_together(others):8.1f}%")
        print("    " + ", ".join(f"{key} {value:.4g}" for key, value in fit.values.items()), flush=True)
    if "--draw" in sys.argv:
        drawn(measured, {name: fits[name] for name in DRAWN}).savefig(HERE / "forced.png", dpi=DPI)
    if "--follow" in sys.argv:
        for choice, fit in fits.items():
            cost, spent, status = followed(fit, file)
            print(f"{choice:50} distance {cost:.4f}, {spent:5.1f} s, {status}", flush=True)


if __name__ == "__main__":
    main()
