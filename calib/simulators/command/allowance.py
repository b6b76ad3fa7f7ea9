"""How much one rendering of a template may take, in operations and characters: the same on every machine."""

from collections.abc import Sequence, Sized
from typing import Any

from jinja2 import nodes
from jinja2.runtime import Context
from jinja2.visitor import NodeTransformer

from calib.errors import CalibError
from calib.units import in_si

MAX_OPERATIONS = 8_000_000  # of one rendering: steps of loops, calls, filters, elements that these look at; 10 s
MAX_CHARACTERS = 2**26  # of one rendering, 64 MiB: written, and passed on between its parts
CHARACTERS_PER_OPERATION = 64  # of a text that is looked at
OPERATIONS_OF_A_STEP = 8  # nodes of a syntax tree that take as long as a step of a loop, about
COUNT, SCALAR = "count steps", "refuse lists"  # filters of the syntax tree; no template can name a blank
OPERATIONS_OF_A_UNIT = 400  # to read it
KEY = "the allowance of this rendering"  # in the context, where no template can name it


class RenderingAllowance:
    """What is left of the operations and characters of one rendering, and the units that it has used."""

    def __init__(self) -> None:
        self._operations, self._characters = MAX_OPERATIONS, MAX_CHARACTERS
        self._units: dict[tuple[str, str | None], float] = {}

    def take(self, operations: int, characters: int = 0) -> None:
        """Count.

        Raises
        ------
        CalibError : it was too much altogether
        """
        self._operations -= operations
        self._characters -= characters
        if self._operations < 0:
            raise CalibError(f"loops, calls and filters of more than {MAX_OPERATIONS} steps; is a loop too long?")
        if self._characters < 0:
            raise CalibError(f"texts of more than {MAX_CHARACTERS} characters; is a loop too long?")

    def look_at(self, values: Sequence[Any]) -> None:
        """Count an operation for each element of what is a text or has a length."""
        for value in values:
            if isinstance(value, str):
                self.take(1 + len(value) // CHARACTERS_PER_OPERATION)
            else:
                self.take(1 + (len(value) if isinstance(value, Sized) else 0))

    def in_unit(self, value: float, unit: str, si: str | None) -> float:
        """Value in `unit` of a value in SI, as `calib.units.from_si` gives it; a new unit takes many operations."""
        if (unit, si) not in self._units:
            self.take(OPERATIONS_OF_A_UNIT)
            self._units[unit, si] = in_si(unit, si)
        self.take(1)
        return value / self._units[unit, si]


def allowance_of(context: Context) -> RenderingAllowance:
    """RenderingAllowance of the rendering to which a context belongs."""
    return context.parent[KEY]


def counted(template: nodes.Template) -> nodes.Template:
    """Return the syntax tree so that whatever can be repeated is counted, and only numbers and texts are compared."""
    return _CountingVisitor().visit(template)


class _CountingVisitor(NodeTransformer):
    def visit_For(self, node: nodes.For) -> nodes.For:
        """Count each step with the size of what is repeated, and each element that a condition is asked of."""
        self._begin(node)
        if node.test is not None:
            node.test = nodes.And(_filter(COUNT, nodes.Const(True), node.lineno, 1, 0), node.test)
        return node

    def visit_Macro(self, node: nodes.Macro) -> nodes.Macro:
        """Count each call with the size of what is called."""
        return self._begin(node)

    def visit_CallBlock(self, node: nodes.CallBlock) -> nodes.CallBlock:
        """Count each call with the size of what is called."""
        return self._begin(node)

    def visit_Block(self, node: nodes.Block) -> nodes.Block:
        """Count each call with the size of what is called."""
        return self._begin(node)

    def visit_Concat(self, node: nodes.Concat) -> nodes.Expr:
        """Join what ``~`` joins by the filter `join`, which counts."""
        self.generic_visit(node)
        return nodes.Filter(nodes.List(node.nodes, lineno=node.lineno), "join", [], [], None, None, lineno=node.lineno)

    def visit_Compare(self, node: nodes.Compare) -> nodes.Compare:
        """Compare numbers and texts only; ``in`` takes a list or a text on its right."""
        self.generic_visit(node)
        node.expr = _filter(SCALAR, node.expr, node.lineno)
        for operand in node.ops:
            name = COUNT if operand.op in ("in", "notin") else SCALAR
            operand.expr = _filter(name, operand.expr, node.lineno, *([1, 0] if name == COUNT else []))
        return node

    def visit_Getitem(self, node: nodes.Getitem) -> nodes.Getitem:
        """Count what a slice is cut from."""
        self.generic_visit(node)
        if isinstance(node.arg, nodes.Slice):
            node.node = _filter(COUNT, node.node, node.lineno, 1, 0)
        return node

    def _begin(self, node: Any) -> Any:
        """Count the operations and characters of a body at its beginning."""
        operations, characters = _size(node.body)
        self.generic_visit(node)
        count = _filter(COUNT, nodes.Const(True), node.lineno, 1 + operations, characters)
        node.body.insert(0, nodes.ExprStmt(count, lineno=node.lineno))
        return node


def _filter(name: str, operand: nodes.Expr, line: int, *arguments: int) -> nodes.Filter:
    return nodes.Filter(operand, name, [nodes.Const(one) for one in arguments], [], None, None, lineno=line)


def _size(body: Sequence[nodes.Node]) -> tuple[int, int]:
    """Operations and constant characters of a body, without those of what counts for itself."""
    operations = characters = 0
    todo = list(body)
    while todo:
        node = todo.pop()
        operations += isinstance(node, nodes.Expr | nodes.Stmt) and not isinstance(node, nodes.TemplateData)
        characters += len(node.data) if isinstance(node, nodes.TemplateData) else 0
        if not isinstance(node, nodes.For | nodes.Macro | nodes.CallBlock | nodes.Block):
            todo.extend(node.iter_child_nodes())
    return operations // OPERATIONS_OF_A_STEP, characters
