"""What studies/paper_window says of the paper's parameters, on a small version of it."""

import numpy as np
import pytest
from click.testing import CliRunner

from calib.cli import main
from calib.confidence.window.document import read_window
from calib.confidence.window.margins import CONTACT_MARGIN
from calib.execution.netcdf import read_dataset
from calib.study.evaluation import evaluate
from calib.study_file import load

NARROW = "studies/paper_window/narrow"
BEST = {"alpha": 500.0, "beta": 0.155, "f": 0.01, "c_con": 5.0, "g_max": 1.15e-4, "s": 8.86e-4}  # SI, of the search
TOLERANCE = 0.05  # of the layer's phase curve
POINTS = 64  # of the window

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("without_pictures")]


@pytest.fixture(scope="module")
def study(pytestconfig):
    return load(pytestconfig.rootpath / NARROW).study.without_search()


def misfit(study, **changed):
    """Distance of the layer's phase curve with other values than the best."""
    fixed = {name: window.low for name, window in study.space.windows.items() if name not in BEST}
    return evaluate(study, {"dt": 1.8e-7, **fixed, **BEST, **changed}).score.terms["phase_curve of layer"]


def test_stiffness_and_damping_of_the_contact_are_not_determined(study):
    assert misfit(study) < TOLERANCE
    for changed in ({"f": 0.003}, {"f": 0.1}, {"c_con": 0.2}, {"c_con": 50.0}):
        assert misfit(study, **changed) < TOLERANCE


def test_damping_and_gap_are(study):
    for changed in ({"alpha": 425.0}, {"alpha": 575.0}, {"s": 8e-4}, {"s": 9.7e-4}, {"g_max": 1e-5}, {"g_max": 2.2e-4}):
        assert misfit(study, **changed) > TOLERANCE


def test_the_window_knows_how_far_motions_without_contact_are_from_touching(pytestconfig, tmp_path):
    study = pytestconfig.rootpath / NARROW
    text = (
        (study / "study.toml")
        .read_text()
        .replace("../../../experiments_ref", f"{pytestconfig.rootpath}/experiments_ref")
    )
    (tmp_path / "study.toml").write_text(text.replace("budget = 600", "budget = 60"))
    for command in (("run", "-q"), ("window", "--budget", str(POINTS), "--tolerance", "0.2", "-q")):
        ended = CliRunner().invoke(main, [command[0], str(tmp_path), *command[1:]])
        assert ended.exit_code == 0, ended.output
    result, data = read_window(tmp_path / "out"), read_dataset(tmp_path / "out" / "window.nc")
    free = data.motion.values == "no contact"
    margin = data.margin.values[:, list(data.mechanism.values).index(CONTACT_MARGIN)]
    assert free.sum() >= 3
    assert (margin[free] < 0.0).all()
    assert (margin[np.isfinite(margin) & ~free] > 0.0).all()
    assert np.isfinite(data.margin.values[free]).all()
    assert 0.0 < result.share_low <= result.share <= result.share_high < 0.5
