"""What an outsider measures on the package: `python tests/measures.py` prints it, test_measures.py holds it.

With `--constants` it prints the numeric constants of the modules: file, name, value, comment.
"""

import ast
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import NamedTuple

PACKAGE = Path(__file__).parents[1] / "calib"
FUNCTION = ast.FunctionDef | ast.AsyncFunctionDef
ARITHMETIC = (
    ast.Constant, ast.Tuple, ast.UnaryOp, ast.BinOp, ast.Call, ast.Name, ast.Attribute, ast.operator, ast.unaryop,
    ast.expr_context,
)  # fmt: skip


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


class NumericConstant(NamedTuple):
    """A number, or a tuple of numbers, that a module gives a name in capitals."""

    path: Path
    name: str
    value: str
    comment: str


def constants() -> list[NumericConstant]:
    """Every numeric constant of the modules; those of one assignment share its comment."""
    return [
        NumericConstant(path.relative_to(PACKAGE), name, ast.unparse(value), comment)
        for path in sources()
        for lines in [path.read_text().splitlines()]
        for node in ast.parse("\n".join(lines)).body
        for comment in [_comment(lines, node)]
        for name, value in _assigned(node)
        if name.isupper() and _is_numeric(value)
    ]


def _assigned(node: ast.stmt) -> Iterator[tuple[str, ast.expr]]:
    """Names with their values, of an assignment to one name or of several to as many."""
    if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.value is not None:
        yield node.target.id, node.value
    for target in node.targets if isinstance(node, ast.Assign) else []:
        if isinstance(target, ast.Name):
            yield target.id, node.value
        elif isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
            names = [element for element in target.elts if isinstance(element, ast.Name)]
            yield from zip((name.id for name in names), node.value.elts, strict=True)


def _is_numeric(value: ast.expr) -> bool:
    parts = list(ast.walk(value))
    numbers = [part.value for part in parts if isinstance(part, ast.Constant)]
    return all(isinstance(part, ARITHMETIC) for part in parts) and {type(x) for x in numbers} in (
        {int}, {float}, {int, float},
    )  # fmt: skip


def _comment(lines: list[str], node: ast.stmt) -> str:
    """Comment at the end of a statement, or else the lines of comment above it."""
    _, beside, text = lines[node.end_lineno - 1].partition("#")
    first = node.lineno - 1
    while not beside and lines[first - 1].startswith("#"):
        first -= 1
    return text.strip() or " ".join(line.strip("# ") for line in lines[first : node.lineno - 1])


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


def print_constants() -> None:
    for constant in constants():
        print(*constant, sep=" | ")


if __name__ == "__main__":
    print_constants() if "--constants" in sys.argv[1:] else main()
