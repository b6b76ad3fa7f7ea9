"""`calib discover` on a small study whose law is in no library, files and all."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from undrawn import undrawn

from calib.cli import main
from calib.diagnosis.discovery.document import DiscoveryResult
from calib.effects.presliding import EFFECT as PRESLIDING
from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.model import Model
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Request
from calib.records import make, write
from calib.records.excitation import Excitation
from calib.report.plots.style import png
from calib.simulators.oscillator import Oscillator
from calib.study_file import load
from calib.workflows.diagnose import diagnose_study
from calib.workflows.discover import discover_study
from calib.workflows.discovered import Discovered
from calib.workflows.study import Study

TIMES = np.arange(90) / 180.0  # s
SIZE = 2e4  # 1/(m s^2): stiffer on both sides, in proportion to x |x|
DAHL = {"dahl_force": 0.4, "dahl_distance": 5e-4}  # m/s^2, m
STUDY = """
[study]
name = "bent spring"
seed = 1
budget = 12

[[record]]
name = "soft"
path = "soft.nc"

[[record]]
name = "hard"
path = "hard.nc"

[model]
simulator = "oscillator"
fixed = { mass = 1.0 }

[windows]
damping = { low = 0.5, high = 8.0 }
stiffness = { low = 3000.0, high = 5000.0 }

[[term]]
feature = "time_history"
"""


@force
def bent(t, x, v, p, z, dz):
    """Return the force per unit mass [m/s^2] of a spring that is in no library."""
    return -p[0] * x * abs(x)


BENT = Effect("bent", "force", bent, (Parameter("bend", "1/(m s^2)", 0.0, "of the spring", null=0.0),), "stiffer")


def record(amplitude, seed, acting, effects=()):
    """A swept force on the spring, with noise of 1 %."""
    rng = np.random.default_rng(seed)
    value = amplitude * np.sin(2.0 * np.pi * (6.0 * TIMES + 10.0 * TIMES**2))
    drive = Excitation("mass", "force", time=TIMES, value=value)
    values = {"mass": 1.0, "damping": 2.0, "stiffness": 4000.0, **acting}
    motion = Model(Oscillator(), effects).run(values, drive, Request(times=TIMES))
    channels = {}
    for channel in ("displacement", "velocity"):
        rows = motion[channel].values
        channels[channel] = rows + 0.01 * rows.std() * rng.standard_normal(rows.shape)
        channels[f"{channel}_sigma"] = np.full(rows.shape, 0.01 * rows.std())
    made = make(TIMES, ["mass"], channels, place="mass", quantity="force")
    return made.assign(excitation=("time", value, {"units": "N"}))


@undrawn()
def calibrated(place, acting, *effects):
    for name, amplitude, seed in (("soft", 6.0, 0), ("hard", 9.0, 1)):
        write(record(amplitude, seed, acting, effects), place / f"{name}.nc")
    (place / "study.toml").write_text(STUDY)
    assert CliRunner().invoke(main, ["run", str(place), "-q"]).exit_code == 0
    return place


def discovered(place):
    answer = CliRunner().invoke(main, ["discover", str(place), "-j", "1", "--apply"], catch_exceptions=False)
    assert answer.exit_code == 0
    return answer.output, DiscoveryResult.from_dict(json.loads((place / "out" / "discovery.json").read_text()))


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    place = calibrated(tmp_path_factory.mktemp("bent"), {"bend": SIZE}, BENT)
    return place, *discovered(place)


@pytest.mark.slow
def test_body_and_argument_are_found(found):
    _, output, result = found
    assert (result.verdict, result.body, result.arguments) == ("found", "mass", ("displacement",))
    assert "a force on mass is missing: a function of displacement" in output
    assert result.explained > 0.9
    assert result.left_out == ("soft", "hard")
    assert result.left_out_deviance[1] < result.left_out_deviance[0]


@pytest.mark.slow
def test_the_force_is_the_hidden_one_beside_the_stiffness(found):
    _, output, result = found
    [function] = result.functions
    x, force_found = np.array(function.points[0]), np.array(function.force)
    total = force_found - (result.parameters["stiffness"] - 4000.0) * x
    true = -SIZE * x * np.abs(x)
    assert np.sqrt(np.mean((total - true) ** 2) / np.mean(true**2)) < 0.1
    assert result.undetermined == ("a multiple of the displacement",)
    assert "not determined beside the calibrated parameters: a multiple of the displacement" in output
    apart = force_found - true
    apart -= x * (x @ apart) / (x @ x)
    assert np.mean(np.abs(apart) < 2.0 * np.array(function.error)) > 0.8


@pytest.mark.slow
def test_the_formula_of_the_force_is_first(found):
    _, output, result = found
    assert result.formula == result.formulas[0]
    assert result.formula.text == "c1 x |x|"
    [number] = result.formula.numbers
    assert (number.unit, number.value) == ("1/(m s^2)", pytest.approx(-SIZE, abs=4.0 * number.error))
    assert "formula: c1 x |x|\n  c1 = -" in output
    [function] = result.functions
    apart = np.array(function.formula) - np.array(function.force)
    assert np.mean(np.abs(apart) < 2.5 * np.array(function.error)) > 0.8


@pytest.mark.slow
def test_a_search_whose_budget_is_spent_fits_one_force_and_says_so(found):
    place, _, _ = found
    result, extended = discover_study(place, place / "out", jobs=1, budget="1")
    assert (result.cut_short, len(result.trials), result.formulas, extended) == (True, 1, (), None)
    assert result.verdict == "undetermined"
    assert result.summary.startswith("the budget ended the search before all was tried")


@pytest.mark.slow
def test_the_extended_study_has_the_force_in_its_model(found):
    place, output, _ = found
    extended = load(place / "study.found.toml")
    [effect] = extended.study.model.effects
    assert (effect.name, effect.equation, effect.bodies) == ("found_bent_spring", "c1 x |x|", ("mass",))
    assert "found_c1" in extended.study.space.names
    assert "study.found.toml" in output


@pytest.mark.slow
def test_the_extended_study_runs_to_the_noise_and_nothing_more_is_found_in_it(found):
    place, _, _ = found
    path = place / "study.found.toml"
    assert CliRunner().invoke(main, ["run", str(path), "-q"], catch_exceptions=False).exit_code == 0
    result = discover_study(path, jobs=1)[0]
    assert result.verdict == "nothing"
    diagnosis, _ = diagnose_study(path, jobs=1)
    assert diagnosis.verdict == "none"


@pytest.mark.slow
def test_the_force_is_drawn_and_shown(found):
    place, _, result = found
    assert (place / "out" / "discovery.png").read_bytes().startswith(b"\x89PNG")
    shown = Discovered(result, "bent spring")
    assert repr(shown).startswith("force law of 'bent spring': found: force on mass over displacement\n")
    assert "c1 x |x|; c1 = -" in repr(shown)
    assert r"$$c_{1}\,x\,|x|$$" in shown._repr_html_()
    assert "data:image/png;base64," in shown._repr_html_()
    assert png(shown.plot().figure).startswith(b"\x89PNG")


@pytest.mark.slow
def test_nothing_is_found_where_nothing_is_missing(tmp_path):
    place = calibrated(tmp_path, {})
    output, result = discovered(place)
    assert result.verdict == "nothing"
    assert not result.functions
    assert not (place / "out" / "discovery.png").exists()
    assert "nothing: " in output


@pytest.mark.slow
def test_a_force_that_depends_on_history_is_told_from_functions_of_the_state_and_applied(tmp_path):
    """Of Dahl's friction a sum of two functions explains nearly all: a law with an internal state predicts better."""
    place = calibrated(tmp_path, DAHL, PRESLIDING)
    output, result = discovered(place)
    assert result.depends_on_history
    assert "history_dependent: a force on mass is missing that depends on the history of the motion" in output
    names = [law.effect for law in result.histories]
    assert "presliding" in names
    assert result.histories[0].left_out_deviance < result.left_out_deviance[1]
    study = load(place / "study.found.toml").study
    assert [effect.name for effect in study.model.effects] == names[:1]
    answer = CliRunner().invoke(main, ["run", str(place / "study.found.toml"), "-q"], catch_exceptions=False)
    assert answer.exit_code == 0


@pytest.mark.slow
def test_python_and_json_say_what_the_command_says(found):
    place, _, result = found
    from_python = Study.read(place).run(quiet=True).discover(quiet=True)
    assert isinstance(from_python, Discovered)
    assert from_python.summary.functions == result.functions
    answer = CliRunner().invoke(main, ["discover", str(place), "--json"], catch_exceptions=False)
    assert DiscoveryResult.from_dict(json.loads(answer.stdout)).functions == result.functions


def test_a_study_that_was_not_calibrated_is_refused(tmp_path):
    write(record(6.0, 0, {}), tmp_path / "soft.nc")
    write(record(9.0, 1, {}), tmp_path / "hard.nc")
    (tmp_path / "study.toml").write_text(STUDY)
    answer = CliRunner().invoke(main, ["discover", str(tmp_path)])
    assert answer.exit_code != 0
    assert "calibrate first, with `calib run" in answer.output
