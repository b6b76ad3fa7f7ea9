"""The file of a search for a force law: its document."""

import json
from collections.abc import Mapping
from pathlib import Path

from calib.diagnosis.discovery.discover import Discovery
from calib.diagnosis.discovery.document import DiscoveryResult
from calib.diagnosis.discovery.serialise import discovery_result
from calib.errors import CalibError
from calib.execution.files import whole

DISCOVERY = "discovery.json"


def write_discovery(discovery: Discovery, folder: Path, values: Mapping[str, float]) -> DiscoveryResult:
    """Write the file of a search that began at the calibrated `values`, and return what `read_discovery` reads."""
    document = discovery_result(discovery, values).as_dict()
    with whole(folder / DISCOVERY) as temporary:
        temporary.write_text(json.dumps(document, indent=2, allow_nan=False), encoding="utf-8")
    return DiscoveryResult.from_dict(document)


def read_discovery(folder: Path) -> DiscoveryResult | None:
    """Return the search in a folder, None where there is none.

    Raises
    ------
    CalibError : the file describes none
    """
    path = folder / DISCOVERY
    if not path.is_file():
        return None
    try:
        return DiscoveryResult.from_dict(json.loads(path.read_text(encoding="utf-8")))
    except ValueError as error:
        raise CalibError(f"{path} holds no force law ({error}); delete it and run `calib discover` again") from error
