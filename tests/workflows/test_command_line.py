"""Command lines that a user is told can be pasted into a shell."""

import re
import shlex
from pathlib import Path

from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

import calib
from calib.cli import main
from calib.workflows.command_line import command_line

BY_HAND = re.compile(rf"calib (?:{'|'.join(main.commands)})(?: -*[a-z-]+)* \{{")  # something behind it, unquoted


@given(st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), min_size=1))
def test_a_shell_reads_any_path_as_one_argument(path):
    assert shlex.split(command_line("run", "--dry-run", path)) == ["calib", "run", "--dry-run", path]


def test_a_plain_path_stands_as_it_is():
    assert command_line("run", Path("studies/minimal/study.toml")) == "calib run studies/minimal/study.toml"


def test_a_study_in_a_folder_with_a_space_is_run_by_the_command_line_that_is_told(tmp_path):
    folder = tmp_path / "measured in May"
    for kind, words in (("study", ["calib", "run"]), ("effect", ["pytest"])):
        ended = CliRunner().invoke(main, ["new", kind, "bench", "--folder", str(folder)])
        told = ended.stdout.splitlines()[-1].removeprefix("next: ").partition(";")[0]
        *command, path = shlex.split(told)
        assert command == words, ended.output
        assert Path(path).exists()
        assert Path(path).is_relative_to(folder)


def test_a_refusal_tells_the_command_line_that_mends_it(tmp_path):
    runner, folder = CliRunner(), tmp_path / "measured in May"
    assert runner.invoke(main, ["new", "study", "bench", "--folder", str(folder)]).exit_code == 0
    refused = runner.invoke(main, ["diagnose", str(folder / "bench")])
    assert refused.exit_code == 1
    told = re.search("calibrate first, with `(.*)`", refused.output)
    assert shlex.split(told[1]) == ["calib", "run", str(folder / "bench" / "study.toml")]
    refused = runner.invoke(main, ["diagnose", str(folder / "bench"), "--out", str(tmp_path / "of June")])
    told = re.search("calibrate first, with `(.*)`", refused.output)
    assert shlex.split(told[1])[2:] == [str(folder / "bench" / "study.toml"), "--out", str(tmp_path / "of June")]


def test_no_message_puts_a_path_behind_a_command_by_hand():
    assert BY_HAND.search('f"next: calib run {folder / name}"')
    sources = Path(calib.__file__).parent.rglob("*.py")
    assert [str(path) for path in sources if BY_HAND.search(path.read_text(encoding="utf-8"))] == []
