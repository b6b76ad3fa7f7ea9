"""A simulator that does not keep its contract is told so."""

import pytest
import xarray as xr
from tiny_simulators import DRIVE, Echo

from calib.errors import CalibError
from calib.modelling.model import Model


def test_a_simulator_without_run_and_sites_is_told_both():
    class Half:
        name, bodies, parameters = "half", ("mass",), Echo.parameters

    with pytest.raises(
        CalibError, match=r"simulator Half lacks sites, .*; run, the method run\(values, excitation, laws, request\);"
    ):
        Model(Half())


def test_the_class_in_the_place_of_a_simulator_is_told():
    with pytest.raises(CalibError, match=r"expected a simulator, got the class Echo; make one: Echo\(\)"):
        Model(Echo)


@pytest.mark.parametrize(("name", "value"), [("bodies", "mass"), ("bodies", 1), ("parameters", ("gain",))])
def test_an_attribute_of_another_kind_is_refused(name, value):
    simulator = Echo()
    setattr(simulator, name, value)
    with pytest.raises(CalibError, match=f"simulator Echo: {name}: expected a tuple of"):
        Model(simulator)


@pytest.mark.parametrize(
    ("returned", "message"),
    [
        (None, "Odd.run returned None"),
        ([1.0], "Odd.run returned an object of type list"),
        (xr.Dataset(), "a dataset without the attribute status"),
        (xr.Dataset(attrs={"status": "ok"}), "a dataset without the coordinate body"),
    ],
)
def test_what_is_no_record_is_a_failed_run_that_names_the_class(returned, message):
    class Odd(Echo):
        def run(self, values, excitation, laws, request):
            return returned

    record = Model(Odd()).run({}, DRIVE)
    assert record.attrs["status"] == "no record"
    assert message in record.attrs["reason"]
    assert "expected a record" in record.attrs["reason"]


def test_complex_values_are_no_record():
    class Unreal(Echo):
        def run(self, values, excitation, laws, request):
            record = super().run(values, excitation, laws, request)
            return record.assign(velocity=record["velocity"].astype(complex))

    record = Model(Unreal()).run({}, DRIVE)
    assert record.attrs["status"] == "no record"
    assert record.attrs["reason"].startswith("Unreal.run returned complex values of velocity; expected a record")


def test_a_motion_whose_squares_overflow_has_diverged():
    class Large(Echo):
        def run(self, values, excitation, laws, request):
            record = super().run(values, excitation, laws, request)
            return record.assign(velocity=1e200 * record["velocity"])

    record = Model(Large()).run({}, DRIVE)
    assert record.attrs["status"] == "diverged"
    assert record.attrs["reason"].startswith("velocity reaches")
    assert "a record holds up to 1e+100 in SI units" in record.attrs["reason"]


def test_a_model_without_parameters_says_so():
    class Free(Echo):
        parameters = ()

    with pytest.raises(CalibError, match="unknown parameter 'gain'; this model has no parameters"):
        Model(Free()).run({"gain": 1.0}, DRIVE)
