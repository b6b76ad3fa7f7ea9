"""Effects that a diagnosis may name, as a study file or Python states them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import tomlkit

from calib import plugins
from calib.errors import CalibError
from calib.modelling.effect import Effect
from calib.study_file.mistakes import Mistakes, PythonOrigin, read_as
from calib.study_file.schema import DiagnosisTable, EffectTable

ALL = "all"  # among names: every registered effect that has no entry of its own


@dataclass(frozen=True)
class CandidateEntry:
    """An effect that a diagnosis may name.

    Attributes
    ----------
    reference : name of an entry point, or "package.module:Thing"
    bodies : on which it acts; None: where the simulator has its place
    named : whether it is stated by itself, and not as one of all: what it requires is then there
    """

    reference: str
    bodies: tuple[str, ...] | None = None
    named: bool = True

    def effect(self, folder: Path | None) -> Effect:
        """Return the effect, which requires nothing more where it is named."""
        effect = named_effect(self.reference, self.bodies, folder)
        return replace(effect, requires="") if self.named and effect.requires else effect


Candidates = tuple[CandidateEntry, ...]


def named_effect(name: str, bodies: Sequence[str] | None, folder: Path | None) -> Effect:
    """Return the effect of that name on some bodies.

    Raises
    ------
    CalibError : it does not load, or is no effect
    """
    effect = plugins.load("calib.effects", name, folder)
    if not isinstance(effect, Effect):
        raise CalibError(f"{name!r} is no effect but a {type(effect).__name__}")
    return effect if bodies is None else replace(effect, bodies=tuple(bodies))


def registered_candidates() -> Candidates:
    """Candidates where none are stated: all effects that are registered."""
    return tuple(CandidateEntry(name, named=False) for name in plugins.names("calib.effects"))


def stated_candidates(stated: str | Sequence[Any], folder: Path) -> Candidates | None:
    """Candidates of a diagnosis that are stated in Python, as [diagnosis] of a study file has them.

    Parameters
    ----------
    stated : "all", or names of effects ("all" among them) and mappings with name and bodies
    folder : in which modules of the study lie

    Raises
    ------
    CalibError : every mistake with its key
    """
    text = tomlkit.dumps({"candidates": stated})
    table, mistakes = read_as(DiagnosisTable, folder, text, PythonOrigin(folder))
    candidates = read_candidates(table.candidates, mistakes, "candidates")
    mistakes.tell()
    return candidates


def read_candidates(asked: Sequence[EffectTable] | None, mistakes: Mistakes, *key: str) -> Candidates | None:
    """Check candidates, each with its own key, and put the registered effects for "all" among them; None are all."""
    if asked is None:
        return None
    named = {entry.name for entry in asked}
    candidates: list[CandidateEntry] = []
    for index, entry in enumerate(asked):
        if entry.name == ALL and entry.bodies is None:
            others = [one for one in registered_candidates() if one.reference not in named]
            candidates += others
            named.update(one.reference for one in others)
            continue
        with mistakes.at(*key, index):
            named_effect(entry.name, entry.bodies, mistakes.modules)
        candidates.append(CandidateEntry(entry.name, None if entry.bodies is None else tuple(entry.bodies)))
    return tuple(candidates)
