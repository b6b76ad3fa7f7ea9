"""Two causes that one effect nearly imitates, and rivals that another noise tells from the cause in another way."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from in_turn import InTurn
from softening_decay import DRAG, SOFTENING, written

from calib import plugins
from calib.cli import main as calib
from calib.diagnosis.candidate import Candidate
from calib.diagnosis.compromise import _fitted_from
from calib.diagnosis.forward import _refitted_rivals
from calib.diagnosis.model_selection import _recalibrated
from calib.diagnosis.signature import Point
from calib.diagnosis.stepwise import StepwiseState
from calib.diagnosis.suspect import Refitted

NEAR = ("presliding", "quadratic_drag", "softening", "coulomb_friction", "plot_scale", "axis_tilt")


@pytest.mark.slow
def test_a_joint_that_slides_is_not_named_for_a_spring_that_softens_in_a_resisting_air(tmp_path):
    """Its force and what it dissipates depend on the amplitude, too: alone it explains 99 % of the misfit."""
    written(tmp_path, 20.0, NEAR)
    for command in ("run", "diagnose"):
        answer = CliRunner().invoke(calib, [command, str(tmp_path), "--quiet"], catch_exceptions=False)
        assert answer.exit_code == 0, answer.output
    said = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert set(said["causes"]) == {"quadratic_drag", "softening"}
    sizes = {name: joint["size"] for name, joint in said["joint_sizes"].items()}
    assert sizes["quadratic_drag"]["c2"] == pytest.approx(DRAG, rel=0.02)
    assert sizes["softening"]["kx"] == pytest.approx(SOFTENING, rel=0.02)


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
        fit = SimpleNamespace(names=(name,), point=name, candidates=(), chi2=0.0)
        return Refitted(SimpleNamespace(name=name), SimpleNamespace(), fit, reduction)

    cause, alike, less = fitted("softening", 1492.0), fitted("cubic_stiffness", 1481.0), fitted("preload", 500.0)
    found = SimpleNamespace(suspects=(cause, alike, less, SimpleNamespace(name="untestable")))
    found.threshold = 3.0
    state = SimpleNamespace(causes=((cause, (cause,)),), rounds=(found,))
    chi2 = {"softening": 3.0, "cubic_stiffness": 1.0, "preload": 0.0}
    bounds = {}

    def fit(point, candidates, rival):
        bounds[point] = rival
        return SimpleNamespace(names=(point,), chi2=chi2[point])

    base = SimpleNamespace(chi2=10.0, residual=np.zeros(8))
    again = _refitted_rivals(InTurn(fit=fit), base, state)
    assert np.isinf(bounds["softening"])
    assert 3.0 < bounds["cubic_stiffness"] < np.inf  # what stays behind is given up
    assert {s.name: s.chi2_reduction for s in again} == {"softening": 7.0, "cubic_stiffness": 9.0}


@pytest.mark.parametrize(("beyond", "taken"), [(20.0, True), (999.0, False)])
def test_a_cause_that_a_pair_would_replace_is_fitted_again_from_where_the_pair_was_found(beyond, taken):
    """A fit that ended at another minimum: from the values of the pair it falls from 1000 to `beyond`."""
    drag = SimpleNamespace(name="linear_drag", free=("c1",))
    old = SimpleNamespace(chi2=1000.0, names=("damping", "c1"), value={"damping": 0.01, "c1": 17.6}.get)
    old.point = Point({"damping": 0.01, "mass": 1.0, "c1": 17.6}, (), {})
    cause, rival = Refitted(drag, SimpleNamespace(), old, 500.0), SimpleNamespace(name="support")
    state = StepwiseState(SimpleNamespace(names=("damping",)), old, {}, causes=((cause, (cause, rival)),))
    began = []

    def fit(start, candidates, sizes, rival):
        began.append((start.values, candidates, sizes, rival))
        return SimpleNamespace(names=old.names, chi2=beyond)

    fitter = SimpleNamespace(fit=fit, with_derivatives=lambda fit: fit)
    found = _fitted_from(fitter, state, SimpleNamespace(value={"damping": 0.006}.get))
    assert began == [({"damping": 0.006, "mass": 1.0, "c1": 17.6}, [drag], {"c1": 17.6}, 1000.0)]
    assert found.final.chi2 == (beyond if taken else 1000.0)
    [(again, rivals)] = found.causes
    assert again.chi2_reduction == (500.0 + 980.0 if taken else 500.0)
    assert rivals == (again, rival)


@pytest.mark.parametrize(
    ("at_an_edge", "chi2", "again", "kept"),
    [
        (True, 5000.0, 500.0, 500.0),
        (True, 5000.0, 4999.0, 5000.0),  # no lower than chance
        (False, 5000.0, 500.0, 5000.0),
        (True, 1020.0, 500.0, 1020.0),  # it leaves little more than noise
    ],
)
def test_a_calibrated_model_at_the_edge_of_its_windows_is_fitted_from_their_middle_too(at_an_edge, chi2, again, kept):
    def model(chi2):
        none = np.zeros((0, 0))
        point = SimpleNamespace(simulated={})
        return SimpleNamespace(chi2=chi2, names=("damping",), point=point, columns=none, nuisances=none, residual=none)

    fitter = SimpleNamespace(
        evidence=SimpleNamespace(parts=(), counted=lambda: 1000.0),
        is_at_an_edge=lambda fit: at_an_edge,
        in_the_middle=lambda fit: model(9000.0),
        fit=lambda start, columns, rival: model(again),
        with_derivatives=lambda fit: fit,
    )
    assert _recalibrated(fitter, model(chi2)).chi2 == kept
