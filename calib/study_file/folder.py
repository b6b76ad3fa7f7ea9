"""Where the results of a study file go."""

from pathlib import Path

EXTENDED = "extended"  # last part of the name of the study that a diagnosis extends, and of its file
FORCE_FOUND = "found"  # last part of the name of the study that has a force law that was found, and of its file


def extended_part(path: Path) -> str:
    """Last part of the name of the file of a study that extends another one; "" of one that does not."""
    return next((part for part in (EXTENDED, FORCE_FOUND) if path.stem.endswith(f".{part}")), "")


def base_path(path: Path) -> Path:
    """File of the study that another one extends."""
    return path.with_name(f"{path.stem.removesuffix(f'.{extended_part(path)}')}.toml")


def results_folder(path: Path) -> Path:
    """Folder of the results of a study: ``out``, ``out.loud`` of a study.loud.toml, ``out.extended`` if extended."""
    base, extended = path, ""
    while part := extended_part(base):
        base, extended = base_path(base), f".{part}{extended}"
    variant = base.stem.removeprefix("study.")
    return path.parent / (("out" if variant == base.stem else f"out.{variant}") + extended)
