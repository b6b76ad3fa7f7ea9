"""Force laws hidden by another integrator: their formulas are found, and become effects of an extended study."""

import hidden.hider
import numpy as np
import pytest
from hidden.hider import hide
from hidden.test_discovered import LENGTH, OMEGA, SIZE, discovered

from calib.study_file import load
from calib.workflows.found_effect import apply_force

pytestmark = pytest.mark.slow

PLACE, WIDTH = 0.4 * LENGTH, 0.25 * LENGTH  # m, of the magnet
LAWS = {
    "drag": ({"c2": SIZE / (OMEGA * LENGTH) ** 2}, "c1 v |v|", {"c1": -SIZE / (OMEGA * LENGTH) ** 2}),
    "cubic": ({"k3": SIZE / LENGTH**3}, "c1 x^3", {"c1": -SIZE / LENGTH**3}),
    "magnet": (
        {"magnet": SIZE, "magnet_place": PLACE, "magnet_width": WIDTH},
        "c1 (x - a1)/b1 exp(-((x - a1)/b1)^2/2)",
        {"c1": -SIZE, "a1": PLACE, "b1": WIDTH},
    ),
}


@pytest.mark.parametrize("kind", LAWS)
def test_the_formula_is_found_and_applied(kind, cache, tmp_path, monkeypatch):
    acting, text, numbers = LAWS[kind]
    monkeypatch.setattr(hidden.hider, "drawn_remainder", lambda at, share, seed: (kind, acting))
    hide("oscillator", None, None, 0, folder=tmp_path, cache=cache, remainder=0.1)
    study = tmp_path / "study.toml"
    study.write_text(study.read_text().replace('name = "oscillator"', f'name = "oscillator with {kind}"', 1))
    found = discovered(tmp_path)
    best = found.formulas[0]
    assert (best.formula.text, best.ties, best.predicts) == (text, True, True)
    errors = best.errors()
    for number in best.formula.numbers:
        assert abs(number.value - numbers[number.name]) < 4.0 * errors[number.name]
    extended = load(apply_force(load(tmp_path), found))
    [effect] = extended.study.model.effects
    assert effect.equation == text
    x, v = found.states.x[::50], found.states.v[::50]
    p = effect.bound({q.name: q.nominal for q in effect.parameters}).p
    none = np.zeros(4)
    force = [effect.law.function(0.0, *state, p, none, none) for state in zip(x, v, strict=True)]
    assert force == pytest.approx(best.formula.values(x, v), rel=1e-6, abs=1e-9 * SIZE)
