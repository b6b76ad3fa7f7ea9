"""The file of a search for a force law: its document."""

from collections.abc import Mapping
from pathlib import Path

from calib.diagnosis.discovery.document import DiscoveryResult
from calib.diagnosis.discovery.outcome import Discovery
from calib.diagnosis.discovery.serialise import discovery_result
from calib.store.document import read_document, write_document

DISCOVERY = "discovery.json"


def write_discovery(discovery: Discovery, folder: Path, values: Mapping[str, float]) -> DiscoveryResult:
    """Write the file of a search that began at the calibrated `values`, and return what `read_discovery` reads."""
    document = discovery_result(discovery, values).as_dict()
    write_document(document, folder / DISCOVERY)
    return DiscoveryResult.from_dict(document)


def read_discovery(folder: Path) -> DiscoveryResult | None:
    """Return the search in a folder, None where there is none.

    Raises
    ------
    CalibError : the file describes none
    """
    return read_document(folder / DISCOVERY, DiscoveryResult.from_dict, "force law", "calib discover")
