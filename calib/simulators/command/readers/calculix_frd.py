"""The reader of the nodal results of CalculiX, an .frd file."""

import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from calib.errors import CalibError
from calib.simulators.command.readers.columns import Columns
from calib.simulators.command.readers.frd import nodal_results
from calib.simulators.command.readers.histories import MAX_SHOWN_NAMES, Histories, Names, listed

NODE = re.compile(r"[0-9]{1,10}")


def read(path: Path, /, *, columns: Names | None = None) -> Columns:
    """Nodal results of CalculiX (.frd): ``*NODE FILE`` and ``*EL FILE``, or ``*NODE OUTPUT`` in binary.

    A column is called by the number of the node and the component: ``"17.D3"``; displacements are D1, D2, D3,
    velocities V1.., forces F1.., stresses SXX... A component that two datasets have is called with its dataset:
    ``"17.DISP.D3"``.

    Parameters
    ----------
    columns : names of those that are read; without it all, of all nodes, which takes long where these are many

    Raises
    ------
    CalibError : no results, a file that is cut off, two values at one time (it is written with 6 digits), too large a
        file
    """
    histories = Histories(path)
    request = _Request(None if columns is None else [_parts(path, column) for column in columns])
    for block in nodal_results(path, request.is_node_wanted, request.is_component_wanted):
        for node, row in zip(block.nodes, block.rows, strict=True):
            for component, value in zip(block.components, row, strict=True):
                histories.add(f"{node}.{block.name}.{component}", block.time, float(value), block.line)
    if not request.datasets:
        raise CalibError(
            f"{path}: expected results of *NODE FILE, got none; did the program stop before its first step?"
        )
    keys = {request.short_name(key): key for key in histories.histories}
    if columns is None:
        return histories.as_columns(keys)
    known = {**keys, **{key: key for key in histories.histories}}
    missing = next((column for column in columns if column not in known), None)
    if missing is not None:
        raise CalibError(f"{path}: no column {missing!r}; {request.contents()}")
    return histories.as_columns({column: known[column] for column in columns})


@dataclass
class _Request:
    """Which columns are read (node, dataset or None for any, component), and what the file was seen to hold."""

    wanted: Sequence[tuple[int, str | None, str]] | None
    datasets: dict[str, set[str]] = field(default_factory=lambda: defaultdict(set))  # of each component
    nodes: dict[int, None] = field(default_factory=dict)  # the first of them

    def is_node_wanted(self, node: int) -> bool:
        if len(self.nodes) <= MAX_SHOWN_NAMES:
            self.nodes[node] = None
        return self.wanted is None or any(node == asked for asked, _, _ in self.wanted)

    def is_component_wanted(self, dataset: str, component: str) -> bool:
        self.datasets[component].add(dataset)
        return self.wanted is None or any(
            component == asked and whose in (None, dataset) for _, whose, asked in self.wanted
        )

    def short_name(self, key: str) -> str:
        """Name without the dataset, where one dataset only has the component."""
        node, _, component = key.split(".", 2)
        return f"{node}.{component}" if len(self.datasets[component]) == 1 else key

    def contents(self) -> str:
        """Describe what there is."""
        names = [
            name if len(datasets) == 1 else f"{dataset}.{name}"
            for name, datasets in self.datasets.items()
            for dataset in sorted(datasets)
        ]
        return f"the components are {listed(names)}, and the nodes {listed(map(str, self.nodes))}"


def _parts(path: Path, column: str) -> tuple[int, str | None, str]:
    """Return node, dataset (None where it is not stated) and component of a column's name."""
    node, *rest = column.split(".", 2)
    if not NODE.fullmatch(node) or not rest:
        raise CalibError(f"{path}: expected a column such as '17.D3', node and component, got {column!r}")
    return int(node), rest[0] if len(rest) == 2 else None, rest[-1]
