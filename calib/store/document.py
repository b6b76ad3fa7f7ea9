"""Documents of results: a dataclass in a JSON file, which is either whole or absent."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from calib.errors import CalibError
from calib.execution.files import whole

D = TypeVar("D")


def write_document(document: Mapping[str, Any], path: Path) -> None:
    """Write a JSON object of finite numbers, as `calib.store.plain.plain` makes it."""
    text = json.dumps(document, indent=2, allow_nan=False) + "\n"
    with whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def read_document(path: Path, from_dict: Callable[[Mapping[str, Any]], D], what: str, command: str) -> D | None:
    """Return what a file holds, None where there is no file.

    Parameters
    ----------
    from_dict : makes it of a JSON object; raises ValueError where that describes none
    what : it should hold, such as "result of a calibration"
    command : that writes the file

    Raises
    ------
    CalibError : the file is not JSON, or describes something else
    """
    try:
        return from_dict(json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        return None
    except (ValueError, RecursionError) as error:
        raise CalibError(f"{path} holds no {what} ({error}); delete it and run `{command}` again") from error
