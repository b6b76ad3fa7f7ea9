"""`calib confidence` on a small study, files and all."""

import json
import math
import random
import re
import shutil
import signal
import subprocess
import sys
import time

import pytest
import xarray as xr
from child_environment import environment
from click.testing import CliRunner
from echo_study import NOISE, TRUTH, bench, write_study
from kills import KILLS
from undrawn import undrawn

from calib import records
from calib.cli import main
from calib.confidence import posterior
from calib.confidence.artifacts import read_confidence
from calib.confidence.bands import read_bands
from calib.confidence.document import ConfidenceResult, EndResult, ProfileResult
from calib.confidence.prior import Prior
from calib.errors import CalibError
from calib.study_file import load
from calib.workflows import predictive
from calib.workflows.confidence import confidence_study
from calib.workflows.profiled import Profiled
from calib.workflows.study import Calibration


def calib(*arguments, code=0):
    ended = CliRunner().invoke(main, [str(a) for a in arguments])
    assert ended.exit_code == code, ended.output
    return ended


@pytest.fixture(scope="module")
@undrawn()
def calibrated(tmp_path_factory):
    """Folder of a calibrated study."""
    path = write_study(tmp_path_factory.mktemp("echo"))
    calib("run", path, "-q")
    return path.parent


@pytest.fixture(scope="module")
def profiled(calibrated, tmp_path_factory):
    """The same after `calib confidence`, and what that printed."""
    folder = tmp_path_factory.mktemp("profiled") / "echo"
    shutil.copytree(calibrated, folder)
    return folder, calib("confidence", folder, "--pairs", "gain,harmonic").output


FEW = {"MIN_LIVE_POINTS": 50, "LIVE_POINTS_PER_PARAMETER": 25, "EFFECTIVE_SIZE": 200.0, "NETWORKS": 0}
FEW_DRAWS = 25  # that are simulated


@pytest.fixture
def few_live_points(monkeypatch):
    """A sampler that needs few evaluations, and few predictions of its draws."""
    for name, value in FEW.items():
        monkeypatch.setattr(posterior, name, value)
    monkeypatch.setattr(predictive, "PREDICTIVE_DRAWS", FEW_DRAWS)


def numbers(result):
    """What does not depend on when a result was made."""
    return {**result.as_dict(), "seconds": 0.0}


def test_intervals_hold_the_truth_and_agree_with_the_local_ones(profiled):
    folder, output = profiled
    result = read_confidence(folder / "out")
    for profile in result.profiles:
        assert profile.low.value < TRUTH[profile.name] < profile.high.value
        width = profile.high.value - profile.low.value
        assert (profile.low.value, profile.high.value) == pytest.approx(profile.local, abs=0.01 * width)
    assert "95.4% intervals of echo" in output
    assert "gain: as the local interval" in output
    assert "0.198" in output  # mm
    assert f"{result.evaluations} evaluations\nthis run took {result.seconds:.1f} s" in output
    assert "confidence.json, confidence.png" in output


def test_files_are_left(profiled):
    folder, _ = profiled
    assert (folder / "out" / "confidence.png").read_bytes().startswith(b"\x89PNG")
    document = json.loads((folder / "out" / "confidence.json").read_text())
    result = ConfidenceResult.from_dict(document)
    assert result.as_dict() == document
    [pair] = result.pairs
    assert pair.names == ("gain", "harmonic")
    assert (len(pair.first), len(pair.second), len(pair.ratio), len(pair.ratio[0])) == (9, 9, 9, 9)
    assert pair.ratio[4][4] == 0.0


def test_python_says_what_the_command_says(profiled):
    folder, _ = profiled
    found = Calibration(folder / "study.toml").confidence(pairs="all", quiet=True)
    assert isinstance(found, Profiled)
    assert numbers(found.summary) == numbers(read_confidence(folder / "out"))
    assert found.intervals["gain"][0] < TRUTH["gain"] < found.intervals["gain"][1]
    assert repr(found).startswith("95.4% intervals of 'echo'")
    assert "data:image/png;base64," in found._repr_html_()


def test_json_is_the_document(profiled):
    folder, _ = profiled
    answer = calib("confidence", folder, "--pairs", "all", "--json")
    assert numbers(ConfidenceResult.from_dict(json.loads(answer.stdout))) == numbers(read_confidence(folder / "out"))


@pytest.mark.slow
def test_a_killed_run_ends_in_the_same_numbers(calibrated, profiled, tmp_path):
    folder = tmp_path / "echo"
    shutil.copytree(calibrated, folder)
    notes = folder / "out" / "confidence.jsonl"
    arguments = ["confidence", str(folder), "--pairs", "gain,harmonic", "-q"]
    process = subprocess.Popen(
        [sys.executable, "-c", "from calib.cli import main; main()", *arguments],
        env=environment(), stderr=subprocess.DEVNULL,
    )  # fmt: skip
    while not notes.exists() or notes.read_bytes().count(b"\n") < 12:
        assert process.poll() is None, "the run ended before it was killed"
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    kept = notes.read_bytes().count(b"\n")
    calib(*arguments)
    assert 12 <= kept < notes.read_bytes().count(b"\n")
    assert numbers(read_confidence(folder / "out")) == numbers(read_confidence(profiled[0] / "out"))


def test_fresh_forgets_the_points(profiled, tmp_path):
    folder = tmp_path / "echo"
    shutil.copytree(profiled[0], folder)
    notes = folder / "out" / "confidence.jsonl"
    before = notes.read_bytes()
    told = []
    confidence_study(folder, fresh=True, on_progress=lambda done, foreseen: told.append((done, foreseen)))
    assert told[0][0] == 0
    assert told[-1][0] == told[-1][1]
    assert len(notes.read_bytes()) < len(before)  # no pair


def test_a_pair_is_one_in_whatever_order(profiled, tmp_path):
    folder = tmp_path / "echo"
    shutil.copytree(profiled[0], folder)
    before = (folder / "out" / "confidence.jsonl").read_bytes()
    confidence_study(folder, pairs=[("harmonic", "gain"), ("gain", "harmonic")])
    assert (folder / "out" / "confidence.jsonl").read_bytes() == before
    [pair] = read_confidence(folder / "out").pairs
    assert pair.names == ("gain", "harmonic")


def test_ctrl_c_says_how_to_go_on(profiled, monkeypatch):
    def stopped(*given, **more):
        raise KeyboardInterrupt

    monkeypatch.setattr("calib.cli.confidence.confidence_study", stopped)
    folder, _ = profiled
    answer = calib("confidence", folder, "--posterior", "--pairs", "gain,harmonic", "--fresh", code=3)
    again = f"calib confidence {folder} --posterior --pairs gain,harmonic"
    assert answer.stderr.strip().splitlines() == [f"stopped; every finished point is kept. Go on with:  {again}"]


def test_an_open_end_is_called_open():
    ends = EndResult(0.5, "window end", "open"), EndResult(0.9, "crossed", "0.9")
    own = ProfileResult("gain", "1", "linear", 0.8, *ends, None, 4.0, None, "no local interval", ())
    profiled = Profiled(ConfidenceResult("echo", 0.954, "", {}, {}, None, (own,)))
    assert "gain = 0.8: open .. 0.9" in repr(profiled)


def test_points_belong_to_the_calibrated_values(profiled, tmp_path):
    folder = tmp_path / "echo"
    shutil.copytree(profiled[0], folder)
    path = folder / "out" / "result.json"
    document = json.loads(path.read_text())
    document["values"]["gain"] *= 1.0001
    path.write_text(json.dumps(document))
    told = []
    confidence_study(folder, on_progress=lambda done, foreseen: told.append(done))
    assert told[0] == 0


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("gain", "--pairs: expected two parameters, such as A,B, or all, got 'gain'"),
        ("gain,harmonics", "no parameter 'harmonics' is searched (did you mean 'harmonic'?)"),
        ("gain,gain", "expected two different parameters, got 'gain' twice"),
    ],
)
def test_wrong_pairs_are_refused(calibrated, given, message):
    assert message in calib("confidence", calibrated, "--pairs", given, code=1).output


def test_a_study_that_was_not_calibrated_is_refused(tmp_path):
    write_study(tmp_path)
    assert "calibrate first, with `calib run" in calib("confidence", tmp_path, code=1).output


def test_a_damaged_file_of_profiles_is_named(tmp_path):
    assert read_confidence(tmp_path) is None
    (tmp_path / "confidence.json").write_text('{"name": "echo"}')
    with pytest.raises(CalibError, match="holds no profiles .*ConfidenceResult has no level"):
        read_confidence(tmp_path)


# --- the posterior distribution


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:\\s*ArviZ is undergoing a major refactor:FutureWarning")
def test_the_posterior_distribution_is_sampled_and_goes_on_where_it_was_stopped(profiled, tmp_path, few_live_points):
    folder = tmp_path / "echo"
    shutil.copytree(profiled[0], folder)

    def stop(done, foreseen):
        if (folder / "out" / "confidence.jsonl").read_bytes().count(b'"evaluation/') >= 250:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        confidence_study(folder, posterior=True, on_progress=stop)
    output = calib("confidence", folder, "--posterior").output
    assert "log evidence over the likelihood of the best point: -1" in output
    assert "priors: gain flat in the window on its logarithmic scale; harmonic flat in the window" in output
    result = read_confidence(folder / "out")
    evaluated = (folder / "out" / "confidence.jsonl").read_bytes().count(b'"evaluation/')
    assert evaluated == result.posterior.evaluations  # none was made twice
    for profile, marginal in zip(result.profiles, result.posterior.parameters, strict=True):
        deviation = (profile.local[1] - profile.local[0]) / 4.0
        assert marginal.mean == pytest.approx(profile.value, abs=0.2 * deviation)
        assert marginal.standard_deviation == pytest.approx(deviation, rel=0.2)
    volume = result.posterior.parameters[0].standard_deviation / (1.2 * math.log(4.0))
    volume *= 2.0 * math.pi * result.posterior.parameters[1].standard_deviation / 2e-3
    assert result.posterior.log_evidence == pytest.approx(math.log(volume), abs=0.4)

    import arviz  # here: it warns when it is imported

    data = arviz.from_netcdf(folder / "out" / "posterior.nc")
    assert {"posterior", "sample_stats"} <= set(data.groups())
    assert data.posterior["gain"].dims == ("chain", "draw")
    assert data.posterior["harmonic"].attrs["units"] == "m"
    assert float(data.posterior["gain"].mean()) == pytest.approx(result.posterior.parameters[0].mean)
    assert data.sample_stats["log_likelihood"].shape == data.posterior["gain"].shape
    rows = (folder / "out" / "ensemble.csv").read_text().splitlines()
    assert rows[0] == "gain [1],harmonic [m]"
    assert len(rows) == 21
    assert (folder / "out" / "posterior.png").read_bytes().startswith(b"\x89PNG")
    output = calib("confidence", folder, "--pairs", "all").output
    assert "posterior.nc" in output
    assert "damaged" not in output
    assert read_confidence(folder / "out").posterior == result.posterior
    sample = (folder / "out" / "posterior.nc").read_bytes()
    (folder / "out" / "posterior.nc").write_bytes(sample[: len(sample) // 2])
    output = calib("confidence", folder).output
    assert re.search(
        r"mind: .*posterior\.nc is damaged: sample the posterior distribution again, with --posterior", output
    )
    assert "confidence.png, report.html, posterior.png" in output
    (folder / "study.toml").write_text((folder / "study.toml").read_text() + PRIORS)
    calib("confidence", folder)
    assert read_confidence(folder / "out").posterior is None
    for name in ("posterior.nc", "posterior.png", "predictive.nc", "predictive.png", "ensemble.csv"):
        assert not (folder / "out" / name).exists()


SAMPLED = """
from calib.confidence import posterior
from calib.workflows import predictive
for name, value in {few}.items():
    setattr(posterior, name, value)
predictive.PREDICTIVE_DRAWS = {draws}
from calib.cli import main
main()
"""


@pytest.mark.slow
def test_random_kills_of_a_posterior_end_in_the_same_samples(profiled, tmp_path):
    command = [sys.executable, "-c", SAMPLED.format(few={**FEW, "EFFECTIVE_SIZE": 50.0}, draws=FEW_DRAWS)]
    folders = tmp_path / "whole", tmp_path / "killed"
    for folder in folders:
        shutil.copytree(profiled[0], folder)
    whole, killed = ([*command, "confidence", str(folder), "--posterior", "-q"] for folder in folders)
    subprocess.run(whole, env=environment(), check=True)
    needed = (folders[0] / "out" / "confidence.jsonl").read_bytes().count(b'"evaluation/')
    notes, rng = folders[1] / "out" / "confidence.jsonl", random.Random(1)
    for kill in range(KILLS):
        until = rng.randint(needed * kill // KILLS, needed * (kill + 1) // KILLS - 60)
        process = subprocess.Popen(killed, env=environment(), stderr=subprocess.DEVNULL)
        while notes.read_bytes().count(b'"evaluation/') < until:
            assert process.poll() is None, "the run ended before it was killed"
            time.sleep(0.01)
        time.sleep(rng.uniform(0.0, 0.05))
        process.send_signal(signal.SIGKILL)
        process.wait()
    subprocess.run(killed, env=environment(), check=True)
    assert notes.read_bytes().count(b'"evaluation/') == needed  # none was made twice
    one, other = (read_confidence(folder / "out") for folder in folders)
    assert numbers(one) == numbers(other)
    for group in ("posterior", "sample_stats", "posterior_predictive"):
        first, second = (xr.load_dataset(folder / "out" / "posterior.nc", group=group) for folder in folders)
        xr.testing.assert_identical(first, second)
    assert (folders[0] / "out" / "ensemble.csv").read_bytes() == (folders[1] / "out" / "ensemble.csv").read_bytes()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:\\s*ArviZ is undergoing a major refactor:FutureWarning")
def test_a_posterior_distribution_alone_takes_no_profiles(calibrated, profiled, tmp_path, few_live_points):
    folder = tmp_path / "echo"
    shutil.copytree(calibrated, folder)
    output = calib("confidence", folder, "--only-posterior").output
    assert "by the profile" not in output
    result = read_confidence(folder / "out")
    assert result.profiles == ()
    keys = re.findall(r'"key":"([^"]*)/', (folder / "out" / "confidence.jsonl").read_text())
    assert set(keys) == {"0", "evaluation"}  # the best point, and those of the sampler
    assert not (folder / "out" / "confidence.png").exists()
    assert 'id="posterior"' in (folder / "out" / "report.html").read_text()
    earlier = read_confidence(profiled[0] / "out")
    for own, marginal in zip(earlier.profiles, result.posterior.parameters, strict=True):
        assert marginal.mean == pytest.approx(own.value, abs=0.05 * (own.local[1] - own.local[0]))
    calib("confidence", folder)
    calib("confidence", folder, "--only-posterior", "-q")
    both = read_confidence(folder / "out")
    assert [own.name for own in both.profiles] == ["gain", "harmonic"]  # of the run before
    assert both.posterior == result.posterior


def test_a_posterior_distribution_alone_has_no_pairs(calibrated):
    told = calib("confidence", calibrated, "--only-posterior", "--pairs", "all", code=1).output
    assert "--pairs are profiles" in told


HELD_OUT = """
[[record]]
name = "louder"
path = "louder.nc"
nuisance = ["trigger"]
use = "holdout"

[model]
"""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:\\s*ArviZ is undergoing a major refactor:FutureWarning")
@undrawn()
def test_a_posterior_predicts_the_records_that_the_model_made(tmp_path, few_live_points, monkeypatch):
    monkeypatch.setattr(predictive, "PREDICTIVE_DRAWS", 40)
    path = write_study(tmp_path, ("[model]\n", HELD_OUT.lstrip()))
    records.write(bench(amplitude=2e-3, seed=7), tmp_path / "louder.nc")
    calib("run", path, "-q")
    simulations = [0]

    def stop(done, foreseen):
        simulations[0] += done > 0 and foreseen - done == 30
        if simulations[0] == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        confidence_study(path, posterior=True, on_progress=stop)
    assert len(list((tmp_path / "out").glob(".predictive.nc-pieces/*/*.npz"))) >= 40
    output = calib("confidence", path, "--posterior").output
    assert not list((tmp_path / "out").glob(".predictive*"))
    assert "samples inside the 95 % band" in output
    calibrated, held_out = read_confidence(tmp_path / "out").posterior.predicted
    assert [(one.name, one.held_out, one.draws, one.failed) for one in (calibrated, held_out)] == [
        ("bench", False, 40, 0), ("louder", True, 40, 0)
    ]  # fmt: skip
    for own in (*calibrated.channels, *held_out.channels):
        assert own.samples == 400
        assert own.inside == pytest.approx(0.95, abs=0.04)  # three standard deviations of 400 samples
        assert own.source == "stated in the record"
    assert set(read_bands(tmp_path / "out")) == {"bench", "louder"}

    import arviz  # here: it warns when it is imported

    data = arviz.from_netcdf(tmp_path / "out" / "posterior.nc")
    assert {"posterior_predictive", "predictions", "observed_data"} <= set(data.groups())
    drawn = data.posterior_predictive["bench.displacement"]
    assert drawn.dims == ("chain", "draw", "bench.displacement.body", "bench.time")
    spread = (drawn - data.posterior_predictive["bench.displacement.curve"]).std()
    assert float(spread) == pytest.approx(NOISE, rel=0.05)
    assert data.observed_data["louder.velocity"].shape == (1, 400)


@pytest.mark.slow
@undrawn()
def test_the_model_that_made_the_record_has_the_evidence(tmp_path, few_live_points):
    without = ('harmonic = { low = "-1 mm", high = "1 mm" }\n', "")
    fixed = ('"tiny_simulators:Echo"', '"tiny_simulators:Echo"\nfixed = { harmonic = 0.0 }')
    (tmp_path / "base").mkdir()
    path = write_study(tmp_path / "base", without, fixed)
    other = write_study(tmp_path, ('name = "echo"', 'name = "echo with a harmonic"'))
    calib("run", path, "-q")
    assert "calibrate first" in calib("confidence", path, "--compare", other, code=1).output
    calib("run", other, "-q")
    output = calib("confidence", path, "--compare", other).output
    assert "echo with a harmonic: the evidence for this model is very strong; no width of the windows" in output
    comparison = read_confidence(path.parent / "out").comparison
    base, extended = comparison.models
    assert (base.name, base.factor, base.parameters, extended.parameters) == ("echo", 0.0, (), ("harmonic",))
    assert (extended.log_likelihood, comparison.noise) == (0.0, "echo with a harmonic")
    assert extended.factor > 100.0
    assert extended.factor == pytest.approx(extended.log_evidence - base.log_evidence)
    assert comparison.diagnosis.startswith("no diagnosis")
    evaluated = (tmp_path / "out" / "confidence.jsonl").read_bytes().count(b'"evaluation/')
    assert evaluated == extended.evaluations


def test_studies_of_other_records_are_not_compared(calibrated, tmp_path):
    other = write_study(tmp_path, ('name = "bench"', 'name = "lab"'))
    message = "calibrates on lab, and .* on bench; models are compared on the same records"
    assert re.search(message, " ".join(calib("confidence", calibrated, "--compare", other, code=1).output.split()))
    write_study(tmp_path)
    records.write(bench(seed=5), tmp_path / "bench.nc")
    output = " ".join(calib("confidence", calibrated, "--compare", other, code=1).output.split())
    assert "record 'bench' of" in output
    assert "is another one than that of" in output
    output = calib("confidence", calibrated, "--compare", calibrated / "study.toml", code=1).output
    assert "is the study itself" in output


@pytest.mark.slow
@undrawn()
def test_a_scale_that_is_uncertain_by_two_percent_widens_the_interval(tmp_path, few_live_points):
    narrow = ('gain = { low = 0.5, high = 2.0, scale = "log" }', "gain = { low = 1.0, high = 1.4 }")
    path = write_study(tmp_path, narrow, ('low = "-1 mm", high = "1 mm"', 'low = "0.1 mm", high = "0.3 mm"'))
    sigmas = {"scale.displacement": 0.02, "scale.velocity": 0.02}
    records.write(bench().assign_attrs(nuisance_sigma=json.dumps(sigmas)), tmp_path / "bench.nc")
    calib("run", path, "-q")
    output = calib("confidence", path, "--posterior", "--sample-nuisances").output
    assert "instrument_scale_velocity@bench normal, mean 1, standard deviation 0.02" in output
    result = read_confidence(tmp_path / "out")
    marginals = {own.name: own for own in result.posterior.parameters}
    local = (result.profiles[0].local[1] - result.profiles[0].local[0]) / 4.0
    gain = marginals["gain"]
    assert local < 0.002  # of a gain of 1.2, where the scale is certain
    # the two scales are independent, and their ratio is measured: they are uncertain together by 2 % / sqrt(2)
    assert gain.standard_deviation == pytest.approx(1.2 * 0.02 / math.sqrt(2.0), rel=0.15)
    assert marginals["instrument_scale_displacement@bench"].standard_deviation == pytest.approx(0.0141, rel=0.15)
    assert (tmp_path / "out" / "confidence.nuisances.jsonl").is_file()
    for own in result.posterior.predicted[0].channels:
        assert own.inside == pytest.approx(0.95, abs=0.04)


@pytest.mark.slow
@undrawn()
@pytest.mark.parametrize("bias", [0.0004, 0.003])
def test_the_confirming_simulator_moves_the_posterior_by_what_the_sketch_is_off(tmp_path, few_live_points, bias):
    sketch = ('"tiny_simulators:Echo"', f'"tiny_simulators:Sketch"\noptions = {{ bias = {bias} }}')
    path = write_study(tmp_path, sketch)
    calib("run", path, "-q")
    output = calib("confidence", path, "--posterior").output
    result = read_confidence(tmp_path / "out")
    own, gain = result.posterior.confirmed, result.posterior.parameters[0]
    assert (own.draws, own.failed) == (48, 0)
    assert f"confirming simulator: {own.text}" in output
    kept = (tmp_path / "out" / "confidence.jsonl").read_bytes().count(b'"confirmed/')
    assert 40 <= kept <= 48  # a draw may be there twice
    off = bias / gain.standard_deviation
    assert own.spread == pytest.approx(off, rel=0.35)
    assert own.reweighted == (off < 1.0)
    if own.reweighted:
        assert own.effective_size / 48.0 == pytest.approx(math.exp(-(off**2)), abs=0.2)
        assert own.parameters[0].shift == pytest.approx(off, abs=0.3)


def test_nuisances_are_sampled_with_the_posterior_only(calibrated):
    assert "give --posterior too" in calib("confidence", calibrated, "--sample-nuisances", code=1).output


def test_a_study_without_nuisances_to_sample_is_refused(profiled):
    folder, _ = profiled
    message = "there is no nuisance to sample: expected a calibrated record that names scale"
    assert message in calib("confidence", folder, "--posterior", "--sample-nuisances", code=1).output


PRIORS = """
[confidence.priors]
gain = { kind = "lognormal", median = 1.1, standard_deviation = 0.1 }
harmonic = { kind = "normal", mean = "0.2 mm", standard_deviation = "50 um" }
"""


def test_priors_of_a_study_are_read_in_its_units(tmp_path):
    path = write_study(tmp_path)
    before = load(path).study.header.definition
    path.write_text(path.read_text() + PRIORS)
    file = load(path)
    assert file.priors["gain"] == Prior("lognormal", 1.1, 0.1)
    harmonic = file.priors["harmonic"]
    assert (harmonic.kind, harmonic.centre, harmonic.spread) == ("normal", pytest.approx(2e-4), pytest.approx(5e-5))
    assert file.study.header.definition == before  # the trials stay valid


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ('gane = { kind = "normal", mean = 1.0, standard_deviation = 1.0 }', "no parameter 'gane' is searched"),
        ('gain = { kind = "gamma", mean = 1.0, standard_deviation = 1.0 }', "'normal' or 'lognormal'"),
        ('gain = { kind = "normal", median = 1.0, standard_deviation = 1.0 }', "takes the keys mean and standard_dev"),
        ('gain = { kind = "normal", mean = 1.0, standard_deviation = 0.0 }', "a finite standard deviation above 0"),
        ('gain = { kind = "normal", mean = 9.0, standard_deviation = 0.1 }', "in the window [0.5, 2]"),
        ('harmonic = { kind = "normal", mean = "1 kg", standard_deviation = "1 mm" }', "kg"),
    ],
)
def test_wrong_priors_are_named(tmp_path, stated, message):
    path = write_study(tmp_path)
    path.write_text(f"{path.read_text()}\n[confidence.priors]\n{stated}\n")
    with pytest.raises(CalibError, match=re.escape(message)) as error:
        load(path)
    assert "confidence.priors." in str(error.value)


def test_without_the_extra_its_command_is_told(calibrated, monkeypatch):
    monkeypatch.setitem(sys.modules, "nautilus", None)
    answer = calib("confidence", calibrated, "--posterior", code=1)
    assert 'pip install "calib[confidence]"' in answer.output
