"""What an outsider measures on the package: `python tests/measures.py` prints it, test_measures.py holds it."""

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from statistics import median

PACKAGE = Path(__file__).parents[1] / "calib"
FUNCTION = ast.FunctionDef | ast.AsyncFunctionDef


def sources() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


def lines_by_file() -> dict[Path, int]:
    return {path.relative_to(PACKAGE): len(path.read_text().splitlines()) for path in sources()}


def functions() -> Iterator[tuple[Path, FUNCTION]]:
    """Every function and method of the package that is not compiled."""
    for path in sources():
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, FUNCTION) and not compiled(node):
                yield path.relative_to(PACKAGE), node


def compiled(function: FUNCTION) -> bool:
    """Whether numba compiles it: a kernel."""
    return any("njit" in ast.unparse(decorator) for decorator in function.decorator_list)


def length(function: FUNCTION) -> int:
    return function.end_lineno - function.lineno + 1


def unannotated(function: FUNCTION) -> bool:
    """Whether an argument or the result has no type; the class's own first argument needs none."""
    arguments = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
    named = [a for a in arguments if a.arg not in ("self", "cls")]
    named += [a for a in (function.args.vararg, function.args.kwarg) if a is not None]
    return function.returns is None or any(a.annotation is None for a in named)


def public(function: FUNCTION) -> bool:
    return not function.name.startswith("_")


def class_names() -> Counter[str]:
    trees = (ast.parse(path.read_text()) for path in sources())
    return Counter(node.name for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ClassDef))


def entries_at_the_root() -> list[str]:
    return sorted(path.name for path in PACKAGE.iterdir() if path.name != "__pycache__")


def main() -> None:
    lengths = {f"{path}:{function.name}": length(function) for path, function in functions()}
    every = [function for _, function in functions() if public(function)]
    typed = sum(not unannotated(function) for function in every)
    print(f"files: {len(lines_by_file())}, median {median(lines_by_file().values()):.0f} lines")
    print("over 450 lines:", [f"{path} {lines}" for path, lines in lines_by_file().items() if lines > 450])
    print("functions over 60 lines:", [f"{name} {lines}" for name, lines in lengths.items() if lines > 60])
    print(f"public functions fully annotated: {typed} of {len(every)}")
    print("class names twice:", [name for name, times in class_names().items() if times > 1])
    print(f"entries at the root: {len(entries_at_the_root())}")


if __name__ == "__main__":
    main()
