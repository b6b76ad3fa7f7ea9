"""Kernels without a wrapper for Python are called by compiled code alone: from Python they would end the process."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
IMPACT = ROOT / "calib" / "simulators" / "impact"
OPTIONS = {"ENCLOSED", "ENCLOSED_INLINED"}
CHOICES = {"by_stop", "by_loads"}  # make one kernel function of two plain ones


def decorations(node):
    """Names of the decorators of a function that are called, and of the options that are spread into them."""
    calls = [one for one in getattr(node, "decorator_list", ()) if isinstance(one, ast.Call)]
    options = {k.value.id for one in calls for k in one.keywords if isinstance(k.value, ast.Name)}
    return {getattr(one.func, "id", "") for one in calls}, options


def choices(tree):
    """Calls that make one kernel function of two, by the name of what they make; "" where that has none."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") in CHOICES:
            made = [own for own in tree.body if isinstance(own, ast.Assign) and own.value is node]
            yield (made[0].targets[0].id if made else ""), {getattr(one, "id", "") for one in node.args}


def enclosed(tree):
    """Names of the functions of a module that have no wrapper."""
    plain = {node.name for node in ast.walk(tree) if OPTIONS & decorations(node)[1]}
    return plain | {name for name, given in choices(tree) if name and OPTIONS & given}


def reachable(tree, of_modules):
    """Names in a module of functions without a wrapper: its own, and those that it imports."""
    names = enclosed(tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            own = of_modules.get(node.module, set())
            names |= {one.asname or one.name for one in node.names if one.name in own}
    return names


def called_by_python(tree):
    """Names that a module calls outside of compiled functions, and of those that a kernel function is made of."""
    parts = {name for _, given in choices(tree) for name in given}
    waiting, found = [tree], set()
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Call):
            found.add(getattr(node.func, "id", ""))
        waiting += [
            child for child in ast.iter_child_nodes(node)
            if not ("njit" in decorations(child)[0] or getattr(child, "name", None) in parts)
        ]  # fmt: skip
    return found


def test_python_calls_none_of_them():
    of_modules = {f"calib.simulators.impact.{p.stem}": enclosed(ast.parse(p.read_text())) for p in IMPACT.glob("*.py")}
    assert sum(map(len, of_modules.values())) > 40
    assert "set_loads" in of_modules["calib.simulators.impact.loads"]
    paths = [path for folder in ("calib", "tests", "studies") for path in (ROOT / folder).rglob("*.py")]
    users = [path for path in paths if "simulators.impact" in path.read_text()]
    assert len(users) > 40
    for path in users:
        tree = ast.parse(path.read_text())
        assert not reachable(tree, of_modules) & called_by_python(tree), path


@pytest.mark.parametrize(("decorator", "seen"), [("", True), ("@njit(**WITHIN)\n", False)])
def test_a_call_from_python_is_seen(decorator, seen):
    imported = "from calib.simulators.impact.loads import set_loads"
    tree = ast.parse(f"{imported}\n\n\n{decorator}def outer():\n    return set_loads(1)\n")
    assert reachable(tree, {"calib.simulators.impact.loads": {"set_loads"}}) == {"set_loads"}
    assert ("set_loads" in called_by_python(tree)) == seen
