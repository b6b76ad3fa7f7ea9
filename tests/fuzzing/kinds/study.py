"""Study files: their text, their values and the names in them."""

import random
import tomllib
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import tomlkit
from bouncer import OPTIONS, TEMPLATE
from echo_study import write_study
from fuzzing.mutations import text_damaged, tree_damaged

from calib.study_file import load
from calib.workflows.new import new

SAMPLES = Path(__file__).parents[2] / "samples" / "v0_1"
PROGRAM = "#!/bin/sh\nexit 0\n"
COMMAND = """\
[study]
name = "program"
seed = 1
budget = 10
timeout = "20 s"
settle = 2

[[record]]
name = "bench"
path = "bench.nc"

[record.excitation]
place = "base"
quantity = "base motion"
frequency = "10 Hz"
amplitude = "1 mm"

[model]
simulator = "command"

[windows]
stiffness = { low = "9e3 1/s^2", high = "2e4 1/s^2" }
gap = { low = "0.4 mm", high = "2 mm", scale = "log", start = "1 mm" }

[[term]]
feature = "time_history"
bodies = ["mass"]
weight = 2.0

[optimiser]
name = "cma"
batch = 4

[store]
keep = "all"

[diagnosis]
candidates = ["gap_offset", { name = "channel_lag" }]

[diagnosis.bench]
frequency = ["5 Hz", "20 Hz"]
"""


@cache
def _files() -> dict[str, dict[str, bytes]]:
    found = {}
    with TemporaryDirectory() as temporary:
        folder = Path(temporary)
        for name in ("echo", "program"):
            (folder / name).mkdir()
            write_study(folder / name)
        document = tomlkit.parse(COMMAND)
        model: Any = document["model"]
        model["options"] = {**OPTIONS, "drives": {"base motion": "base"}}
        (folder / "program" / "study.toml").write_text(tomlkit.dumps(document))
        (folder / "program" / "deck.in.j2").write_text(TEMPLATE)
        (folder / "program" / "bouncer").write_text(PROGRAM)
        new("study", "spring", folder)
        for place in sorted(folder.iterdir()):
            found[place.name] = {
                p.name: p.read_bytes() for p in sorted(place.iterdir()) if p.suffix not in (".md", ".py")
            }
    found["sample"] = {path.name: path.read_bytes() for path in (SAMPLES / "sample").iterdir() if path.is_file()}
    return found


class _Studies:
    name = "study"

    def samples(self) -> list[str]:
        return list(_files())

    def make(self, sample: str, rng: random.Random | None, folder: Path) -> list[str]:
        for name, content in _files()[sample].items():
            (folder / name).write_bytes(content)
            if name == "bouncer":
                (folder / name).chmod(0o755)
        if rng is None:
            return []
        path = folder / "study.toml"
        if rng.random() < 0.4:
            path.write_bytes(text_damaged(path.read_bytes(), rng))
            return ["bytes"]
        document, done = tomllib.loads(path.read_text()), []
        for _ in range(rng.randint(1, 3)):
            document, what = tree_damaged(document, rng)
            done.append(what)
        path.write_bytes(_dumped(document).encode("utf-8", "surrogatepass"))
        return done

    def read(self, folder: Path) -> None:
        file = load(folder / "study.toml")
        file.suspects()

    def readable(self, folder: Path) -> frozenset[str]:
        """Whatever the study file names: it may name records anywhere."""
        try:
            document = tomllib.loads((folder / "study.toml").read_text())
        except (ValueError, RecursionError):
            return frozenset()
        return frozenset(_paths(document, folder))


def _paths(tree: Any, folder: Path) -> list[str]:
    if isinstance(tree, dict | list):
        inner = tree.values() if isinstance(tree, dict) else tree
        return [path for one in inner for path in _paths(one, folder)]
    if not isinstance(tree, str) or not 0 < len(tree) < 1000 or "\0" in tree:
        return []
    return [str((folder / word).resolve()) for word in (tree, tree.split()[0] if tree.split() else tree)]


def _dumped(value: Any, top: bool = True) -> str:
    """TOML of anything, also of what is not allowed there, at any depth of tables."""
    if isinstance(value, dict):
        if top:
            return "".join(f"{_key(key)} = {_dumped(one, False)}\n" for key, one in value.items())
        return "{ " + ", ".join(f"{_key(key)} = {_dumped(one, False)}" for key, one in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(_dumped(one, False) for one in value) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return str(value)
    return "none" if value is None else _key(value)


def _key(text: str) -> str:
    escaped = "".join(f"\\u{ord(c):04x}" if c in '"\\' or ord(c) < 32 or ord(c) == 127 else c for c in text)
    return f'"{escaped}"'


STUDY = _Studies()
