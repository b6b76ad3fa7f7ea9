"""Force laws that no library has, hidden by another integrator: found as free functions and formulas, and applied."""

from functools import partial

import hidden.hider
import numpy as np
import pytest
from hidden.hider import hide

from calib.diagnosis.discovery.discover import discover
from calib.diagnosis.discovery.outcome import FOUND, NOTHING
from calib.execution.pool import InProcess
from calib.store import Store
from calib.study import evaluate
from calib.study_file import load
from calib.workflows.found_effect import apply_force

pytestmark = pytest.mark.slow

LENGTH, OMEGA = 5e-3, 2.0 * np.pi * 10.0  # m, rad/s: natural scales of the oscillator
STIFFNESS, DAMPING = 3950.0, 2.5  # N/m, N s/m: of its truth, at a mass of 1 kg
SIZE = 0.01 * OMEGA**2 * LENGTH  # m/s^2: hundredth of the largest acceleration
CLAPPING, REST = 2.0 * np.pi * 26.24, 1e-3  # rad/s, m: drive and clearance at rest of the four_dof model
PLACE, WIDTH = 0.4 * LENGTH, 0.25 * LENGTH  # m, of the magnet
LAWS = {
    "drag": (
        {"c2": SIZE / (OMEGA * LENGTH) ** 2},
        lambda x, v: -SIZE * v * np.abs(v) / (OMEGA * LENGTH) ** 2,
        ("velocity",),
    ),
    "stick": (  # which makes the misfit 500 times the noise, and the calibrated amplitude leave its window
        {"friction": 6.0 * SIZE, "friction_slip": 0.01},
        lambda x, v: -6.0 * SIZE * np.tanh(v / 0.01),
        ("velocity",),
    ),
    "asymmetric": ({"k2": SIZE / LENGTH**2}, lambda x, v: -SIZE * (x / LENGTH) ** 2, ("displacement",)),
    "magnet": (  # too weak for an accurate function, not for its formula
        {"magnet": SIZE, "magnet_place": PLACE, "magnet_width": WIDTH},
        None,
        ("displacement",),
    ),
}
STRONG_MAGNET = {**LAWS["magnet"][0], "magnet": 3.0 * SIZE}
SLIGHT = {"parametric": 30.0, "parametric_order": 3.0}  # 1/s^2, of the stiffness: too slight to be found
FREE_CLOCKS = {  # seeds of laboratories whose clocks run at a rate of their own, with short records
    "AR(1) of 0.8 %": 67,  # jitter that the stamps do not tell
    "AR(2) of 2.7 %": 13,
    "AR(1) of 1.1 %": 187,  # jitter that the stamps do not tell
}
FORMULAS = {  # text, and true values of its numbers
    "drag": ("c1 v |v|", {"c1": -SIZE / (OMEGA * LENGTH) ** 2}),
    "magnet": ("c1 (x - a1)/b1 exp(-((x - a1)/b1)^2/2)", {"c1": -SIZE, "a1": PLACE, "b1": WIDTH}),
}


def discovered(folder):
    file = load(folder)
    calibration = file.study.run(Store(folder / "out"), InProcess(partial(evaluate, file.study.without_search())))
    values = {**file.study.space.fixed, **calibration.best.values}
    return discover(file.study, file.others, values, file.suspects(), pool=InProcess)


@pytest.mark.parametrize("kind", ["stick", "asymmetric", "magnet"])
def test_the_force_is_found_with_its_formula_and_applied(kind, cache, tmp_path, monkeypatch):
    acting, law, arguments = LAWS[kind]
    monkeypatch.setattr(hidden.hider, "drawn_remainder", lambda at, share, seed: (kind, acting))
    hide("oscillator", None, None, 0, folder=tmp_path, cache=cache, remainder=0.1)
    study = tmp_path / "study.toml"
    study.write_text(study.read_text().replace('name = "oscillator"', f'name = "oscillator with {kind}"', 1))
    found = discovered(tmp_path)
    assert (found.verdict, found.chosen.arguments) == (FOUND, (arguments,))
    if law is not None:
        fitted, x, v = found.chosen.fitted, found.states.x, found.states.v
        spring = -(fitted.fit.value("stiffness") - STIFFNESS) * x - (fitted.fit.value("damping") - DAMPING) * v
        force, true = fitted.model.matrix(x, v) @ fitted.coefficients + spring, law(x, v)
        assert np.sqrt(np.mean((force - true) ** 2) / np.mean(true**2)) < 0.1
    if kind in FORMULAS:
        assert_formula(found, *FORMULAS[kind])
        assert_acts_as_found(load(apply_force(load(tmp_path), found)).study, found)


def assert_formula(found, text, numbers):
    """Whether the first formula is this one, with these values within its errors."""
    best = found.formulas[0]
    assert (best.formula.text, best.ties, best.predicts) == (text, True, True)
    errors = best.errors()
    for number in best.formula.numbers:
        assert abs(number.value - numbers[number.name]) < 4.0 * errors[number.name]


def assert_acts_as_found(study, found):
    """Whether the one effect of an extended study is the formula that was found, over the visited states."""
    [effect] = study.model.effects
    assert effect.equation == found.formulas[0].formula.text
    x, v = found.states.x[::50], found.states.v[::50]
    p = effect.bound({q.name: q.nominal for q in effect.parameters}).p
    none = np.zeros(4)
    force = [effect.law.function(0.0, *state, p, none, none) for state in zip(x, v, strict=True)]
    assert force == pytest.approx(found.formulas[0].formula.values(x, v), rel=1e-6, abs=1e-9 * SIZE)


def test_no_force_is_found_where_none_is_hidden(cache, tmp_path):
    hide("oscillator", None, None, 1, folder=tmp_path, cache=cache)
    assert discovered(tmp_path).verdict == NOTHING


@pytest.mark.parametrize(("laboratory", "acting"), [("AR(2) of 2.7 %", {}), ("AR(1) of 1.1 %", SLIGHT)])
def test_no_force_is_found_where_the_laboratory_is_all_that_differs(laboratory, acting, cache, tmp_path, monkeypatch):
    monkeypatch.setattr(hidden.hider, "drawn_remainder", lambda at, share, seed: ("parametric", acting))
    lab = FREE_CLOCKS[laboratory]
    hide("oscillator", None, None, 1, folder=tmp_path, cache=cache, laboratory=lab, remainder=0.1 if acting else None)
    assert discovered(tmp_path).verdict == NOTHING


@pytest.mark.parametrize(
    ("laboratory", "kind", "acting", "changed"),
    [
        ("AR(1) of 0.8 %", "drag", LAWS["drag"][0], {}),
        ("AR(1) of 1.1 %", "magnet", STRONG_MAGNET | SLIGHT, {"c1": -3.0 * SIZE}),
    ],
)
def test_a_force_is_found_with_its_formula_by_another_laboratory(
    laboratory, kind, acting, changed, cache, tmp_path, monkeypatch
):
    """Whose clock and coloured noise are its own; of the magnet beside a slight modulation that is no function."""
    monkeypatch.setattr(hidden.hider, "drawn_remainder", lambda at, share, seed: (kind, acting))
    lab = FREE_CLOCKS[laboratory]
    hide("oscillator", None, None, 0, folder=tmp_path, cache=cache, laboratory=lab, remainder=0.1)
    found = discovered(tmp_path)
    assert (found.verdict, found.chosen.body, found.chosen.arguments) == (FOUND, "mass", (LAWS[kind][2],))
    text, numbers = FORMULAS[kind]
    assert_formula(found, text, numbers | changed)


def test_a_force_between_two_bodies_is_found_where_it_acts(cache, tmp_path, monkeypatch):
    """Of the four_dof model: a spring across the clearance that hardens with its cube, and nothing on the layer."""
    acting = {"coupling": 0.009 * CLAPPING**2 / REST**2}  # 1/(m^2 s^2)
    monkeypatch.setattr(hidden.hider, "drawn_remainder", lambda at, share, seed: ("coupling", acting))
    hide("four_dof", None, None, 0, folder=tmp_path, cache=cache, remainder=0.1)
    found = discovered(tmp_path)
    assert (found.verdict, found.chosen.body, found.chosen.arguments) == (FOUND, "interface", (("displacement",),))
    assert {trial.body for trial in found.trials} == {"interface", "q3"}
    assert not found.rivals
    fitted, x, v = found.chosen.fitted, found.chosen.fitted.model.states.x, found.chosen.fitted.model.states.v
    absorbed = fitted.model.visited @ fitted.smoothing.absorbed
    true = -acting["coupling"] * (x - REST) ** 3
    apart = fitted.surface(x, v)[0] - true
    apart -= absorbed @ np.linalg.lstsq(absorbed, apart, rcond=None)[0]
    assert np.sqrt(np.mean(apart**2) / np.mean(true**2)) < 0.4  # without it chi-square is 1.4 % above that of the noise
