"""The code outside calib that a study uses: digests of files, or versions of installed distributions and programs."""

import ast
import hashlib
import sys
import sysconfig
from collections.abc import Iterable, Iterator
from importlib.metadata import packages_distributions, version
from pathlib import Path

from calib import plugins
from calib.modelling.simulator import Simulator
from calib.study_file.schema import StudyToml
from calib.study_file.session_code import session_digest

SCRIPT = "__main__"  # module of what a script defines that is being run


def used_code(shape: StudyToml, folder: Path | None, simulator: Simulator | None = None) -> dict[str, str]:
    """Return module -> "sha256 ..." of its source, or name and version of the distribution that installed it.

    These are the modules of simulator, effects, features and optimiser outside calib, and the modules in the same
    folder, or in that of the study, which they import. The code of calib itself is known by its version. What a
    script, a notebook or an interactive session defines stands with its name and a digest of its compiled code. Files
    and programs stand with their name.

    Parameters
    ----------
    folder : in which modules of the study lie; None: all are on Python's path
    simulator : which may name further modules in `references`, and files and programs in `code`; None names none
    """
    references = [
        ("calib.simulators", shape.model.simulator),
        *(("calib.effects", effect.name) for effect in shape.model.effects),
        *(("calib.features", term.feature) for term in shape.term),
        ("calib.optimisers", shape.optimiser.name),
        *(("calib.simulators", reference) for reference in getattr(simulator, "references", ())),
    ]
    folders = [] if folder is None else [folder.resolve()]
    code: dict[str, str] = {}
    for group, name in references:
        module = plugins.module_name(group, name)
        if module.partition(".")[0] == "calib":
            continue
        file = getattr(sys.modules.get(module), "__file__", None)
        if file is None or module == SCRIPT:
            code[name] = session_digest(plugins.load(group, name, folder))
        if file is not None:
            code |= _code_of(module, Path(file).resolve(), folders)
    code.pop(SCRIPT, None)  # its budget and its pictures are no part of the simulator
    return dict(sorted({**code, **getattr(simulator, "code", {})}.items()))


def _code_of(module: str, file: Path, folders: list[Path]) -> dict[str, str]:
    """Identity of a loaded module and of those beside it, or in `folders`, that it imports directly or indirectly."""
    installed = _distribution(module, file)
    if installed:
        return {module.partition(".")[0]: installed}
    beside = file.parents[len(module.split(".")) - (file.stem != "__init__")]  # folder of its outermost package
    files = {module: file}
    todo = [module]
    while todo:
        name = todo.pop()
        for other in _imported(name, files[name]):
            found = next(filter(None, (plugins.module_file(place, other) for place in (beside, *folders))), None)
            if found is not None and other not in files:
                files[other] = found
                todo.append(other)
    return {name: f"sha256 {hashlib.sha256(path.read_bytes()).hexdigest()}" for name, path in files.items()}


def _distribution(module: str, file: Path) -> str:
    """Name and version of the distribution that installed a file; empty where it is none's, or editable."""
    sites = {Path(sysconfig.get_path(kind)).resolve() for kind in ("purelib", "platlib")}
    if not any(file.is_relative_to(site) for site in sites):
        return ""
    names: Iterable[str] = packages_distributions().get(module.partition(".")[0], ())
    return ", ".join(f"{name} {version(name)}" for name in sorted(set(names)))


def _imported(module: str, file: Path) -> Iterator[str]:
    """Names of modules that a source file may import, its packages among them; not all of them need be modules."""
    yield from _with_parents(module)
    if file.suffix != ".py":
        return
    package = module.split(".") if file.stem == "__init__" else module.split(".")[:-1]
    for node in ast.walk(ast.parse(file.read_bytes())):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield from _with_parents(alias.name)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            source = ".".join([*above, *filter(None, [node.module])])
            yield from _with_parents(source)
            yield from (f"{source}.{alias.name}" if source else alias.name for alias in node.names)


def _with_parents(module: str) -> Iterator[str]:
    parts = module.split(".")
    return (".".join(parts[:count]) for count in range(1, len(parts) + 1) if parts[0])
