"""Diagnoses made up for the report: one of each verdict."""

import numpy as np
import xarray as xr

from calib.diagnosis.laboratory import DesignPoint, DesignVariable
from calib.diagnosis.measurement import EvaluatedPoint, Measurement
from calib.diagnosis.next_measurement import Design, RecordedPoint
from calib.diagnosis.noise import CYCLIC
from calib.diagnosis.serialise import design_result, measurement_result
from calib.store.plain import plain

CYCLES, SAMPLES, PERIOD = 6, 200, 0.04  # periods of the records; samples a period; s
SIGMA = {"displacement": 2e-5, "velocity": 4e-3}
UNITS = {"displacement": "m", "velocity": "m/s"}


def motion(rng, amplitude=2.5e-3, lack=0.0, shape=np.square, extended=True):
    """A beam that is calibrated well and a layer whose motion differs by `lack` times a shape of its velocity."""
    phase = np.arange(CYCLES * SAMPLES) / SAMPLES
    omega = 2.0 * np.pi / PERIOD
    rows = []
    for size in (amplitude, 1.4 * amplitude):
        saw = (phase - 0.3) % 1.0
        rows += [size * (np.cos(2 * np.pi * phase) + 0.3 * (saw - saw**2))]
        rows += [size * omega * (-np.sin(2 * np.pi * phase) + 0.05 * (1.0 - 2.0 * saw))]
    true = np.array(rows)
    calibrated = true.copy()
    v = true[3] / np.abs(true[3]).max()
    calibrated[3] -= lack * np.abs(true[3]).max() * shape(v) * np.sign(v)
    calibrated[2] -= lack * np.abs(true[2]).max() * np.roll(shape(v) * np.sign(v), SAMPLES // 4)
    channels = ["displacement", "velocity"] * 2
    sigma = np.array([SIGMA[c] for c in channels])
    weight = np.ones_like(true)
    weight[1::2, np.abs(saw - 0.5) > 0.49] = 0.0
    over = ("row", "time")
    views = {"measured": true + sigma[:, None] * rng.standard_normal(true.shape), "calibrated": calibrated}
    views |= {"weight": weight} | ({"extended": true} if extended else {})
    noise = {"sigma": ("row", sigma), "innovation": ("row", sigma), "memory": (("row", "lag"), np.zeros((4, 1)))}
    return xr.Dataset(
        {name: (over, values) for name, values in views.items()} | noise,
        coords={
            "time": PERIOD * phase,
            "body": ("row", ["q2", "q2", "q3", "q3"]),
            "channel": ("row", channels),
            "unit": ("row", [UNITS[c] for c in channels]),
            "source": ("row", [CYCLIC] * len(channels)),
        },
        attrs={"cycle": 1, "period": PERIOD},
    )


def suspect(effect, parameter, unit, z, size, error, share, **rest):
    """Make a suspect with one parameter, which must not be negative."""
    return {
        "effect": effect,
        "meaning": f"what {effect} is",
        "equation": f"-{parameter} f(x, v)",
        "bodies": ["q3"],
        "z": z,
        "size": {parameter: size},
        "interval": {parameter: [size - 1.96 * error, size + 1.96 * error]},
        "held": {},
        "limits": {parameter: [0.0, None]},
        "units": {parameter: unit},
        "share": share,
        "absorbed": 0.4,
        "detectable": {parameter: 3.5 * error},
        "drop": 900.0 * share,
        "refitted": share > 0.3,
        "null": {parameter: 0.0},
        "alike": 0.9,
        "reason": "",
        **rest,
    }


def suspects(strength=1.0):
    """Make suspects, the strongest first, whose strengths are this times those of a clear case."""
    return [
        suspect("quadratic_drag", "c2", "1/m", 30.0 * strength, 2.4, 0.08, 1.02, alike=1.0),
        suspect("linear_drag", "c1", "1/s", 18.0 * strength, 1.4, 0.08, 0.5),
        suspect("coulomb_friction", "friction", "m/s^2", -9.0 * strength, -0.1, 0.01, 0.1, held={"slip": 0.009}),
        suspect("channel_lag", "lag", "s", 6.0 * strength, 8e-6, 1.3e-6, 0.04),
        suspect("cubic_stiffness", "k3", "1/(m^2 s^2)", 1.4 * strength, -1.3e6, 9e5, 0.005),
        _untested(),
    ]


def _untested():
    """Make a suspect that has no derivative and was not fitted."""
    made = suspect("clipping", "clip", "1", 0.0, 0.0, 1.0, 0.0)
    return made | {
        "interval": {"clip": [None, None]},
        "detectable": {"clip": None},
        "alike": None,
        "reason": "it has no derivative where it is absent, so no score test; it is judged by the samples themselves",
    }


def feature(label, unit, measured, simulated, error):
    """Make a row of the table of features."""
    z = None if simulated is None else (simulated - measured) / error
    row = {"label": label, "record": "clapping", "body": "q3", "unit": unit}
    return row | {"measured": measured, "simulated": simulated, "error": error, "z": z}


GATES = [
    {"name": "simulation", "passed": True, "said": "every record is simulated", "z": None},
    {"name": "kind of motion", "passed": True, "said": "simulated motions have the measured period", "z": None},
    {"name": "noise", "passed": True, "said": "clapping q3 displacement: 2e-05 (cycle to cycle)", "z": None},
    {"name": "time_step", "passed": True, "said": "made 2 times finer, it changes the records by z = 0.1", "z": 0.1},
]
MISFIT = {
    "excess": 900.0,
    "left": -20.0,
    "blur": 60.0,
    "share": 1.02,
    "features": [
        feature("displacement amplitude", "m", 2.41e-3, 2.47e-3, 4e-6),
        feature("velocity change at impact", "m/s", 0.4135, 0.3825, 0.0031),
        feature("phase of impact", "1", 0.301, None, 0.001),
        feature("second harmonic of velocity", "1", 0.394, 0.3942, 0.0003),
    ],
    "channels": [],
}
GAIN = {
    "metric": "root mean square",
    "kind": "records held out",
    "before": 0.031,
    "after": 0.0104,
    "interval": [0.018, 0.023],
    "records": ["louder", "slower"],
    "proven": True,
    "each": {"louder": [0.033, 0.0105], "slower": [0.029, 0.0103]},
    "failed": {},
    "transfers": [
        {"record": "clapping", "parameter": "c2", "size": 2.38, "error": 0.05, "held": False},
        {"record": "quiet", "parameter": "c2", "size": 3.4, "error": 1.1, "held": False},
        {"record": "louder", "parameter": "c2", "size": 2.45, "error": 0.06, "held": True},
    ],
    "agreements": [{"parameter": "c2", "chi2": 1.6, "degrees": 2, "z": 0.75, "agree": True}],
    "shifts": [
        {
            "parameter": "restitution",
            "before": 0.0917,
            "after": 0.1001,
            "before_error": 0.00042,
            "after_error": 0.0003,
            "errors": 19.8,
        },
        {
            "parameter": "gap",
            "before": 1.01e-3,
            "after": 1.0e-3,
            "before_error": 7e-6,
            "after_error": 5e-6,
            "errors": -1.4,
        },
    ],
}
ROUNDS = [
    {"threshold": 3.43, "chosen": "quadratic_drag", "share": 1.02, "rivals": ["quadratic_drag"], "alike": {}},
    {"threshold": 3.44, "chosen": None, "share": None, "rivals": [], "alike": {}},
]


def document(verdict, values):
    """Make what diagnosis.json holds where the diagnosis came to this verdict on these values."""
    said = {
        "verdict": verdict,
        "said": "",
        "causes": ["quadratic_drag"],
        "class": [["quadratic_drag"]],
        "closest": [],
        "suspects": suspects(),
        "rounds": ROUNDS,
        "refused": {"glue_bond": "layer_stiffness is searched already"},
        "gates": GATES,
        "outliers": 0.0,
        "misfit": MISFIT,
        "parameters": {},
        "gain": GAIN,
        "next_measurement": None,
        "measurements": [],
        "design": None,
        "threshold": 3.43,
        "simulations": 304,
        "seconds": 104.2,
        "values": dict(values),
    }
    return said | CHANGES[verdict]


BOUNDS = {"frequency": (12.5, 50.0), "amplitude": (1.5e-4, 2.25e-3)}  # Hz, m
BEST = {  # kind of test -> settings, impacts, z
    "steady tone": (DesignPoint("steady tone", 3.75e-4, 20.0), False, 8.4),
    "free decay": (DesignPoint("free decay", release=2e-3), True, 2.1),
}


def tones():
    """Make evaluated steady tones: a ridge at 20 Hz, contact above, an irregular and a failed one."""
    made = []
    for amplitude in np.geomspace(*BOUNDS["amplitude"], 4):
        for frequency in np.geomspace(*BOUNDS["frequency"], 6):
            point = DesignPoint("steady tone", float(amplitude), float(frequency))
            z = 8.0 * np.exp(-((np.log(frequency / 20.0) / 0.3) ** 2)) * (3e-4 / amplitude) ** 0.5
            made.append(EvaluatedPoint(point, "grid", "ok", "", bool(amplitude * frequency > 0.02), z, 1.5 * z))
    for index, status in ((20, "irregular"), (23, "failed")):
        made[index] = EvaluatedPoint(made[index].point, "grid", status, "it does not return")
    made.append(EvaluatedPoint(BEST["steady tone"][0], "refinement", "ok", "", False, 8.4, 9.1))
    made.append(EvaluatedPoint(DesignPoint("steady tone", 4e-4, 21.0), "refinement", "failed", "it diverges"))
    return tuple(made)


def design():
    """Make the search for a next measurement that a diagnosis keeps."""
    decays = tuple(
        EvaluatedPoint(DesignPoint("free decay", release=x), "grid", "ok", "", True, z, z)
        for x, z in ((1e-3, 0.4), (2e-3, 2.1), (4e-3, 1.3))
    )
    measurements = [
        Measurement(kind, words, "clapping", point, "", impacts, int(z > 3.0), 1, 0, z, 1.1 * z, z)
        for (kind, (point, impacts, z)), words in zip(
            BEST.items(),
            ("a steady tone of 0.375 mm at 20 Hz, without impacts", "a free decay, released from 2 mm, with impacts"),
            strict=True,
        )
    ]
    return Design(
        record="clapping",
        models=("quadratic_drag", "linear_drag"),
        variables=(
            DesignVariable("amplitude", "m", *BOUNDS["amplitude"], stated=False),
            DesignVariable("frequency", "Hz", *BOUNDS["frequency"], stated=True),
            DesignVariable("release", "m", 1e-3, 4e-3, stated=False),
        ),
        points=(*tones(), *decays),
        measurements=tuple(measurements),
        unavailable={"sweep": "the simulator has no initial state that could be solved for"},
        known=(RecordedPoint("clapping", 1.5e-3, 25.0), RecordedPoint("quiet", 2.5e-4, 25.0)),
        simulations=412,
        max_simulations=1000,
    )


DESIGN = plain(design_result(design()))
MEASUREMENTS = plain([measurement_result(m) for m in design().measurements])
LEFT = MISFIT | {"excess": 30.0, "left": 30.0, "share": 0.0, "features": MISFIT["features"][3:]}
FAILED = [
    GATES[0],
    {"name": "kind of motion", "passed": False, "said": "clapping: period 2 instead of period 1", "z": None},
]
CHANGES = {
    "named": {},
    "one_of": {
        "said": "one of quadratic_drag, linear_drag; they explain 100% of the excess misfit equally well",
        "causes": [],
        "class": [["quadratic_drag"], ["linear_drag"]],
        "rounds": [{**ROUNDS[0], "rivals": ["quadratic_drag", "linear_drag"], "alike": {"linear_drag": 0.97}}],
        "measurements": MEASUREMENTS,
        "next_measurement": MEASUREMENTS[0],
        "design": DESIGN,
    },
    "none": {
        "causes": [],
        "class": [],
        "suspects": suspects(0.05),
        "rounds": [ROUNDS[1]],
        "misfit": LEFT,
        "gain": None,
    },
    "unexplained": {
        "causes": [],
        "class": [],
        "closest": ["quadratic_drag"],
        "misfit": MISFIT | {"left": 700.0, "share": 0.22},
    },
    "not_diagnosable": {
        "causes": [],
        "class": [],
        "suspects": [],
        "rounds": [],
        "refused": {},
        "gates": FAILED,
        "misfit": {},
        "gain": None,
        "threshold": None,
    },
}


def motions(verdict, seed=1):
    """Make what diagnosis.nc holds."""
    rng = np.random.default_rng(seed)
    if verdict == "not_diagnosable":
        return {}
    lack = 0.0 if verdict == "none" else 0.02
    extended = verdict not in ("none",)
    return {
        "clapping": motion(rng, lack=lack, extended=extended),
        "quiet": motion(rng, 4e-4, lack=0.3 * lack, extended=extended),
    }
