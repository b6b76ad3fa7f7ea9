"""The remainder: a law of physics that makes the wanted share of the motion, and that no effect is."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from hidden.drawn import SHARES
from hidden.flight import Laws, rates
from hidden.four_dof import PLANS, plant
from hidden.four_dof import TRUTH as FOUR_DOF
from hidden.hider import SYSTEMS, bench, hide
from hidden.motion import Refused
from hidden.remainder import EXPRESSED, change, expressed_by, remainder, scaled
from simulators.four_dof_peer import spring_drive

from calib.records import read

ALL = [
    pytest.param(name, kind, marks=[pytest.mark.slow] if name == "delaminated_beam" else [])
    for name, system in SYSTEMS.items()
    for kind in system().remainders
]


@pytest.mark.parametrize(("simulator", "kind"), ALL)
def test_a_remainder_makes_the_wanted_share_of_the_motion(simulator, kind, cache):
    at = bench(simulator, cache)
    values = scaled(at, kind, 0.02, np.random.default_rng(3))
    assert change(at, values) == pytest.approx(0.02, rel=0.05)


@pytest.mark.parametrize("simulator", ["oscillator", "four_dof"])
def test_a_large_remainder_can_be_made_of_every_system(simulator, cache):
    at, rng = bench(simulator, cache), np.random.default_rng(3)
    assert any(change(at, scaled(at, kind, 0.05, rng)) > 0.04 for kind in at.system.remainders[:2])


@pytest.fixture(scope="module")
def oscillator(cache):
    """Bench of the oscillator, whose effects have been compared with something once."""
    return bench("oscillator", cache)


@pytest.mark.parametrize("share", [SHARES[0], *(pytest.param(share, marks=pytest.mark.slow) for share in SHARES[1:])])
def test_what_two_effects_express_is_no_remainder(share, oscillator):
    at = copy(oscillator)
    at.system = replace(at.system, remainders=("quintic",))
    with pytest.raises(Refused, match="cubic_stiffness and [a-z_]+ express 'quintic'"):
        remainder(at, share, seed=8)
    at.system = replace(at.system, remainders=("quintic", "magnet"))
    kind, values = remainder(at, share, seed=8)
    assert kind == "magnet"
    assert set(values) == {"magnet", "magnet_place", "magnet_width"}


def test_how_well_an_effect_imitates_a_remainder_is_known(oscillator):
    at = oscillator
    stiffness = at.imitations(at.hidden("cubic_stiffness", 1e-3), [("cubic_stiffness",), ("channel_offset",)])
    assert stiffness[0] == pytest.approx(1.0, abs=0.02)  # itself
    name, cosine = expressed_by(at, scaled(at, "quintic", 0.005, np.random.default_rng(3)), 1)
    assert name == "cubic_stiffness"
    assert cosine > EXPRESSED
    assert stiffness[1] < 0.5


def test_two_effects_together_imitate_more_than_either(oscillator):
    at = oscillator
    hidden = {**at.hidden("cubic_stiffness", 1e-3), **at.hidden("quadratic_drag", 1e-3)}
    one, other, both, absorbed = at.imitations(
        hidden, [("cubic_stiffness",), ("quadratic_drag",), ("cubic_stiffness", "quadratic_drag"), ("linear_drag",)]
    )
    assert max(one, other) < both == pytest.approx(1.0, abs=0.02)
    assert np.isnan(absorbed)  # damping is calibrated


def test_how_well_more_of_an_effect_imitates_a_remainder_beside_it_is_known(oscillator):
    at = oscillator
    beside, more = (at.hidden("cubic_stiffness", size) for size in (0.3, 0.31))
    assert at.imitated_beside(more, beside) == pytest.approx(1.0, abs=0.01)
    valve = scaled(at, "valve", 0.005, np.random.default_rng(3))
    assert at.imitated_beside(valve, beside) < 0.9
    assert at.imitated_beside(valve, at.hidden("channel_offset", 1e-6)) < at.imitated_beside(valve, beside)


def test_the_coupling_of_two_bodies_pushes_none_of_them_without_the_other():
    mass, at = spring_drive(FOUR_DOF, 1.0)[0], plant(FOUR_DOF, PLANS[0])
    moved = np.array([0.0, -1e-3, 2e-3, 0, 0, 0, 0, 0])
    without, coupled = np.zeros(8), np.zeros(8)
    rates(0.0, moved, np.zeros(4), at, Laws(), without)
    rates(0.0, moved, np.zeros(4), at, Laws(coupling=1e9), coupled)
    force = np.diag(mass) * (coupled - without)[4:]
    assert force[2] < 0.0 < force[1]
    assert force.sum() == pytest.approx(0.0, abs=1e-9 * abs(force).max())


@pytest.mark.slow
def test_the_seed_draws_the_kind_and_the_records_have_it(cache, tmp_path):
    kinds = set()
    for seed in (2, 3):
        hidden = hide("oscillator", None, None, seed, folder=tmp_path / str(seed), cache=cache, remainder=0.05)
        kinds.add(hidden.remainder)
        at = bench("oscillator", cache)
        shares = []
        for plan in at.system.plans:
            clean = at.clean(plan).rows[0]
            apart = read(tmp_path / str(seed) / f"{plan.name}.nc").displacement.values[0] - clean
            shares.append((apart**2).mean() / (clean**2).mean() - 0.01**2)
        assert np.sqrt(np.mean(shares)) == pytest.approx(0.05, rel=0.3)
    assert len(kinds) > 1
    assert kinds <= set(SYSTEMS["oscillator"]().remainders)


@pytest.mark.slow
def test_an_effect_may_be_hidden_at_a_multiple_of_the_remainder(cache, tmp_path):
    asked = {"folder": tmp_path / "study", "cache": cache, "remainder": 0.02}
    hidden = hide("oscillator", "quadratic_drag", 8.0, 3, over_remainder=3.0, **asked)
    at = bench("oscillator", cache)
    assert at.remainder_z(hidden.remainder_values) > 8.0
    assert hidden.z["quadratic_drag"] == pytest.approx(3.0 * at.remainder_z(hidden.remainder_values), rel=0.03)
