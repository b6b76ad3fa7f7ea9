"""The suites of `calib.testing` need pytest, and nothing else that only our own tests need."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MODULES = {  # distribution -> module, where the names differ
    "pytest-xdist": "xdist",
    "scikit-fem": "skfem",
    "dask-jobqueue": "dask_jobqueue",
    "psycopg[binary]": "psycopg",
    "nautilus-sampler": "nautilus",
}


@pytest.fixture(scope="module")
def extras():
    """Names of the distributions of each extra of pyproject.toml."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    return {
        extra: [re.split(r"[<>=]", requirement)[0] for requirement in requirements]
        for extra, requirements in project["optional-dependencies"].items()
    }


def test_the_extra_is_pytest_alone(extras):
    assert extras["testing"] == ["pytest"]
    assert "calib[testing]" in extras["test"]


@pytest.mark.slow
def test_the_suites_import_where_only_that_extra_is_installed(extras):
    others = re.match(r"calib\[(.*)\]", next(name for name in extras["test"] if re.match(r"calib\[.*,", name)))[1]
    named = [*extras["test"], *(name for extra in others.split(",") for name in extras[extra])]
    absent = [MODULES.get(name, name) for name in named if not name.startswith("calib[")]
    assert {"hypothesis", "xdist", "cmaes", "distributed", "psycopg"} <= set(absent)
    code = (
        f"import sys; sys.modules.update(dict.fromkeys({absent}))  # importing one of them fails\n"
        "import calib.testing; print(*sorted(calib.testing.__all__))"
    )
    ended = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.stdout.split() == ["EffectSuite", "OptimiserSuite", "SimulatorSuite"], ended.stderr
