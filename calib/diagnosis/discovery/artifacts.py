"""The file of a search for a force law: its document."""

from pathlib import Path

from calib.diagnosis.discovery.document import DiscoveryResult
from calib.store.document import read_document, write_document

DISCOVERY = "discovery.json"


def write_discovery(result: DiscoveryResult, folder: Path) -> DiscoveryResult:
    """Write the file of a search, and return what `read_discovery` reads."""
    document = result.as_dict()
    write_document(document, folder / DISCOVERY)
    return DiscoveryResult.from_dict(document)


def read_discovery(folder: Path) -> DiscoveryResult | None:
    """Return the search in a folder, None where there is none.

    Raises
    ------
    CalibError : the file describes none
    """
    return read_document(folder / DISCOVERY, DiscoveryResult.from_dict, "force law", "calib discover")
