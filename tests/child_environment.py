"""The environment in which a child process finds the tests' modules and the checkout."""

import os
from pathlib import Path

HERE = Path(__file__).parent


def environment() -> dict[str, str]:
    """Variables of this process, with the tests and the checkout first on PYTHONPATH."""
    path = [str(HERE), str(HERE.parent), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(path)}
