"""Pictures of trials, where Optuna and its dashboard find them."""

import io
import json
import uuid
from dataclasses import asdict
from pathlib import Path

from optuna.artifacts import ArtifactMeta, FileSystemArtifactStore
from optuna.artifacts._upload import ARTIFACTS_ATTR_PREFIX  # private, see `Pictures.attribute`

ARTIFACTS = "artifacts"


class Pictures:
    """The pictures of one ledger's trials, as PNG files in its folder.

    Parameters
    ----------
    folder : of the study
    ledger : id of the ledger
    """

    def __init__(self, folder: Path, ledger: str):
        self._folder, self._ledger = folder / ARTIFACTS, uuid.UUID(ledger)
        self._folder.mkdir(exist_ok=True)
        self._files = FileSystemArtifactStore(self._folder)

    def write(self, number: int, picture: bytes) -> None:
        """Store the picture of a trial."""
        self._files.write(self._key(number), io.BytesIO(picture))

    def __contains__(self, number: int) -> bool:
        return (self._folder / self._key(number)).exists()

    def attribute(self, number: int) -> dict[str, str]:
        """System attribute of a mirrored trial by which its picture is found; empty where it has none.

        Optuna's own `upload_artifact` wants a trial that still runs; a mirrored one is never seen running.
        """
        if number not in self:
            return {}
        key = self._key(number)
        meta = ArtifactMeta(artifact_id=key, filename=f"{number:06d}.png", mimetype="image/png", encoding=None)
        return {ARTIFACTS_ATTR_PREFIX + key: json.dumps(asdict(meta))}

    def _key(self, number: int) -> str:
        return str(uuid.uuid5(self._ledger, str(number)))
