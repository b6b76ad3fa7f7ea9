import numpy as np
import pytest

from calib.errors import CalibError
from calib.records import record
from calib.records.excitation import Excitation

TIME = np.linspace(0.0, 0.1, 50)


def swing(**attrs):
    x = np.array([np.cos(60 * TIME), np.sin(60 * TIME)])
    attrs = {"frequency": 60 / (2 * np.pi), "amplitude": 1e-3, "place": "end", "quantity": "displacement", **attrs}
    return record.make(TIME, ["beam", "layer"], {"displacement": x, "velocity": 60 * x}, **attrs)


def test_a_body_that_is_not_there_is_answered_with_those_that_are():
    with pytest.raises(CalibError, match=r"no body 'laier' \(did you mean 'layer'\?\)"):
        record.rename_bodies(swing(), {"laier": "q3"})


def test_bodies_take_the_simulator_s_names():
    renamed = record.rename_bodies(swing(), {"layer": "q3"})
    assert list(renamed.body.values) == ["q3"]
    assert (renamed.displacement.values[0] == swing().displacement.values[1]).all()


def test_a_prescribed_channel_keeps_its_body_under_the_new_name():
    renamed = record.rename_bodies(swing(prescribed="beam.displacement,layer.velocity"), {"layer": "q3"})
    assert renamed.attrs["prescribed"] == "q3.velocity"


def test_with_other_channels_all_else_of_a_record_stays_and_the_record_itself_too():
    before = swing(section={"displacement": np.zeros((2, 3))}, impacts=(np.array([0.02]), np.array([0.4])))
    other = record.with_channels(before, {"velocity": np.zeros((2, TIME.size))})
    assert before.identical(
        swing(section={"displacement": np.zeros((2, 3))}, impacts=(np.array([0.02]), np.array([0.4])))
    )
    assert other.identical(before.assign(velocity=before.velocity.copy(data=np.zeros((2, TIME.size)))))
    with pytest.raises(ValueError, match="pressure"):
        record.with_channels(before, {"pressure": np.zeros((2, TIME.size))})


def test_a_failed_run_is_a_record_without_samples():
    r = record.failed(["beam"], "diverged", "the gap is negative")
    assert (r.attrs["status"], r.attrs["reason"], r.sizes["time"]) == ("diverged", "the gap is negative", 0)


def test_a_record_tells_its_excitation():
    e = Excitation.of(swing())
    assert (e.place, e.quantity, e.unit, e.period) == ("end", "displacement", "m", pytest.approx(2 * np.pi / 60))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"quantity": "forse"}, "did you mean 'force'"),
        ({"frequency": -1.0}, "positive"),
        ({"amplitude": None}, "needs"),
        ({"time": TIME}, "both time"),
        ({"time": TIME, "value": np.full(50, np.nan)}, "NaN"),
        ({"time": TIME[::-1], "value": TIME}, "increase"),
    ],
)
def test_an_impossible_excitation_is_refused(given, said):
    with pytest.raises(CalibError, match=said):
        Excitation(**{"place": "end", "quantity": "force", "frequency": 1.0, "amplitude": 1.0, **given})


def test_an_excitation_is_read_as_a_harmonic_or_as_samples_and_never_as_the_other():
    tone = Excitation("end", "force", frequency=4.0, amplitude=2.0, phase=0.5)
    assert tone.as_harmonic == (4.0, 2.0, 0.5)
    assert tone.as_harmonic.period == 0.25
    time, value = np.array([0.0, 1.0]), np.array([3.0, 4.0])
    recorded = Excitation("end", "force", frequency=4.0, amplitude=2.0, time=time, value=value)
    assert recorded.as_samples == (time, value)
    with pytest.raises(CalibError, match="a harmonic excitation is needed, got force by samples;"):
        _ = recorded.as_harmonic
    with pytest.raises(CalibError, match="a harmonic excitation is needed, got free decay;"):
        _ = Excitation("end", "free decay").as_harmonic
    with pytest.raises(CalibError, match="a recorded excitation is needed, got force without samples"):
        _ = tone.as_samples
