"""A study whose simulator has a period map in closed form: its study file, beside a record of the echo."""

from pathlib import Path

from echo_study import TEXT, write_study

MAPPED = (
    ("tiny_simulators:Echo", "tiny_simulators:Mapped"),
    ('nuisance = ["trigger"]', 'nuisance = ["trigger"]\nbodies = { mass = "body" }'),
)
BISTABLE = ("[windows]", 'options = { map = "bistable" }\n[windows]')


def waiting(gate: Path) -> tuple[str, str]:
    """Change of the study file by which the motion at a = 0.3 is found when `gate`, which is made, is gone."""
    gate.touch()
    return "[windows]", f'options = {{ faults = {{ waits = [0.3] }}, gate = "{gate}" }}\n[windows]'


def write_map_study(folder: Path, *changes: tuple[str, str]) -> Path:
    """Write record and study file into `folder`, the text with `changes` (old, new) made; return the study's path."""
    return write_study(folder, *MAPPED, *changes, text=TEXT)
