"""An effect that needs an excitation is refused where no record has it: nothing would show its size."""

import numpy as np
import pytest

from calib import plugins, records
from calib.diagnosis.candidate import candidates
from calib.errors import CalibError
from calib.modelling.effect import Effect
from calib.modelling.model import Model
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Request
from calib.objective import Reference
from calib.records.excitation import Excitation
from calib.simulators.oscillator import Oscillator
from calib.study_file import load

EFFECTS = plugins.load_all("calib.effects")
TIME = np.linspace(0.0, 2.0, 401)
TONE = Excitation("mass", "force", frequency=2.0, amplitude=1.0)
SAMPLES = Excitation("mass", "force", time=TIME, value=np.cos(4.0 * np.pi * TIME))
DECAY = Excitation("mass", "free decay")
OF_A_TONE = {
    "drive_harmonic_2": {"h2_cos": 0.5},
    "drive_harmonic_3": {"h3_cos": 0.5},
    "phase_jitter": {"jitter_sin": 1.0},
    "frequency_drift": {"chirp": 1.0},
}
STUDY = """\
[study]
name = "driven"
seed = 1
budget = 10
[[record]]
name = "run"
path = "run.nc"
[model]
simulator = "oscillator"
effects = ["{effect}"]
[windows]
mass = {{ low = 0.5, high = 2.0 }}
[[term]]
feature = "time_history"
[optimiser]
name = "multistart"
"""


def simulated(excitation, *effects, **values):
    request = Request(times=TIME) if not excitation.harmonic else Request(periods=4, samples=100, settle=0)
    given = {"initial_displacement": 1e-2 if excitation is DECAY else 0.0, **values}
    return Model(Oscillator(), effects).run(given, excitation, request)


def references(*excitations, settle=None):
    made = [
        Reference(f"run{i}", simulated(one), excitation=one, request=Request(times=TIME, settle=settle))
        for i, one in enumerate(excitations)
    ]
    return {one.name: one for one in made}


@pytest.mark.parametrize("name", OF_A_TONE)
def test_it_changes_a_tone_and_no_recorded_input_or_free_decay(name):
    effect = EFFECTS[name]
    changes = [
        float(np.abs(simulated(one, effect, **OF_A_TONE[name]).displacement - simulated(one).displacement).max())
        for one in (TONE, SAMPLES, DECAY)
    ]
    assert changes[0] > 1e-6 > 1e-15 > max(changes[1:])
    assert effect.undriven([SAMPLES, DECAY]) == "it needs a harmonic excitation, which no record has"
    assert effect.undriven([SAMPLES, TONE]) == ""


def test_a_drive_that_is_modulated_may_be_recorded():
    effect = EFFECTS["drive_modulation"]
    assert effect.undriven([DECAY]) == "it needs an excitation, and every record is a free decay"
    assert effect.undriven([DECAY, SAMPLES]) == ""


@pytest.mark.parametrize("name", OF_A_TONE)
@pytest.mark.parametrize(
    ("excitations", "suspected"), [((SAMPLES,), False), ((SAMPLES, DECAY), False), ((SAMPLES, TONE), True)]
)
def test_it_is_suspected_only_where_a_record_shows_it(name, excitations, suspected):
    found, refused = candidates(Model(Oscillator()), [EFFECTS[name]], references(*excitations, settle=0), [])
    assert (bool(found), "harmonic excitation" in refused.get(name, "")) == (suspected, not suspected)


@pytest.mark.parametrize("name", ["phase_jitter", "frequency_drift"])
def test_one_that_is_explicit_in_time_is_not_suspected_where_the_tone_has_settled(name):
    _, refused = candidates(Model(Oscillator()), [EFFECTS[name]], references(SAMPLES, TONE), [])
    assert "settled" in refused[name]


@pytest.mark.parametrize("name", OF_A_TONE)
def test_a_study_of_recorded_inputs_refuses_it(name, tmp_path):
    measured = simulated(SAMPLES)
    measured["excitation"] = ("time", np.asarray(SAMPLES.value), {"units": "N"})
    records.write(measured, tmp_path / "run.nc")
    (tmp_path / "study.toml").write_text(STUDY.format(effect=name))
    with pytest.raises(CalibError, match=f"effect '{name}': it needs a harmonic excitation, which no record has; drop"):
        load(tmp_path / "study.toml")
    (tmp_path / "study.toml").write_text(STUDY.format(effect="drive_modulation"))
    assert load(tmp_path / "study.toml").study.model.effects == (EFFECTS["drive_modulation"],)


@pytest.mark.parametrize(
    ("stated", "expected"),
    [
        ({"drive": "tone"}, "needs the drive 'tone'; known are 'harmonic', 'any' and ''"),
        ({"positive": ("gap",)}, "needs 'gap' above 0, but does not borrow it"),
    ],
)
def test_what_an_effect_needs_is_checked(stated, expected):
    law = EFFECTS["linear_drag"].law
    with pytest.raises(CalibError, match=expected):
        Effect("drag", "force", law, (Parameter("c", "1/s", 0.0, "of it", null=0.0),), "of it", **stated)
