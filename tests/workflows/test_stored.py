"""The report and the status of a finished study import and run nothing of what its file names but the features."""

import shutil
import sys

import pytest
from click.testing import CliRunner
from echo_study import TEXT, write_study
from written_page import page_content

from calib.cli import main
from calib.workflows.stored import stored_study

MARKER = "imported"
FOREIGN = """\
from pathlib import Path

from calib.modelling.effect import Effect
from calib.optimisers.multistart import Multistart
from tiny_simulators import Echo

Path(__file__).with_name("imported").touch()


class Own(Echo):
    name = "own"


class Search(Multistart):
    pass
"""
CANDIDATES = '\n[diagnosis]\ncandidates = ["foreign_effects:GAIN"]\n'
EFFECTS = """\
from dataclasses import replace
from pathlib import Path

from calib.effects.channel_gain import EFFECT

Path(__file__).with_name("imported").touch()
GAIN = replace(EFFECT, name="own_gain")
"""


def calib(folder, *command):
    """Run a command on the study in a folder as a new process would: nothing of the folder is imported yet."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", [*sys.path])
        for name in ("foreign", "foreign_effects"):
            sys.modules.pop(name, None)
        ended = CliRunner().invoke(main, [*command, str(folder)], catch_exceptions=False)
    assert ended.exit_code == 0, ended.output
    return ended


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Folder of a study of foreign modules that has run."""
    folder = tmp_path_factory.mktemp("foreign")
    (folder / "foreign.py").write_text(FOREIGN)
    (folder / "foreign_effects.py").write_text(EFFECTS)
    write_study(
        folder, ('"tiny_simulators:Echo"', '"foreign:Own"'), ('"multistart"', '"foreign:Search"'),
        text=TEXT + CANDIDATES,
    )  # fmt: skip
    calib(folder, "run", "--quiet")
    assert (folder / MARKER).exists()
    (folder / MARKER).unlink()
    return folder


def test_neither_report_nor_status_import_simulator_optimiser_or_candidates(finished):
    before = page_content(finished / "out" / "report.html")
    (finished / "out" / "report.html").unlink()
    assert "finished" in calib(finished, "status").stdout
    calib(finished, "report")
    assert not (finished / MARKER).exists()
    assert page_content(finished / "out" / "report.html") == before


def test_a_report_needs_the_simulator_where_a_best_record_is_missing(finished, tmp_path):
    folder = tmp_path / "copy"
    shutil.copytree(finished, folder)
    assert stored_study(folder) is not None
    (folder / "out" / "best.nc").unlink()
    assert stored_study(folder) is None
    calib(folder, "report")
    assert (folder / MARKER).exists()


def test_a_study_that_has_gone_on_since_its_result_is_evaluated_anew(finished, tmp_path):
    folder = tmp_path / "copy"
    shutil.copytree(finished, folder)
    path = folder / "out" / "trials.jsonl"
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:9]))  # it has no longer the best trial
    calib(folder, "report")
    assert "not finished" in (folder / "out" / "report.html").read_text()


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("diagnosis.json", "{", "holds no diagnosis"),
        ("diagnosis.json", '{"verdict": 3}', "holds no diagnosis"),
        ("discovery.json", "[]", "holds no force law"),
        ("confidence.json", "{", "holds no profiles"),
        ("window.json", "{", "holds no window"),
        ("window.json", '{"name": "echo"}', "holds no window"),
    ],
)
def test_a_damaged_file_beside_the_calibration_is_left_out_of_the_report_and_named(
    finished, tmp_path, name, content, told
):
    folder = tmp_path / "copy"
    shutil.copytree(finished, folder)
    (folder / "out" / name).write_text(content)
    calib(folder, "report")
    page = " ".join((folder / "out" / "report.html").read_text().split())
    assert "<strong>Left out:</strong>" in page
    assert told in page.partition("<strong>Left out:</strong>")[2].partition("</div>")[0]
    assert name in page


@pytest.mark.slow
def test_a_window_whose_arrays_are_damaged_is_left_out_of_the_report(finished, tmp_path):
    folder = tmp_path / "copy"
    shutil.copytree(finished, folder)
    calib(folder, "window", "--budget", "17", "-q")
    whole = (folder / "out" / "window.nc").read_bytes()
    (folder / "out" / "window.nc").write_bytes(whole[: len(whole) // 2])
    calib(folder, "report")
    page = (folder / "out" / "report.html").read_text()
    assert "window.nc: not a readable netCDF file" in page.partition("<strong>Left out:</strong>")[2]
