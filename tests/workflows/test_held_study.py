"""A study of sweeps at held amplitudes from the file on: read, calibrated and diagnosed by the commands."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from response_recovery import held
from undrawn import undrawn

from calib.cli import main
from calib.diagnosis.artifacts import read_motions
from calib.records.held_response import as_measured
from calib.records.response import complex_amplitude
from calib.records.sweep_names import sweep_names

VALUES = {"mass": 1.0, "stiffness": 400.0, "damping": 1.0, "k3": 4e5}
STUDY = """
[study]
name = "held"
seed = 1
budget = 40
jobs = 1

[[record]]
name = "sweeps"
path = "held.csv"

[model]
simulator = "oscillator"
fixed = { mass = "1 kg" }

[windows]
stiffness = { low = "340 N/m", high = "460 N/m" }
damping = { low = 0.4, high = 2.5, scale = "log" }

[[term]]
feature = "frequency_response"

[optimiser]
name = "multistart"

[diagnosis]
candidates = ["cubic_stiffness", "quadratic_drag", "coulomb_friction", "residual_compliance"]
"""


@pytest.mark.slow
@undrawn()
def test_a_hardening_spring_is_named_where_motions_are_unstable_at_a_set_force(tmp_path):
    record = as_measured(held(VALUES, np.random.default_rng(3)))
    columns = [record[name].values for name in ("frequency", "level", "sweep")]
    own = complex_amplitude(record)[0]
    rows = np.column_stack([*columns, 1e3 * np.abs(own), np.degrees(np.angle(own))])
    heading = (
        "# place: mass\n# quantity: force\n# held: mass\n"
        "frequency [Hz], level [N], sweep, mass amplitude [mm], mass phase [deg]"
    )
    np.savetxt(tmp_path / "held.csv", rows, "%.7g", ",", header=heading, comments="")
    (tmp_path / "study.toml").write_text(STUDY)
    for command in ("run", "diagnose"):
        ended = CliRunner().invoke(main, [command, str(tmp_path), "-q"], catch_exceptions=False)
        assert ended.exit_code == 0, ended.output
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert (found["verdict"], found["causes"]) == ("named", ["cubic_stiffness"])
    assert found["suspects"][0]["size"]["k3"] == pytest.approx(4e5, rel=0.03)
    names = sweep_names(read_motions(tmp_path / "out")["sweeps"])  # the pictures of the residual are told by
    assert list(names.values()) == [f"mass held at {amplitude} mm, up" for amplitude in (4, 10, 20)]
    [levels] = found["levels"]
    assert levels["held"]
    assert levels["resonance"]["significant"]
    assert levels["resonance"]["change"] > 0.2  # Hz, from 4 to 20 mm
