"""A beam with a delaminated layer: the seeker moves its modes, the hider's records are of all its elements.

What the hider's beam has besides is no parameter that the seeker calibrates, nor an effect: a gap of another shape, or
a layer of another thickness.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from hidden import foreign_beam
from hidden.motion import Motion, Refused
from hidden.system import Plan, System
from scipy.interpolate import CubicHermiteSpline
from short_beam import VALUES

from calib import plugins
from calib.modelling.effect import Effect
from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.records import OK
from calib.records.excitation import Excitation
from calib.simulators.delaminated_beam import DelaminatedBeam

SAMPLES = 2000  # of the hider's motion, a period
KNOTS = np.linspace(0.0, 1.0, 33)  # of the gap along half the delamination
MESH = {"masters": 8, "outer": 6, "beam_rows": (1.0,)}
REDUCED = {**MESH, "fidelity": "reduced", "steps": 8192, "every": 1}
LOWEST = {**MESH, "fidelity": "reduced"}  # the level of a study that states none: ten times faster
FULL = {**MESH, "fidelity": "full"}
NOMINAL = {p.name: p.nominal for p in DelaminatedBeam(**MESH).parameters}
WINDOWS = {
    "alpha": (400.0, 1600.0, "log"),
    "g_max": (0.6e-3, 1.0e-3, "linear"),
    "young_modulus": (65e9, 75e9, "linear"),
}
TRUTH = {**NOMINAL, **VALUES, "f": 1e-3}  # soft contact: half a millisecond long
PLANS = (
    Plan("clapping", "calibrate", "harmonic", 3.68e-3, 106.04),
    Plan("louder", "calibrate", "harmonic", 4.3e-3, 106.04),
    Plan("quicker", "name", "harmonic", 3.68e-3, 108.0),
    Plan("quiet", "name", "harmonic", 2.0e-3, 106.04),  # without contact
    Plan("slower", "holdout", "harmonic", 4.0e-3, 105.0),
)
LAWS = (
    "linear_drag", "quadratic_drag", "coulomb_friction", "cubic_stiffness", "quadratic_stiffness", "softening",
    "preload", "drive_harmonic_2", "drive_harmonic_3",
)  # fmt: skip
FOREIGN_SUPPORT = 0.34883  # m: the node of MESH nearest to the support, where the model of the seeker is held
FOREIGN_LAWS = {"quadratic_drag": "c2", "cubic_stiffness": "k3"}  # of the other code, with their parameters
EFFECTS = LAWS + (
    "channel_gain", "channel_offset", "channel_drift", "channel_lag", "velocity_differencing", "plot_shear",
    "plot_scale", "axis_tilt", "clipping",
)  # fmt: skip


class Beam(System):
    """The beam as the hider drives it, with the laws of the library in elements of its own.

    Hidden parameters of its own model are `full`, 0 or 1, and the gap's departure `wave` [m] with its `wave_order`, the
    number of half waves along half the delamination. Where its true values have `foreign`, its records are of another
    code, see `foreign_beam`, which has the laws of `FOREIGN_LAWS`.
    """

    def moved(self, plan: Plan, values: Mapping[str, float], hidden: Mapping[str, float], state=None) -> Motion:
        """Motion of the beam at these values, in all its elements where `full` is hidden, else in its modes."""
        values = self.restructured(values, hidden)
        if values.pop("foreign", 0.0):
            return _foreign(plan, values, hidden)
        effects = [_on_the_layer(plugins.load("calib.effects", name)) for name in LAWS]
        acting = [one for one in effects if {p.name for p in one.parameters} & set(hidden)]
        own = {p.name: p.nominal for one in acting for p in one.parameters}
        own |= {name: value for name, value in hidden.items() if name in own}
        excitation = Excitation(self.place, self.quantity, frequency=plan.frequency, amplitude=plan.amplitude)
        model = Model(_simulator(bool(hidden.get("full")), *_gap(values, hidden)), tuple(acting))
        record = model.run({**values, **own}, excitation, Request(periods=1, samples=SAMPLES))
        if record.attrs["status"] != OK or not record.attrs["stationary"]:
            raise Refused(f"no motion that returns: {record.attrs['status']} {record.attrs['reason']}")
        period = 1.0 / plan.frequency
        time = np.append(record.time.values, period)
        rows = [np.append(record[c].values, record[c].values[:, :1], axis=1) for c in ("displacement", "velocity")]
        place = CubicHermiteSpline(time, *rows, axis=1)

        def look(times):
            phase = np.mod(times, period)
            return place(phase), np.array([np.interp(phase, time, row) for row in rows[1]])

        impacts = record.impact_time.values if "impact_time" in record else np.zeros(0)
        return Motion(look, np.sort(impacts % period), np.zeros(0), np.zeros(0))


def _foreign(plan: Plan, values: Mapping[str, float], hidden: Mapping[str, float]) -> Motion:
    """Motion of the other code's beam."""
    known = {p.name for name in LAWS for p in plugins.load("calib.effects", name).parameters}
    unknown = (known | {"full", "wave"}) & set(hidden) - set(FOREIGN_LAWS.values())
    if unknown:
        raise Refused(f"the other code has no {', '.join(sorted(unknown))}")
    drag, cubic = (hidden.get(name, 0.0) for name in FOREIGN_LAWS.values())
    plant = foreign_beam.plant({**NOMINAL, **values}, FOREIGN_SUPPORT)
    motion = foreign_beam.settled(plant, plan.frequency, plan.amplitude, drag, cubic)
    if motion is None:
        raise Refused("no motion of the other code returns")
    period, begins = 1.0 / plan.frequency, np.diff((motion.pressed > 0.0).astype(int), prepend=0) > 0
    place = CubicHermiteSpline(motion.time, motion.displacement, motion.velocity, axis=1)

    def look(times):
        phase = np.mod(times, period)
        return place(phase), np.array([np.interp(phase, motion.time, row) for row in motion.velocity])

    return Motion(look, motion.time[begins], np.zeros(0), np.zeros(0))


def _on_the_layer(effect: Effect) -> Effect:
    """Return an effect of a force as a diagnosis seeks it: on the layer alone, not on the beam below it."""
    return replace(effect, bodies=("layer",)) if effect.site == "force" else effect


def _gap(values: Mapping[str, float], hidden: Mapping[str, float]) -> tuple[float, ...]:
    """Heights of the gap at `KNOTS` less its shift [m]; none where it is that of the model."""
    if not hidden.get("wave"):
        return ()
    cubic = values["g_max"] * (1.0 - 3.0 * KNOTS**2 + 2.0 * KNOTS**3)
    wave = hidden["wave"] * np.sin(np.pi * hidden["wave_order"] * KNOTS) * (1.0 - KNOTS)
    return tuple(cubic + wave)


@lru_cache(maxsize=64)
def _simulator(full: bool, *gap: float) -> DelaminatedBeam:
    table = {"gap_table": [[float(x), g] for x, g in zip(KNOTS, gap, strict=True)]} if gap else {}
    return DelaminatedBeam(**(FULL if full else REDUCED), **table)


def system(foreign: bool = False, plans: Sequence[Plan] = PLANS, options: Mapping[str, object] = REDUCED) -> Beam:
    """Return the beam.

    foreign : whether its records are of another code
    plans : the records
    options : of the simulator that seeks
    """
    return Beam(
        name="delaminated_beam",
        options=options,
        truth={**TRUTH, "foreign": 1.0} if foreign else TRUTH,
        windows=WINDOWS,
        fixed={name: TRUTH[name] for name in TRUTH if TRUTH[name] != NOMINAL[name] and name not in WINDOWS},
        plans=tuple(plans),
        plant=None,
        measured={"layer": 1},
        place="centre",
        quantity="displacement",
        feature="phase_curve",
        structure={"thicker_layer": "layer_thickness"},
        effects=EFFECTS,
        length=3.68e-3,
        omega=2.0 * np.pi * 106.04,
        periods=6,
        samples=200,
        time=np.zeros(0),
        remainders=("wave", "thicker_layer"),
        step=1e-3,
        cycles=(2.5, 8.0),
    )
