"""The hider: its motions are the simulators', its effects are the effects, its noise is the stated one."""

import pkgutil
from dataclasses import replace

import numpy as np
import pytest
from hidden.causes import CAUSES, natural
from hidden.hider import SYSTEMS, bench, hide
from hidden.motion import Refused
from hidden.noise import coloured

import calib.effects
from calib.modelling.model import Model
from calib.modelling.simulator import Request
from calib.plugins import load as named
from calib.records import read
from calib.records.excitation import Excitation
from calib.study_file import load

CASES = [("four_dof", {}), ("oscillator", {}), ("oscillator", {"transient": "decay"}), ("oscillator", {"stop": True})]
CHANGE = 200.0  # length of what an effect changes, in the noise
CLOSE = {
    "coulomb_friction": 1e-2, "squeeze_film": 0.2,  # laws that turn about within a step of the simulators
    "velocity_lowpass": 0.1,  # linear between samples
}  # fmt: skip
HERE = {"air_drag_quadratic": "quadratic_drag", "velocity_lag": "channel_lag"}  # names that differ here
QUICK = [
    ("quadratic_drag", "four_dof", {}),
    ("gap_offset", "four_dof", {}),
    ("channel_lag", "oscillator", {}),
]


def simulated(at, plan, effects=(), hidden=(), samples=None):
    """What calib's own simulator makes of a plan, and its rows (2 b, n)."""
    system = at.system
    model = Model(named("calib.simulators", system.name)(**system.options), effects)
    values = {**system.truth, **dict(hidden)}
    times, quantity = system.times(plan), system.quantity
    if plan.kind == "harmonic":
        excitation = Excitation(system.place, quantity, frequency=plan.frequency, amplitude=plan.amplitude)
        request = Request(periods=system.periods, samples=system.samples)
    elif plan.kind == "decay":
        values["initial_displacement"] = plan.amplitude
        excitation, request = Excitation("mass", "free decay"), Request(times=times)
    else:
        tones = system.plant({**system.truth, "amplitude": 1.0}, plan).tones
        force = (tones[:, :1] * np.cos(tones[:, 1:2] * times + tones[:, 2:])).sum(axis=0)
        excitation, request = Excitation("mass", quantity, time=times, value=force), Request(times=times)
    record = model.run(values, excitation, request).sel(body=list(system.measured))
    assert record.attrs["status"] == "ok"
    return record, np.concatenate([record.displacement.values, record.velocity.values])


@pytest.mark.slow
def test_no_effect_is_hidden_beyond_what_the_library_says_there_can_be(cache):
    for name, cause in CAUSES.items():
        own = {p.name: p for p in named("calib.effects", HERE.get(name, name)).parameters}
        assert all(own[grown].high >= cause.most for grown in cause.grows if name != "outliers")
    assert sum(bool(cause.grows) for cause in CAUSES.values()) > 20
    with pytest.raises(Refused, match="more than there can be"):
        bench("oscillator", cache, noise=1e-4).size_for("velocity_differencing", 1e5)


def apart(one, other):
    """Largest difference of rows, relative to the amplitude of each."""
    return (np.abs(one - other).max(axis=1) / np.abs(other).max(axis=1)).max()


@pytest.mark.parametrize(("simulator", "options"), CASES)
def test_with_nothing_hidden_the_motions_are_those_of_the_simulator(simulator, options, cache):
    at = bench(simulator, cache, **options)
    for plan in at.system.plans:
        clean = at.clean(plan)
        record, rows = simulated(at, plan)
        assert apart(clean.rows, rows) < 1e-6
        in_a_period = record.impact_time.values < (1.0 / plan.frequency if plan.frequency else np.inf)
        assert record.impact_time.values[in_a_period] == pytest.approx(clean.impacts, abs=1e-6)


def modest(at, effect):
    """Size at which an effect changes the records by some hundred times their noise over all samples, or less."""
    if not CAUSES[effect].derived:
        return CAUSES[effect].step * natural(at.system, effect)
    size = min(CHANGE / np.linalg.norm(at.derivative(effect)), CAUSES[effect].most)
    while True:
        try:
            at.z_of(effect, size)
        except Refused:
            size *= 0.5
        else:
            return size


def pairs():
    """Each effect of calib with each system that can hide it; of an oscillator, instruments with the first alone.

    What an instrument does to a motion that starts, and to one with impacts, the oscillator and four_dof show.
    """
    for module in pkgutil.iter_modules(calib.effects.__path__):
        name = HERE.get(module.name, module.name)
        instrument = named("calib.effects", f"calib.effects.{module.name}:EFFECT").site == "sensor"
        for simulator, options in CASES:
            if name in hideable(simulator, options) and not (instrument and options):
                quick = (name, simulator, options) in QUICK
                yield pytest.param(module.name, name, simulator, options, marks=() if quick else pytest.mark.slow)


def hideable(simulator, options):
    return set(SYSTEMS[simulator](**options).hideable) - {"outliers"}


@pytest.mark.parametrize(("module", "name", "simulator", "options"), list(pairs()))
def test_a_hidden_effect_is_the_effect_of_that_name(module, name, simulator, options, cache):
    """Away from impacts, and as closely as effects of instruments interpolate between samples; the hider does not."""
    effect = named("calib.effects", f"calib.effects.{module}:EFFECT")
    at = bench(simulator, cache, **options)
    hidden = at.hidden(name, modest(at, name))
    bodies = ("q3",) if simulator == "four_dof" and getattr(effect, "place", "body") == "body" else None
    effect = replace(effect, bodies=bodies) if effect.site == "force" and bodies else effect
    close = CLOSE.get(name, 0.05 if effect.site == "sensor" else 1e-3)
    for plan in at.plans:
        transient = getattr(effect, "transient", False)
        if transient and plan.kind == "harmonic":
            continue
        before, after = at.clean(plan), at.clean(plan, hidden)
        _, rows = simulated(at, plan, (effect,), hidden)
        turns, far = at.system.times(plan), np.ones(rows.shape[1], dtype=bool)
        if plan.kind != "harmonic":  # what a late channel shows of the time before a record is anybody's guess
            far = turns > hidden.get("lag", 0.0) + turns[1]
        for impact in (*before.impacts, *after.impacts):
            distance = turns - impact
            if plan.frequency:
                distance = (distance * plan.frequency + 0.5) % 1.0 / plan.frequency - 0.5 / plan.frequency
            far &= np.abs(distance) > 4.0 * turns[1]
        changed, differs, size = (
            np.abs(rows)[:, far].max(axis=1) for rows in (after.rows - before.rows, after.rows - rows, before.rows)
        )
        assert (differs <= close * changed + 1e-6 * size).all(), (plan.name, differs / size, changed / size)


@pytest.mark.parametrize("effect", ["coulomb_friction", "channel_offset", "drive_harmonic_3"])
def test_a_larger_effect_is_seen_in_proportion_where_the_records_are_linear_in_it(cache, effect):
    at = bench("oscillator", cache)
    size = at.size_for(effect, 10.0)
    assert at.z_of(effect, size) == pytest.approx(10.0, rel=0.02)
    assert at.z_of(effect, 2.0 * size) == pytest.approx(2.0 * at.z_of(effect, size), rel=0.02)
    assert at.linear_z_of(effect, size) == pytest.approx(10.0, rel=0.03)


def test_z_falls_with_the_noise(cache):
    z = [bench("oscillator", cache, noise=noise).linear_z_of("softening", 100.0) for noise in (0.01, 0.02)]
    assert z[0] == pytest.approx(2.0 * z[1])


@pytest.mark.parametrize("effect", ["linear_drag", "added_mass", "plot_scale"])
def test_what_calibration_absorbs_is_refused(cache, effect):
    with pytest.raises(Refused, match="beyond calibration"):
        bench("oscillator", cache).size_for(effect, 8.0)


def test_what_calibration_does_not_search_is_not_absorbed(cache):
    assert bench("oscillator", cache, calibrated=("stiffness",)).size_for("linear_drag", 8.0) > 0.0


def test_what_nobody_would_overlook_is_refused(cache):
    with pytest.raises(Refused, match="changes record"):
        bench("oscillator", cache).size_for("preload", 1e4)


def test_an_effect_imitates_itself_and_is_told_from_another(cache):
    table = bench("oscillator", cache).cosines(("channel_offset", "drive_harmonic_3", "linear_drag"))
    assert np.diag(table)[:2] == pytest.approx(1.0)
    assert abs(table[0, 1]) < 0.05
    assert np.isnan(table[2]).all()


@pytest.mark.parametrize("phi", [0.0, 0.8])
def test_noise_has_the_stated_size_and_correlation(phi, cache, tmp_path):
    study = hide("oscillator", None, None, 3, 0.02, phi, folder=tmp_path, cache=cache, stated=True)
    at = bench("oscillator", cache)
    for plan in at.system.plans:
        record = read(study.folder / f"{plan.name}.nc")
        for channel, clean in zip(("displacement", "velocity"), at.clean(plan).rows, strict=True):
            noise = record[channel].values[0] - clean
            sigma = 0.02 * np.sqrt((clean**2).mean())
            assert record[f"{channel}_sigma"].values[0] == pytest.approx(sigma)
            width = np.sqrt((1.0 + phi) / (1.0 - phi) / noise.size)  # of the variance's relative error, about
            assert noise.var() == pytest.approx(sigma**2, rel=6.0 * width)
            assert np.corrcoef(noise[1:], noise[:-1])[0, 1] == pytest.approx(phi, abs=0.1)


def test_correlated_noise_is_stationary_from_its_first_sample():
    rows = coloured(np.random.default_rng(1), (20_000, 5), np.array([0.9]))
    assert rows.var(axis=0) == pytest.approx(1.0, rel=0.05)


def test_a_seed_gives_the_same_files_and_another_one_other_noise(cache, tmp_path):
    folders = [tmp_path / name for name in "abc"]
    for folder, seed in zip(folders, (5, 5, 6), strict=True):
        hide("oscillator", "softening", 8.0, seed, folder=folder, cache=cache)
    first, same, other = (read(folder / "loud.nc") for folder in folders)
    assert first.identical(same)
    assert not (first.displacement == other.displacement).any()


@pytest.mark.parametrize(
    ("simulator", "options"), [*CASES[:2], *(pytest.param(*case, marks=pytest.mark.slow) for case in CASES[2:])]
)
def test_the_study_can_be_read_and_tells_nothing_of_what_is_hidden(simulator, options, cache, tmp_path):
    effect = ("quadratic_stiffness", "channel_gain")
    study = hide(simulator, effect, 8.0, 1, folder=tmp_path, cache=cache, nuisance=("trigger",), **options)
    file = load(study.folder)
    assert file.study.model.effects == ()
    assert {r.use for r in file.others.values()} == {"name", "holdout"}
    text = (study.folder / "study.toml").read_text()
    told = [read(path).attrs for path in study.folder.glob("*.nc")]
    assert len(told) == len(file.study.objective.references) + len(file.others) > 2
    for name in (*effect, *study.values):
        assert name not in text
        assert not any(name in str(attrs) for attrs in told)


def test_a_study_whose_model_steps_coarsely_is_a_time_step_to_be_found(cache, tmp_path):
    study = hide("four_dof", None, None, 1, folder=tmp_path, cache=cache, steps=60.37)
    assert load(study.folder).study.model.simulator.mode == "fixed_step"


def test_outliers_are_as_many_as_asked_for(cache, tmp_path):
    study = hide("oscillator", "outliers", None, 1, folder=tmp_path, cache=cache, size=0.01)
    at = bench("oscillator", cache)
    far = [
        np.abs(read(study.folder / f"{plan.name}.nc").displacement.values[0] - at.clean(plan).rows[0])
        > 0.1 * np.sqrt((at.clean(plan).rows[0] ** 2).mean())
        for plan in at.plans
    ]
    assert np.concatenate(far).mean() == pytest.approx(0.01, abs=0.005)


@pytest.mark.parametrize(("simulator", "options"), CASES)
def test_every_effect_of_a_system_is_a_known_cause(simulator, options, cache):
    effects = set(bench(simulator, cache, **options).system.hideable)
    assert effects
    assert effects - set(CAUSES) == set()
