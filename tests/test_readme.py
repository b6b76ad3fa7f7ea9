"""What the README shows works."""

import re
import shlex
import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner

from calib.cli import main
from calib.study_file import load

README = (Path(__file__).parents[1] / "README.md").read_text()
STUDIES = Path(__file__).parents[1] / "studies"


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


@pytest.mark.parametrize("text", blocks("toml"))
def test_its_study_is_read(text, tmp_path):
    folder = tmp_path / "studies" / "minimal"
    folder.mkdir(parents=True)
    (folder / "study.toml").write_text(text)
    (tmp_path / "experiments_ref").symlink_to(STUDIES.parent / "experiments_ref")
    assert load(folder).study.name == tomllib.loads(text)["study"]["name"]


def test_the_two_commands_stand_where_they_are_looked_for():
    [shell] = blocks("sh")
    commands = shell.strip().splitlines()
    assert len(commands) == 2
    assert all(command.startswith("python -m pip install") for command in commands)
    assert "<!-- the two commands -->\n```sh\n" + shell + "```\n<!-- end -->" in README


@pytest.mark.parametrize("line", re.findall(r"^\| `calib (.*?)`", README, flags=re.MULTILINE))
def test_its_commands_exist(line):
    name = shlex.split(line)[0]
    shown = CliRunner().invoke(main, [name, "--help"])
    assert shown.exit_code == 0
    for option in re.findall(r"(?<= )--?\w+", line):
        assert option in shown.output


@pytest.mark.parametrize("path", sorted(set(re.findall(r"\]\(([^)]+)\)", README))))
def test_its_links_lead_somewhere(path):
    assert (STUDIES.parent / path).exists()


def test_it_is_read_in_three_minutes():
    assert len(README.split()) < 1200
