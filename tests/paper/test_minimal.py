"""The paper's section 3: its claims, with the default set R1, made by the scripts of studies/paper_minimal."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from benchmarks.repeat_under_rounding import LARGEST, SMALLEST
from benchmarks.repeat_under_rounding import perturbed as changed_by_rounding

from calib.dynamics.motion import kind_of_orbit, perturbed
from calib.dynamics.orbit_kind import CHAOTIC
from calib.dynamics.orbits import shoot
from calib.dynamics.single_run import kind_of_run
from calib.records.cycles import impacts_per_period
from calib.report.plots.bifurcation import bifurcation_diagram
from calib.simulators.impact import assembly
from calib.study_file import load
from calib.sweep import Sweep, run

STUDY = Path(__file__).parents[2] / "studies" / "paper_minimal"


def script(name):
    spec = importlib.util.spec_from_file_location(name, STUDY / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


figure_4, figure_5, figure_6, drives = (script(name) for name in ("figure_4", "figure_5", "figure_6", "drives"))


def motion(restitution, **options):
    return kind_of_orbit(load(STUDY).setting({"restitution": restitution}).map(), **options)


# --- Figure 4: a unique motion near e = 0, then a bifurcation scenario with windows of irregular motion


@pytest.mark.parametrize("e", [0.0, 0.05, 0.10, 0.15, 0.167])
def test_near_zero_restitution_the_motion_is_unique_period_1_with_one_impact(e):
    rng, map = np.random.default_rng(1), load(STUDY).setting({"restitution": e}).map()
    motions = [kind_of_orbit(map, state) for state in (map.initial, *rng.normal(size=(4, 8)) * map.scale)]
    assert {found.label for found in motions} == {"1/1"}
    for found in motions:
        np.testing.assert_allclose(found.state / map.scale, motions[0].state / map.scale, atol=1e-6)
        assert found.exponent == pytest.approx(-0.147, abs=2e-3)


@pytest.fixture(scope="module")
def branches():
    return figure_4.branches()


@pytest.mark.slow
def test_period_1_ends_by_grazing_between_0_168_and_0_170(branches):
    [end] = branches[0].points
    assert end.kind == "grazing"
    assert 0.168 < end.parameter < 0.170
    assert end.parameter == pytest.approx(0.16961, abs=1e-5)
    assert branches[0].stable.all()
    assert branches[0].nearest[-1] < 1e-8  # m: another impact is about to appear
    # no multiplier comes near the unit circle: it is no flip
    assert np.abs(branches[0].multipliers).max() < 0.87


def test_the_period_2_motion_comes_out_of_the_same_grazing(branches):
    start = branches[1].points[0]
    assert start.kind == "grazing"
    assert start.parameter == pytest.approx(branches[0].points[0].parameter, abs=1e-7)
    assert branches[1].slowest.min() < 1e-3  # m/s: its small impact vanishes there
    fold = next(point for point in branches[1].points if point.kind == "fold")
    assert 0.1675 < fold.parameter < start.parameter  # the two overlap over 0.0018


def test_on_the_period_1_branch_the_impact_comes_earlier_and_faster():
    setting, ends = load(STUDY).setting(), []
    for e in (0.0, 0.168):
        map = setting.map({"restitution": e})
        [impact] = shoot(map, kind_of_orbit(map).state).orbit.impacts
        ends.append(impact[1:])
    np.testing.assert_allclose(ends, [[0.3259, 0.3483], [0.2947, 0.4439]], atol=1e-4)  # periods, m/s


def test_period_2_at_0_20_with_three_impacts_a_return():
    assert motion(0.20).label == "3/2"
    assert motion(0.20).exponent == pytest.approx(-0.056, abs=1e-3)


@pytest.mark.parametrize("e", [0.3607, 0.3639])
def test_next_to_its_flip_the_motion_that_settles_for_thousands_of_periods_is_called_period_2(e):
    map = load(STUDY).setting({"restitution": e}).map()
    for start in (map.initial, *perturbed(map, map.initial, 1)):
        assert kind_of_orbit(map, start).label == "3/2"


@pytest.mark.parametrize("e", [0.40, 0.45, 0.50, 0.55])
def test_between_0_37_and_0_57_the_motion_is_irregular(e):
    found = motion(e)
    assert found.kind == CHAOTIC
    assert 0.01 < found.exponent < 0.2
    assert found.zero_one > 0.8


@pytest.mark.parametrize(("e", "label"), [(0.59, "3/2"), (0.62, "3/2"), (0.73, "4/2"), (0.74, "4/2")])
def test_in_its_window_the_stable_motion_gives_the_kind_though_chaos_leads_to_it(e, label):
    map = load(STUDY).setting({"restitution": e}).map()
    for start in (map.initial, *perturbed(map, map.initial, 1)):
        found = kind_of_orbit(map, start)
        assert found.label == label
        assert found.exponent < 0.0


def test_the_windows_are_those_stretches_of_the_branches_that_are_stable(branches):
    flips = [point.parameter for point in branches[1].points if point.kind == "flip"]
    assert flips[-2:] == pytest.approx([0.36520, 0.58066], abs=1e-5)
    assert branches[1].points[-1].kind == "grazing"
    assert branches[1].points[-1].parameter == pytest.approx(0.66385, abs=1e-5)
    inside = (branches[1].parameter > flips[-2] + 1e-4) & (branches[1].parameter < flips[-1] - 1e-4)
    assert not branches[1].stable[inside].any()
    kinds = {point.kind: point.parameter for point in branches[2].points}
    assert kinds["flip"] == pytest.approx(0.71248, abs=1e-5)
    assert kinds["Neimark-Sacker"] == pytest.approx(0.74349, abs=1e-5)


def test_beyond_the_neimark_sacker_point_the_motion_is_quasi_periodic():
    period, state = figure_4.SEEDS[0.73]
    map = load(STUDY).setting({"restitution": 0.75}).map()
    cycle = shoot(map, np.array(state), period)
    assert cycle.converged
    assert not cycle.stable
    found = kind_of_run(map, cycle.state + 1e-3 * map.scale)  # a run from rest may as well come to the chaos beside
    assert found.kind == "quasi-periodic"
    assert abs(found.exponent) < 1e-3


def test_there_is_hysteresis_about_0_66_but_none_below_0_16(tmp_path):
    values = np.array([0.05, 0.10, 0.15, 0.60, 0.63, 0.66, 0.68, 0.70])
    found = figure_4.sweep(tmp_path / "both.nc", values, carry="both")
    both = {e: tuple(found.kind.sel(restitution=e).values) for e in values}
    assert both[0.66] == ("period-2", "chaotic")
    assert all(both[e] == ("period-1", "period-1") for e in (0.05, 0.10, 0.15))
    assert all(both[e][0] == "period-2" for e in (0.60, 0.63))


@pytest.fixture(scope="module")
def windows(tmp_path_factory):
    """Sweep across both windows beside chaos, from rest."""
    values = np.concatenate([np.linspace(0.575, 0.675, 26), np.linspace(0.706, 0.742, 10)])
    return figure_4.sweep(tmp_path_factory.mktemp("windows") / "sweep.nc", values)


def test_both_windows_are_drawn_whole_with_chaos_beside_them(windows):
    e, kind, impacts = windows.restitution.values, windows.kind.values, windows.impacts.values
    first, second = (e > 0.5815) & (e < 0.6635), e > 0.7130
    assert (kind[first] == "period-2").all()
    assert (impacts[first] == 3).all()
    assert (kind[second] == "period-2").all()
    assert (impacts[second] == 4).all()
    assert (kind[~first & ~second & (e > 0.665)] == CHAOTIC).all()
    beside = windows.other_kind.sel(restitution=slice(0.657, 0.6635)).values
    assert (beside == CHAOTIC).any(axis=0).all()  # chaos there outlives 300 000 periods


def test_at_each_value_of_the_windows_the_tool_is_sure(windows):
    inside = (windows.kind == "period-2").values
    assert windows.certain.values[inside].all()


@pytest.mark.slow
def test_rounding_of_starts_and_parameters_does_not_change_the_diagram(tmp_path):
    """Changed by a unit in the last place, and by more, as another processor would; a sample of the benchmark."""
    values, kinds, certain = np.linspace(0.0, 0.8, 101), [], []
    sweep = Sweep(load(STUDY).setting(), {"restitution": values})
    for k, share in enumerate([0.0, *np.geomspace(SMALLEST, LARGEST, 3)]):
        found = run(changed_by_rounding(sweep, share, k), tmp_path / f"{k}.nc", jobs=2)
        kinds.append(list(zip(found.kind.values, found.impacts.values, strict=True)))
        certain.append(found.certain.values)
    differing = [k for k in range(values.size) if len({row[k] for row in kinds}) > 1]
    assert len(differing) <= 2, values[differing]
    for k in differing:
        assert not all(row[k] for row in certain), values[k]


@pytest.mark.slow
def test_rounding_of_the_matrices_does_not_change_the_kinds(monkeypatch):
    """All matrices and vectors that come out of the linear algebra are changed by a unit in the last place."""
    values = [0.05, 0.2, 0.3, 0.45, 0.5, 0.6, 0.72, 0.735]
    untouched = [motion(e).label for e in values]
    regimes = assembly.regimes
    for k in range(4):
        rng = np.random.default_rng(k)

        def rounded(*args, rng=rng):
            made = regimes(*args)
            return made._replace(**{
                name: array * (1.0 + np.finfo(float).eps * rng.choice([-1.0, 0.0, 1.0], array.shape))
                for name, array in made._asdict().items() if isinstance(array, np.ndarray)
            })  # fmt: skip

        monkeypatch.setattr(assembly, "regimes", rounded)
        assert [motion(e).label for e in values] == untouched


@pytest.mark.slow
def test_the_diagram_of_the_figure(tmp_path):
    found = figure_4.sweep(tmp_path / "figure_4.nc", np.linspace(0.0, 0.8, 401))
    e, kind = found.restitution.values, found.kind.values
    assert (kind[e < 0.1675] == "period-1").all()
    assert (kind[(e > 0.1699) & (e < 0.359)] == "period-2").all()
    assert (kind[(e > 0.37) & (e < 0.57)] == CHAOTIC).mean() > 0.9
    assert (kind[(e > 0.582) & (e < 0.6635)] == "period-2").all()
    assert (kind[(e > 0.713) & (e < 0.743)] == "period-2").all()
    # the section has as many points as the motion has periods
    q3 = found.displacement.sel(body="q3").transpose("restitution", "cycle").values
    points = [np.unique(np.round(row * 1e7)).size for row in q3]
    assert max(points[k] for k in np.flatnonzero(e < 0.1675)) <= 2  # one, on the edge of a bin at most
    assert min(points[k] for k in np.flatnonzero((e > 0.38) & (e < 0.56))) > 20
    figure = bifurcation_diagram(found, ["q2", "q3"])
    assert [axes.get_ylabel() for axes in figure.axes[:2]] == ["q2\ndisplacement [mm]", "q3\ndisplacement [mm]"]


# --- Figure 5: phase portraits


def test_at_0_05_the_layer_has_one_loop_with_one_vertical_jump():
    record = figure_5.portrait(0.05)
    assert impacts_per_period(record) == pytest.approx(1.0)
    before, after = jump(record)
    assert (before, after) == pytest.approx((-0.78, -0.39), abs=0.01)  # m/s
    assert np.ptp(section(record)) < 1e-9


def test_at_0_20_the_layer_has_two_loops_with_three_jumps():
    record = figure_5.portrait(0.20)
    assert impacts_per_period(record) == pytest.approx(1.5)
    speeds = np.sort(record.impact_speed.values[:3])
    assert speeds[0] < 0.4 * speeds[1]  # two jumps and a small one
    assert np.unique(np.round(section(record) * 1e8)).size == 2


def test_at_0_50_the_layer_has_a_bundle_of_loops():
    record = figure_5.portrait(0.50)
    assert np.unique(np.round(section(record) * 1e6)).size > 100
    assert figure_5.kind(0.50).kind == CHAOTIC


def test_the_beam_has_no_jump():
    velocity = figure_5.portrait(0.05).velocity.sel(body="q2").values
    assert np.abs(np.diff(velocity)).max() < 0.01 * np.ptp(velocity)


def section(record):
    return record.section_displacement.sel(body="q3").values


def jump(record):
    """Velocity of the layer before and after its impact."""
    velocity = record.velocity.sel(body="q3").values[:750]
    at = int(np.argmax(np.abs(np.diff(velocity))))
    return velocity[at], velocity[at + 1]


# --- Figure 6: the band that a fixed step makes


@pytest.mark.slow
def test_the_band_of_the_fixed_step_is_of_first_order_and_gone_when_impacts_are_located():
    widths = [figure_6.spread(figure_6.motion(mode="fixed_step", steps_per_period=n)) for n in figure_6.STEPS]
    order = np.polyfit(np.log(1.0 / np.array(figure_6.STEPS)), np.log(widths), 1)[0]
    assert order == pytest.approx(1.0, abs=0.03)
    assert widths[1] == pytest.approx(0.058e-3, rel=0.1)  # m, at T/250
    back = figure_6.spread(figure_6.motion(mode="fixed_step", steps_per_period=250.37, onto_surface=True))
    assert back == pytest.approx(widths[1] / 3.0, rel=0.1)
    assert figure_6.spread(figure_6.motion()) < 1e-14
    assert figure_6.spread(figure_6.motion(mode="fixed_step", steps_per_period=250.0)) < 1e-12  # locked to the grid


# --- what the text leaves open


@pytest.mark.slow
def test_other_drives_give_other_diagrams():
    """The paper does not say how its model is driven; where the period-1 motion ends depends on it."""
    labels = {
        drive: [kind_of_orbit(drives.setting(drive).map({"restitution": e})).label for e in (0.02, 0.10, 0.16, 0.50)]
        for drive in drives.DRIVES
    }
    assert labels["spring"] == ["1/1", "1/1", "1/1", CHAOTIC]
    assert labels["rigid"][:3] == ["1/1", "1/1", "5/4"]
    assert labels["symmetric"][:2] == ["1/1", "3/2"]
    assert labels["centre"][:2] == ["1/1", "3/2"]
    assert labels["symmetric"][3] == labels["centre"][3] != CHAOTIC
    assert labels["force"][0] != "1/1"


def test_the_drives_agree_in_the_linear_motion():
    for drive in ("spring", "rigid", "force"):
        held = drives.setting(drive)
        record = held.model.run({"gap": 1.0}, held.excitation)
        assert record.displacement.sel(body="q1").max() == pytest.approx(1.5e-3, rel=2e-3)
