"""Two causes that one effect nearly imitates, and rivals that another noise tells from the cause in another way."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp

from calib import plugins
from calib.cli import main as calib
from calib.diagnosis.candidate import Candidate
from calib.diagnosis.selection import _refitted_rivals
from calib.diagnosis.suspect import Refitted

STUDY = """
[study]
name = "decay"
seed = 1
budget = 40

[[record]]
name = "decay"
path = "decay.csv"
use = "calibrate"
nuisance = ["initial_state"]

[record.table]
time = { column = "time", unit = "s" }
channels = [{ column = "position", body = "mass", channel = "displacement", unit = "m", sigma = "0.1 mm" }]

[record.excitation]
place = "mass"
quantity = "free decay"

[model]
simulator = "oscillator"

[model.fixed]
mass = "1 kg"

[windows]
stiffness = { low = "50 N/m", high = "100 N/m" }
damping = { low = 0.001, high = 1.0, scale = "log" }

[[term]]
feature = "time_history"

[optimiser]
name = "multistart"

[diagnosis]
candidates = ["presliding", "quadratic_drag", "softening", "coulomb_friction", "plot_scale", "axis_tilt"]
"""


def swung(time):
    """Free decay from 70 mm of a mass on a spring that softens, in a resisting air."""

    def motion(_, state):
        x, v = state
        return [v, -74.0 * x * (1.0 - 0.5 * abs(x)) - 0.05 * v - 0.8 * v * abs(v)]

    return solve_ivp(motion, (0.0, time[-1]), [0.07, 0.0], t_eval=time, rtol=1e-10, atol=1e-12).y[0]


@pytest.mark.slow
def test_a_joint_that_slides_is_not_named_for_a_spring_that_softens_in_a_resisting_air(tmp_path):
    """Its force and what it dissipates depend on the amplitude, too: alone it explains 99 % of the misfit."""
    time = np.arange(2000) / 100.0
    position = swung(time) + 1e-4 * np.random.default_rng(0).standard_normal(time.size)
    table = np.column_stack([time, position])
    np.savetxt(tmp_path / "decay.csv", table, delimiter=",", header="time,position", comments="")
    (tmp_path / "study.toml").write_text(STUDY)
    for command in ("run", "diagnose"):
        answer = CliRunner().invoke(calib, [command, str(tmp_path), "--quiet"], catch_exceptions=False)
        assert answer.exit_code == 0, answer.output
    said = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert set(said["causes"]) == {"quadratic_drag", "softening"}
    sizes = {name: joint["size"] for name, joint in said["joint_sizes"].items()}
    assert sizes["quadratic_drag"]["c2"] == pytest.approx(0.8, rel=0.02)
    assert sizes["softening"]["kx"] == pytest.approx(-37.0, rel=0.02)


def test_sizes_beyond_the_natural_scale_are_brought_to_it():
    """A plot sheared by 24 s where a radian lasts 0.1 s would be of shear alone."""
    sheared = Candidate(plugins.load("calib.effects", "plot_shear"), ("shear",), {}, {"shear": 0.1})
    assert sheared.within_scale(np.array([-24.0])) == pytest.approx([-0.1])
    assert sheared.within_scale(np.array([0.03])) == pytest.approx([0.03])
    names = ("clip_displacement",)
    clipped = Candidate(plugins.load("calib.effects", "clipping"), names, {}, dict.fromkeys(names, 0.1))
    assert clipped.within_scale(np.array([np.inf])) == np.inf


def test_suspects_that_explain_about_as_much_are_fitted_again_in_another_noise():
    """Before a cause is known the misfit may hide the uncertainty of a clock: what explains most is then another."""

    def fitted(name, reduction):
        fit = SimpleNamespace(names=(name,), point=name, candidates=())
        return Refitted(SimpleNamespace(name=name), SimpleNamespace(), fit, reduction)

    cause, alike, less = fitted("softening", 1492.0), fitted("cubic_stiffness", 1481.0), fitted("preload", 500.0)
    found = SimpleNamespace(suspects=(cause, alike, less, SimpleNamespace(name="untestable")))
    state = SimpleNamespace(causes=((cause, (cause,)),), rounds=(found,))
    chi2 = {"softening": 3.0, "cubic_stiffness": 1.0, "preload": 0.0}
    fitter = SimpleNamespace(fit=lambda point, candidates: SimpleNamespace(names=(point,), chi2=chi2[point]))
    again = _refitted_rivals(fitter, SimpleNamespace(chi2=10.0), state)
    assert {s.name: s.chi2_reduction for s in again} == {"softening": 7.0, "cubic_stiffness": 9.0}
