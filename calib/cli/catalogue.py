"""What a study file may name, with its parameters, sites and options."""

import inspect
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from calib import plugins
from calib.errors import CalibError, nearest
from calib.modelling.effect import EFFECT_GROUPS, Effect
from calib.modelling.parameter import Parameter
from calib.study_file import StudyToml
from calib.study_file.load import CONTRACT_ARGUMENTS


def catalogue() -> dict[str, dict[str, str]]:
    """Return group -> name -> one line on it."""
    return {
        group.rpartition(".")[2]: {name: _first_line(thing) for name, thing in plugins.load_all(group).items()}
        for group in plugins.GROUPS
    }


def sections() -> dict[str, dict[str, str]]:
    """Return title -> name -> one line on it: the catalogue with the effects by what they are."""
    groups = catalogue()
    parts = {}
    for group, things in groups.items():
        if group != "effects":
            parts[group] = things
            continue
        for kind, names in effect_groups(plugins.load_all("calib.effects")).items():
            parts[f"{group}: {kind}"] = {name: things[name] for name in names}
    return parts


def effect_groups(effects: Mapping[str, Any]) -> dict[str, list[str]]:
    """Return group -> names of the effects in it, in the order of `calib.modelling.effect.EFFECT_GROUPS`."""
    known = {name: effect.group for name, effect in effects.items() if isinstance(effect, Effect)}
    groups = {group: [name for name, own in known.items() if own == group] for group in EFFECT_GROUPS}
    return {group: names for group, names in groups.items() if names}


def thing(name: str) -> Any:
    """Return what `name` stands for: an entry point, or "module:Thing" of a module in the current folder or installed.

    Raises
    ------
    CalibError : nothing is called so, or it is neither an effect nor something that is called with options
    """
    if ":" in name:
        own = plugins.load(plugins.GROUPS[0], name, Path.cwd())
        if not isinstance(own, Effect) and not callable(own):
            raise CalibError(f"{name!r} is an object of type {type(own).__name__}; name an effect or a class")
        return own
    known = {n: group for group in plugins.GROUPS for n in plugins.names(group)}
    if name not in known:
        raise CalibError(
            f"nothing is called {name!r}{nearest(name, known)}; `calib list` shows what there is, "
            "`calib list module:Thing` what you wrote"
        )
    return plugins.load(known[name], name)


def facts(item: Any) -> Iterator[tuple[str, str]]:
    """Yield name and text of each fact about a member of a family besides its parameters."""
    if isinstance(item, Effect):
        yield "group", item.group
        yield "site", item.site if item.place == "body" else f"{item.site}, at the {item.place}"
        yield "meaning", item.meaning
        yield "equation", item.equation
        yield "confused with", ", ".join(item.confused)
        if item.generalises:
            yield "generalises", ", ".join(item.generalises)
        if item.requires:
            yield "requires", f"{item.requires}; a diagnosis suspects it where candidates name it"
        yield "absent at", ", ".join(f"{name} = {value:g}" for name, value in item.null.items())
        if item.cite:
            yield "source", item.cite
        return
    yield "meaning", inspect.getdoc(item) or ""
    for name in ("bodies", "channels", "unit", "sites"):
        value = getattr(item, name, None)
        if isinstance(value, str | tuple | frozenset):
            yield name, value if isinstance(value, str) else ", ".join(sorted(value) if name == "sites" else value)
    yield "options", ", ".join(_options(item)) or "none"
    if _simulates(item):
        yield "effects", ", ".join(_taken(item()))


def parameters(item: Any) -> tuple[Parameter, ...]:
    """Return the parameters of a simulator (with its default options) or an effect."""
    if isinstance(item, Effect):
        return item.parameters
    return tuple(item().parameters) if _simulates(item) else ()


def _simulates(item: Any) -> bool:
    """Whether it is a simulator that can be made with its default options."""
    return isinstance(item, type) and not _required(item) and hasattr(item, "run")


def _taken(simulator: Any) -> list[str]:
    """Names of the effects that a simulator takes."""
    effects = plugins.load_all("calib.effects")
    return [name for name, effect in effects.items() if isinstance(effect, Effect) and not effect.refusal(simulator)]


def schema() -> str:
    """Return the JSON schema of a study file."""
    return json.dumps(StudyToml.model_json_schema(), indent=2)


def _first_line(item: Any) -> str:
    text = item.meaning if isinstance(item, Effect) else inspect.getdoc(item) or ""
    return text.partition("\n")[0]


def _signature(item: Any) -> Mapping[str, inspect.Parameter]:
    """Return what a user states: not the arguments of an optimiser's contract, nor the path that a reader is given."""
    accepted = inspect.signature(item).parameters.items()
    return {n: p for n, p in accepted if n not in CONTRACT_ARGUMENTS and p.kind is not p.POSITIONAL_ONLY}


def _required(item: Any) -> list[str]:
    return [n for n, p in _signature(item).items() if p.default is p.empty and p.kind is not p.VAR_KEYWORD]


def _options(item: Any) -> list[str]:
    return [n if p.default is p.empty else f"{n} = {p.default!r}" for n, p in _signature(item).items()]
