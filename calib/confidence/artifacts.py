"""The file of the profiles of a study: its document."""

import json
from pathlib import Path

from calib.confidence.document import ConfidenceResult
from calib.errors import CalibError
from calib.execution.files import whole

CONFIDENCE = "confidence.json"


def write_confidence(result: ConfidenceResult, folder: Path) -> None:
    """Write what `read_confidence` reads."""
    with whole(folder / CONFIDENCE) as temporary:
        temporary.write_text(json.dumps(result.as_dict(), indent=2, allow_nan=False), encoding="utf-8")


def read_confidence(folder: Path) -> ConfidenceResult | None:
    """Return what the confidence.json of a folder says, None where there is none.

    Raises
    ------
    CalibError : the file describes none
    """
    path = folder / CONFIDENCE
    if not path.is_file():
        return None
    try:
        return ConfidenceResult.from_dict(json.loads(path.read_text(encoding="utf-8")))
    except ValueError as error:
        raise CalibError(f"{path} holds no profiles ({error}); delete it and run `calib confidence` again") from error
