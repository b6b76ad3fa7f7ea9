"""The mesh of a beam with a delaminated layer: strips of quadrilaterals between lines of nodes."""

from dataclasses import dataclass

import numpy as np

MAX_ROUNDING = 1e-12  # m, of a place that is zero


@dataclass(frozen=True)
class Counts:
    """How finely the beam is divided.

    Attributes
    ----------
    masters : elements along the whole delamination on the side of the remaining beam; even
    slaves : elements of the layer to each of them
    outer : elements along each of the two parts beside the delamination
    beam_rows : heights of the remaining beam's rows from below; only their ratios matter
    layer_rows : the same of the layer
    """

    masters: int = 56
    slaves: int = 4
    outer: int = 41
    beam_rows: tuple[float, ...] = (5.0, 2.5)
    layer_rows: tuple[float, ...] = (1.0,)

    def refined(self, times: int) -> "Counts":
        """Return the same with every element cut into times x times."""
        return Counts(
            masters=times * self.masters,
            slaves=self.slaves,
            outer=times * self.outer,
            beam_rows=tuple(np.repeat(self.beam_rows, times).tolist()),
            layer_rows=tuple(np.repeat(self.layer_rows, times).tolist()),
        )


@dataclass(frozen=True)
class Geometry:
    """Shape of the beam; the delamination is in its middle, the layer on top.

    Attributes
    ----------
    length, delamination : of the beam and of its delaminated part  [m]
    beam_thickness, layer_thickness : of the remaining beam and of the layer  [m]
    arch : height of the stress-free layer's middle above that of a straight one  [m]
    support : distance of the supports from the middle of the beam  [m]
    """

    length: float
    delamination: float
    beam_thickness: float
    layer_thickness: float
    arch: float
    support: float


@dataclass(frozen=True, eq=False)
class Mesh:
    """Nodes and the strips of quadrilaterals between them; x = 0 is the middle of the beam, y = 0 its lower side.

    The lines of the remaining beam come first, from below; then those of the upper strips. The first of these has its
    nodes beside the delamination in common with the last line of the beam. Element j of a strip lies right of the
    nodes j of its two lines.

    Attributes
    ----------
    nodes : (n, 2) positions  [m]
    lines : node numbers of each line, from left to right
    strips : number of the lower line of each strip; the upper one is the next
    interface : number of the last line of the beam; the first line of the layer is the next
    first, last : indices along a layer line of the delamination's ends; on the right half `first` is its middle. Along
        a beam line the delamination begins at `first` too
    ratio : slaves to a master
    driven : upper node in the middle of the remaining beam
    supports : nodes at mid-height that are held in y
    symmetric : whether it is the right half, held in x at x = 0
    half_delamination : [m]
    """

    nodes: np.ndarray
    lines: tuple[np.ndarray, ...]
    strips: tuple[int, ...]
    interface: int
    first: int
    last: int
    ratio: int
    driven: int
    supports: np.ndarray
    symmetric: bool
    half_delamination: float

    @property
    def slaves(self) -> np.ndarray:
        """Nodes on the lower side of the layer, the ends of the delamination included."""
        return self.lines[self.interface + 1][self.first : self.last + 1]

    @property
    def masters(self) -> np.ndarray:
        """Nodes on the upper side of the remaining beam, the ends of the delamination included."""
        return self.lines[self.interface][self.first : self.first + (self.last - self.first) // self.ratio + 1]

    @property
    def place(self) -> np.ndarray:
        """Place of the slaves along the delamination, -1 and 1 its ends  [1]."""
        return np.linspace(0.0 if self.symmetric else -1.0, 1.0, self.slaves.size)

    @property
    def neighbours(self) -> tuple[list[int], list[int]]:
        """Strips below and above each line; -1 where there is none."""
        strips, lines = list(self.strips), range(len(self.lines))
        below = [strips.index(k - 1) if k - 1 in strips else -1 for k in lines]
        return below, [strips.index(k) if k in strips else -1 for k in lines]

    @property
    def held(self) -> np.ndarray:
        """Freedoms that do not move: twice the node's number for x, and one more for y."""
        middle = np.flatnonzero(on_symmetry_plane(self.nodes)) if self.symmetric else [self.driven]
        return np.array([*(2 * self.supports + 1), *(2 * node for node in middle)])

    @property
    def freedoms(self) -> int:
        """How many neither are held nor follow the drive."""
        return 2 * len(self.nodes) - len(self.held) - 1

    @property
    def layer(self) -> np.ndarray:
        """Nodes of the layer but for those that it shares with the parts beside the delamination."""
        inner = slice(self.first + (not self.symmetric), self.last)
        return np.concatenate([line[inner] for line in self.lines[self.interface + 1 :]])

    def quadrilaterals(self, strip: int) -> np.ndarray:
        """Nodes (m, 4) of the elements over line `strip`: lower left, lower right, upper right, upper left."""
        a, b = self.lines[strip], self.lines[strip + 1]
        return np.stack([a[:-1], a[1:], b[1:], b[:-1]], axis=1)


def on_symmetry_plane(nodes: np.ndarray) -> np.ndarray:
    """Whether each of the nodes (n, 2) [m] lies in the middle of the beam."""
    return np.abs(nodes[:, 0]) < MAX_ROUNDING


def smooth_step(z: np.ndarray) -> np.ndarray:
    """Cubic with horizontal tangents, 1 in the middle (z = 0) and 0 at the ends (z = 1 and -1)  [1].

    Source: paper, Fig. 8.
    """
    z = np.abs(z)
    return 1.0 - 3.0 * z**2 + 2.0 * z**3


def mesh(geometry: Geometry, counts: Counts, symmetric: bool = True) -> Mesh:
    """Mesh the beam, or its right half.

    Raises
    ------
    ValueError : a shape that is none
    """
    _check(geometry)
    masters, slaves = counts.masters // 2, counts.masters // 2 * counts.slaves  # of a half
    first = 0 if symmetric else counts.outer
    last = first + (slaves if symmetric else 2 * slaves)
    heights = _levels(0.0, geometry.beam_thickness, counts.beam_rows)
    positions, lines = _beam_lines(_columns(geometry, masters, counts.outer, symmetric), heights)
    interface = len(lines) - 1
    heights = _levels(geometry.beam_thickness, geometry.layer_thickness, counts.layer_rows)
    columns = _columns(geometry, slaves, counts.outer, symmetric)
    upper = _layer_lines(geometry, columns, heights, lines[interface], slice(first + (not symmetric), last))
    nodes, lines = np.concatenate([*positions, *upper[0]]), lines + upper[1]
    middle = 0.5 * (geometry.beam_thickness + geometry.layer_thickness)
    sides = (1.0,) if symmetric else (-1.0, 1.0)
    return Mesh(
        nodes=nodes,
        lines=tuple(lines),
        strips=tuple(k for k in range(len(lines) - 1) if k != interface),
        interface=interface,
        first=first,
        last=last,
        ratio=counts.slaves,
        driven=int(lines[interface][0 if symmetric else counts.outer + masters]),
        supports=np.array([_nearest(nodes, lines, side * geometry.support, middle) for side in sides]),
        symmetric=symmetric,
        half_delamination=0.5 * geometry.delamination,
    )


def _check(geometry: Geometry) -> None:
    """Refuse a shape that is none."""
    half, a = 0.5 * geometry.length, 0.5 * geometry.delamination
    if not 0.0 < a < half:
        raise ValueError(
            f"a delamination of {geometry.delamination:g} m does not lie inside a beam of {geometry.length:g} m; mend "
            "delamination or length"
        )
    if not a < geometry.support < half:
        raise ValueError(
            f"supports {geometry.support:g} m from the middle do not lie between delamination ({a:g} m) and end "
            f"({half:g} m); mend support"
        )


def _columns(geometry: Geometry, within: int, beyond: int, symmetric: bool) -> np.ndarray:
    """Places along the beam of the nodes of a line: so many elements within half the delamination, so many beyond."""
    half, a = 0.5 * geometry.length, 0.5 * geometry.delamination
    x = np.concatenate([np.linspace(0.0, a, within + 1), np.linspace(a, half, beyond + 1)[1:]])
    return x if symmetric else np.concatenate([-x[:0:-1], x])


def _levels(low: float, thickness: float, rows: tuple[float, ...]) -> np.ndarray:
    """Heights of the lines of a body that begins at `low`  [m]."""
    return low + thickness * np.concatenate([[0.0], np.cumsum(rows) / np.sum(rows)])


def _beam_lines(columns: np.ndarray, heights: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Positions (k, 2) [m] and numbers (k,) of the nodes of each line of the remaining beam."""
    positions = [np.column_stack([columns, np.full(len(columns), y)]) for y in heights]
    return positions, [len(columns) * k + np.arange(len(columns)) for k in range(len(heights))]


def _layer_lines(
    geometry: Geometry, columns: np.ndarray, heights: np.ndarray, interface: np.ndarray, inner: slice
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Positions (k, 2) [m] of the own nodes of each line of the upper strips, and the numbers of all its nodes.

    interface : nodes of the last line of the beam, of which the first line of the layer takes those beside `inner`
    """
    half = 0.5 * geometry.delamination
    rise, slope = _arch(columns / half, geometry.arch, half)
    middle = geometry.beam_thickness + 0.5 * geometry.layer_thickness
    positions, lines, number = [], [], int(interface[-1]) + 1
    for k, y in enumerate(heights):
        off = (y - middle) / np.sqrt(1.0 + slope**2)  # along the normal of the arch
        line = np.column_stack([columns - off * slope, middle + rise + off])
        own = line if k else line[inner]
        nodes = number + np.arange(len(own))
        if k == 0:
            nodes = np.concatenate([interface[: inner.start], nodes, interface[inner.stop - len(columns) :]])
        number += len(own)
        lines.append(nodes)
        positions.append(own)
    return positions, lines


def _arch(z: np.ndarray, height: float, half: float) -> tuple[np.ndarray, np.ndarray]:
    """Height [m] and slope [1] of the arch at the places z (1 is the end of the delamination, beyond it is flat)."""
    z = np.clip(z, -1.0, 1.0)
    return height * smooth_step(z), height / half * np.sign(z) * (-6.0 * np.abs(z) + 6.0 * z**2)


def _nearest(nodes: np.ndarray, lines: list[np.ndarray], x: float, y: float) -> int:
    """Node nearest to (x, y) at the height nearest to y, beside the delamination."""
    line = min(lines, key=lambda numbers: abs(nodes[numbers[-1], 1] - y))
    return int(line[np.argmin(np.abs(nodes[line, 0] - x))])
