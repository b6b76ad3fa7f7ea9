"""Code blocks of a page, run one after the other in a folder, as a reader would.

`python` runs in one namespace a page and `sh` in bash; a block with a title is written to a file of that name; other
`toml` is read as part of a study file or of a figure's description; `text` is what a reader sees.
"""

import os
import re
import shlex
import signal
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from child_environment import environment
from pydantic import ValidationError

from calib.digitise.spec import FigureToml
from calib.study_file import StudyToml

ROOT = Path(__file__).parents[2]
LANGUAGES = ("python", "sh", "toml", "text")
FENCE = re.compile(r"^```(\w*)([^\n]*)\n(.*?)^```$", flags=re.MULTILINE | re.DOTALL)
INSTALLS = "python -m pip install"  # what .ci/run does, in an environment of its own


@dataclass(frozen=True)
class Block:
    """A code block of a page, with the number of its first line."""

    language: str
    title: str
    code: str
    line: int


def blocks(path: Path) -> list[Block]:
    """Return the code blocks of a page in their order."""
    text = path.read_text(encoding="utf-8")
    found = []
    for match in FENCE.finditer(text):
        title = re.search(r'title="([^"]+)"', match[2])
        found.append(Block(match[1], title[1] if title else "", match[3], text.count("\n", 0, match.start()) + 1))
    return found


def takes_long(path: Path) -> bool:
    """Whether the head of a page says that its blocks take long."""
    return path.read_text(encoding="utf-8").startswith("---\nslow: true\n")


def play(path: Path, folder: Path) -> None:
    """Run all blocks of a page in a folder, which is the working directory; the first that fails raises."""
    names: dict = {"__name__": "__main__"}
    for block in blocks(path):
        where = f"{path.name}, line {block.line}"
        if block.title:
            target = folder / block.title
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(block.code, encoding="utf-8")
        elif block.language == "python":
            exec(compile("\n" * block.line + block.code, str(path), "exec"), names)
        elif block.language == "sh":
            for line in block.code.replace("\\\n", " ").strip().splitlines():
                run(line, folder, where)
        elif block.language == "toml":
            check(block.code, where)


def run(line: str, folder: Path, where: str) -> None:
    """Run one line in bash; what installs is left to the continuous integration, what serves is stopped."""
    if line.startswith(INSTALLS):
        return
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    options = {"cwd": folder, "env": {**environment(), "PATH": path}, "text": True}
    if line.startswith("calib dashboard"):
        heeding = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)  # a job in the background ignores it otherwise
        with subprocess.Popen(shlex.split(line), stdout=subprocess.PIPE, preexec_fn=heeding, **options) as served:
            try:
                assert served.stdout.readline().startswith("http://127.0.0.1"), where
                served.send_signal(signal.SIGINT)
                served.communicate(timeout=60)
            finally:
                served.kill()
        return
    done = subprocess.run(["bash", "-ec", line], capture_output=True, check=False, **options)
    assert done.returncode == 0, f"{where}: {line}\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}"


def check(code: str, where: str) -> None:
    """See that a part of a study file, or of a figure's description, has known keys and values of the right kind."""
    part = tomllib.loads(code)
    table = FigureToml if {"panel", "curve", "source"} & set(part) else StudyToml
    try:
        table.model_validate(part)
    except ValidationError as error:
        wrong = [one for one in error.errors() if one["type"] != "missing"]
        assert not wrong, f"{where}: {wrong}"
