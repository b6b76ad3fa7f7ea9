"""The file of the profiles of a study: its document."""

from pathlib import Path

from calib.confidence.document import ConfidenceResult
from calib.store.document import read_document, write_document

CONFIDENCE = "confidence.json"


def write_confidence(result: ConfidenceResult, folder: Path) -> None:
    """Write what `read_confidence` reads."""
    write_document(result.as_dict(), folder / CONFIDENCE)


def read_confidence(folder: Path) -> ConfidenceResult | None:
    """Return what the confidence.json of a folder says, None where there is none.

    Raises
    ------
    CalibError : the file describes none
    """
    return read_document(folder / CONFIDENCE, ConfidenceResult.from_dict, "profiles", "calib confidence")
