"""Where the results of a study file go."""

from pathlib import Path

EXTENDED = "extended"  # last part of the name of the study that a diagnosis extends, and of its file


def results_folder(path: Path) -> Path:
    """Folder of the results of a study: ``out``, ``out.loud`` of a study.loud.toml, ``out.extended`` if extended."""
    base, extended = path.stem, ""
    while base.endswith(f".{EXTENDED}"):
        base, extended = base.removesuffix(f".{EXTENDED}"), f"{extended}.{EXTENDED}"
    variant = base.removeprefix("study.")
    return path.parent / (("out" if variant == base else f"out.{variant}") + extended)
