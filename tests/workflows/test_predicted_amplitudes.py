"""Bands of frequency responses: a linear oscillator whose response is known in closed form."""

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner
from undrawn import undrawn

from calib.cli import main
from calib.confidence import posterior
from calib.confidence.artifacts import read_confidence
from calib.confidence.bands import read_bands
from calib.features.frequency_response import ResponseDistance
from calib.objective import Objective, Reference, Term
from calib.records import write
from calib.records.excitation import Excitation
from calib.records.held_response import at_one_level
from calib.records.response import make_response, tolerances
from calib.workflows import predictive
from calib.workflows.confidence import confidence_study
from calib.workflows.evaluations import Case
from calib.workflows.predicted_amplitudes import AMPLITUDE, noise_of_amplitudes, read_amplitudes

FORCE = Excitation("mass", "force", frequency=3.0, amplitude=0.2)
SIGMA = 1e-3  # of either part, over the largest amplitude  [1]
STIFFNESS, DAMPING = 400.0, 1.0  # of a unit mass  [N/m], [N s/m]


def compliance(frequency):
    omega = 2.0 * np.pi * frequency
    return 1.0 / (STIFFNESS - omega**2 + 1j * DAMPING * omega)


def response(level=0.2, seed=0, points=61, sigma=20.0 * SIGMA, stated=True, **attrs):
    """A measured sweep, with noise of `sigma` of the largest amplitude in either part."""
    frequency, rng = np.linspace(2.8, 3.6, points), np.random.default_rng(seed)
    noise = sigma * level / (DAMPING * np.sqrt(STIFFNESS))
    kicks = noise * (rng.standard_normal(points) + 1j * rng.standard_normal(points))
    amplitude = (level * compliance(frequency) + kicks)[None]
    known = np.full((1, points), noise) if stated else None
    if attrs.get("phases") == "unknown":
        amplitude = np.abs(amplitude)
    return make_response(
        frequency, ["mass"], amplitude, level, "N", sigma=known, place="mass", quantity="force", **attrs
    )


def simulated(level=0.2, until=3.7):
    """The noiseless sweep, as a continuation has it, up to a frequency."""
    frequency = np.linspace(2.7, until, 200)
    record = make_response(frequency, ["mass"], level * compliance(frequency)[None], level, "N")
    return record.assign(piece=("point", np.zeros(200)))


def objective(record):
    return Objective({"sweep": Reference("sweep", record, excitation=FORCE)}, [Term(ResponseDistance())])


def noise_of(record):
    [(row, noise)] = noise_of_amplitudes(objective(record), "sweep", simulated()).items()
    assert row == ("mass", AMPLITUDE)
    return noise, noise.sigma * noise.profile * np.ones(record.sizes["point"])


@pytest.mark.parametrize("attrs", [{}, {"phases": "unknown"}])
def test_a_stated_uncertainty_is_the_noise_of_the_amplitude(attrs):
    record = response(**attrs)
    noise, level = noise_of(record)
    assert noise.source == "stated in the record"
    assert level == pytest.approx(record.response_sigma.values[0])


def test_a_stated_uncertainty_of_the_frequency_counts_where_the_curve_is_steep():
    record = response()
    _, without = noise_of(record)
    _, level = noise_of(record.assign(frequency_sigma=("point", np.full(61, 0.003), {"units": "Hz"})))
    top = int(np.argmax(np.abs(compliance(record.frequency.values))))
    assert level[top] < 1.1 * without[top]
    slope = np.gradient(np.abs(0.2 * compliance(record.frequency.values)), record.frequency.values)
    assert level == pytest.approx(np.hypot(without, 0.003 * slope), rel=0.1)


def test_where_nothing_is_stated_the_noise_is_what_the_points_scatter_by():
    noise, level = noise_of(response(stated=False, points=201))
    assert noise.source == "the residual"
    flat = np.abs(np.linspace(2.8, 3.6, 201) - 3.2) > 0.3
    assert level[flat].mean() == pytest.approx(20.0 * SIGMA * 0.2 / 20.0, rel=0.3)


@pytest.mark.parametrize("stated", [True, False])
def test_few_points_have_the_uncertainty_that_the_comparison_has(stated):
    record = response(points=12, stated=stated)
    noise, level = noise_of(record)
    assert noise.source == ("stated in the record" if stated else "2% of the rms amplitude")
    assert (level >= tolerances(record)[1][0] * (1.0 - 1e-12)).all()


def test_what_no_stable_motion_reaches_is_not_read():
    read = read_amplitudes(simulated(until=3.3), response(sigma=0.0))
    frequency = response().frequency.values
    assert np.array_equal(np.isnan(read[0]), frequency > 3.3)
    there = frequency <= 3.3
    assert read[0, there] == pytest.approx(0.2 * np.abs(compliance(frequency[there])), rel=1e-3)


def test_a_response_at_a_held_amplitude_is_read_at_its_level():
    record = at_one_level(response(level=np.linspace(0.1, 0.2, 61), sigma=0.0, stated=False), "mass")
    level = float(record.level.values[0])
    read = read_amplitudes(simulated(level), record)
    assert read[0] == pytest.approx(np.abs(record.in_phase.values + 1j * record.quadrature.values)[0], rel=1e-3)


def test_points_that_few_draws_reach_have_no_band_and_are_counted():
    own = objective(response())
    one = predictive._Compared("sweep", Case(False), own, noise_of_amplitudes(own, "sweep", simulated()), None, "")
    ends = [3.7] * 10 + [3.3] * 20
    pieces = [one._piece_of_response(simulated(until=end)) for end in ends]
    result = predictive._predicted(one, pieces).result
    beyond = int((response().frequency.values > 3.3).sum())
    assert (result.failed, result.points_without_band) == (0, beyond)
    assert result.unreached == pytest.approx(beyond / 61 * 20 / 30)
    assert result.channels[0].samples == 61 - beyond
    assert 0.85 <= result.channels[0].inside <= 1.0


STUDY = """
[study]
name = "swept"
seed = 1
budget = 20
jobs = 1

[[record]]
name = "response"
path = "response.nc"

[[record]]
name = "louder"
path = "louder.nc"
use = "holdout"

[model]
simulator = "oscillator"
fixed = { mass = "1 kg" }

[windows]
stiffness = { low = "390 N/m", high = "410 N/m" }
damping = { low = 0.8, high = 1.2 }

[[term]]
feature = "frequency_response"

[optimiser]
name = "multistart"
"""
DRAWS = 30
FEW = {"MIN_LIVE_POINTS": 50, "LIVE_POINTS_PER_PARAMETER": 25, "EFFECTIVE_SIZE": 100.0, "NETWORKS": 0}


@pytest.mark.slow
@undrawn()
def test_a_posterior_predicts_the_responses_that_the_model_made(tmp_path, monkeypatch):
    for name, value in FEW.items():
        monkeypatch.setattr(posterior, name, value)
    monkeypatch.setattr(predictive, "PREDICTIVE_DRAWS", DRAWS)
    (tmp_path / "study.toml").write_text(STUDY)
    write(response(), tmp_path / "response.nc")
    write(response(level=0.4, seed=7, phases="unknown"), tmp_path / "louder.nc")
    run = CliRunner().invoke(main, ["run", str(tmp_path), "-q"])
    assert run.exit_code == 0, run.output

    def stop(done, foreseen):
        if foreseen - done == DRAWS:  # half of the predictions
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        confidence_study(tmp_path, only_posterior=True, on_progress=stop)
    kept = len(list((tmp_path / "out").glob(".predictive.nc-pieces/*/*.npz")))
    assert DRAWS <= kept < 2 * DRAWS
    simulations = []
    monkeypatch.setattr(predictive._Compared, "_piece_of_response", counted(simulations))
    confidence_study(tmp_path, only_posterior=True)
    assert len(simulations) == 2 * DRAWS - kept  # none was made twice
    interrupted, bands = read_confidence(tmp_path / "out").posterior, read_bands(tmp_path / "out")
    assert [(one.name, one.held_out, one.draws, one.failed, one.reason) for one in interrupted.predicted] == [
        ("response", False, DRAWS, 0, ""), ("louder", True, DRAWS, 0, "")
    ]  # fmt: skip
    for one in interrupted.predicted:
        [channel] = one.channels
        assert (channel.body, channel.channel, channel.unit, channel.samples) == ("mass", "amplitude", "m", 61)
        assert 0.85 <= channel.inside <= 1.0
        assert (one.unreached, one.points_without_band) == (0.0, 0)
        own = bands[one.name]
        of_curve, with_noise = (np.ptp(own[name].values[[0, -1], 0], axis=0) for name in ("curve", "sample"))
        assert (of_curve < with_noise).all()
    drawn = xr.load_dataset(tmp_path / "out" / "posterior.nc", group="predictions")
    assert drawn["louder.amplitude"].dims == ("chain", "draw", "louder.amplitude.body", "louder.point")


def counted(simulations):
    """Note each response that a piece is made of."""
    made = predictive._Compared._piece_of_response

    def noted(self, record):
        simulations.append(record)
        return made(self, record)

    return noted
