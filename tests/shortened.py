"""A study of measured data over the first part of its records: a claim that a part shows does not wait for all."""

from pathlib import Path

import tomlkit


def shortened(study: Path, folder: Path, share: float) -> Path:
    """Write a study file with the first `share` of the rows of each record into a folder; return its path."""
    document = tomlkit.parse(study.read_text())
    for record in document["record"]:
        first, last = record["table"].get("first", 0), record["table"]["last"]
        record["table"]["last"] = first + round(share * (last - first))
    path = folder / "study.toml"
    path.write_text(tomlkit.dumps(document))
    return path
