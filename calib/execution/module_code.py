"""Identity of the code of a module: digests of its files, or the version of the distribution that installed it."""

import ast
import sysconfig
from collections.abc import Iterable, Iterator, Sequence
from importlib.metadata import packages_distributions, version
from pathlib import Path

from calib import plugins
from calib.execution.files import checksum


def module_code(module: str, file: Path, folders: Sequence[Path] = ()) -> dict[str, str]:
    """Return module -> "sha256 ..." of its source, of a loaded module and of those that it imports.

    Directly or indirectly, where they lie beside it or in `folders`. Of a module that a distribution installed its name
    and version stand instead.
    """
    installed = _distribution(module, file)
    if installed:
        return {module.partition(".")[0]: installed}
    return {name: f"sha256 {checksum(path)}" for name, path in module_files(module, file, folders).items()}


def module_files(module: str, file: Path, folders: Sequence[Path] = ()) -> dict[str, Path]:
    """Return module -> its source file, of a loaded module and of those that it imports: see `module_code`.

    Of a module that a distribution installed there are none.
    """
    if _distribution(module, file):
        return {}
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
    return files


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
