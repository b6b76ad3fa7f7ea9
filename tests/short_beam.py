"""A short, thick beam with few elements: its full kernel takes milliseconds a period."""

from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.records import OK
from calib.records.excitation import Excitation
from calib.simulators.delaminated_beam import DelaminatedBeam

MESH = {"masters": 4, "outer": 4, "beam_rows": (1.0,)}
VALUES = {"beam_thickness": 0.030, "layer_thickness": 0.010, "dt": 1.7e-6, "alpha": 800.0, "g_max": 0.8e-3, "s": 3.2e-3}
EXCITATION = Excitation("centre", "displacement", frequency=106.04, amplitude=3.68e-3)
REQUEST = Request(periods=2, samples=100)


def beam(**options) -> DelaminatedBeam:
    """Return the simulator, with some options changed."""
    return DelaminatedBeam(**{**MESH, **options})


def attempt(simulator, *effects, request=REQUEST, excitation=EXCITATION, **values):
    """Return the record of the short beam's motion, whatever its status."""
    return Model(simulator, effects).run({**VALUES, **values}, excitation, request)


def run(simulator, *effects, **changes):
    """Return the record of a motion that has to succeed."""
    record = attempt(simulator, *effects, **changes)
    assert record.attrs["status"] == OK, record.attrs["reason"]
    return record
