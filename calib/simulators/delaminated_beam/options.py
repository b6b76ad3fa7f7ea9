"""Options of the simulator `delaminated_beam`: flat in a study file, here sorted by what they are about."""

import inspect
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Literal, TypeVar

import numpy as np

from calib.errors import CalibError, nearest
from calib.simulators.delaminated_beam.contact import Stiffness
from calib.simulators.delaminated_beam.layout import MAX_LINE_NODES
from calib.simulators.delaminated_beam.mesh import Counts

Fidelity = Literal["reduced", "full", "auto"]


@dataclass(frozen=True)
class ContactOptions:
    """How the contact forces are computed.

    Attributes
    ----------
    contact_stiffness : "bulk" (default), f K l b / t, or "mass_dt", f m / (2 dt^2); see `contact.penalty`
    damper : "semi_implicit" (default): contact damping sees the mean of the velocities before and after a step;
        "lagged": the one before, as the paper's code does, which is unstable for large c_con. Full fidelity only
    clipped : whether the contact force cannot pull
    """

    contact_stiffness: Stiffness = "bulk"
    damper: Literal["semi_implicit", "lagged"] = "semi_implicit"
    clipped: bool = True

    def __post_init__(self) -> None:
        """Refuse what is none of the choices."""
        _check_choice("contact_stiffness", self.contact_stiffness, ("bulk", "mass_dt"))
        _check_choice("damper", self.damper, ("semi_implicit", "lagged"))
        _check_flag("clipped", self.clipped)


@dataclass(frozen=True)
class GeometryOptions:
    """Which part of the beam is modelled, and the shapes of layer and gap.

    Attributes
    ----------
    symmetric : whether the right half is computed, or the whole beam
    layer : "straight" (default), or "arched": its stress-free middle follows the gap's cubics
    shift : "free" (default): s is a parameter, or "tied": s = gap - g_max, and in its place `gap` is one: the gap in
        the middle, nominally 1 mm
    gap_table : [[place, gap], ...] instead of the cubics: places from 0 (or -1) to 1, the end of the delamination, and
        measured gaps [m], between which is interpolated; `s` is added, g_max has no say
    """

    symmetric: bool = True
    layer: Literal["straight", "arched"] = "straight"
    shift: Literal["free", "tied"] = "free"
    gap_table: Sequence[Sequence[float]] | None = None

    def __post_init__(self) -> None:
        """Refuse what is none of the choices, and a table that is none."""
        _check_choice("layer", self.layer, ("straight", "arched"))
        _check_choice("shift", self.shift, ("free", "tied"))
        _check_flag("symmetric", self.symmetric)
        self.measured_gap()

    def measured_gap(self) -> np.ndarray | None:
        """Return `gap_table` as an array (k, 2); None where the gap is that of the cubics.

        Raises
        ------
        CalibError : the table is not one of increasing places
        """
        if self.gap_table is None:
            return None
        try:
            table = np.array(self.gap_table, dtype=float)
        except (TypeError, ValueError):
            table = np.zeros(0)
        if table.ndim != 2 or table.shape[1] != 2 or len(table) < 2 or not np.isfinite(table).all():
            raise CalibError("gap_table is a list of at least two pairs [place, gap]: place in [-1, 1] [1], gap [m]")
        if not (np.diff(table[:, 0]) > 0.0).all():
            raise CalibError("the places of gap_table must increase from pair to pair")
        if table[0, 0] not in (-1.0, 0.0) or table[-1, 0] != 1.0:
            raise CalibError(f"the places of gap_table go from 0 (or -1) to 1, got {table[0, 0]:g} to {table[-1, 0]:g}")
        if table[0, 0] < 0.0 and self.symmetric:
            raise CalibError(
                "a gap_table from -1 to 1 is of the whole beam; set symmetric = false, or give its right half"
            )
        return table


@dataclass(frozen=True)
class MeshOptions:
    """How finely the beam is divided.

    Attributes
    ----------
    masters, slaves, outer, beam_rows, layer_rows : see `mesh.Counts`
    refinement : every element is cut into so many times so many
    """

    masters: int = 56
    slaves: int = 4
    outer: int = 41
    beam_rows: Sequence[float] = (5.0, 2.5)
    layer_rows: Sequence[float] = (1.0,)
    refinement: int = 1

    def __post_init__(self) -> None:
        """Refuse counts and heights that give no mesh."""
        for name in ("masters", "slaves", "outer", "refinement"):
            _check_count(name, getattr(self, name))
        if self.masters % 2:
            raise CalibError(f"masters is even, half of them on each side of the middle; got {self.masters}")
        for name in ("beam_rows", "layer_rows"):
            rows = getattr(self, name)
            if not isinstance(rows, Sequence) or not rows or not all(map(_positive, rows)):
                raise CalibError(f"{name} is a list of positive heights, got {rows!r}")

    @property
    def counts(self) -> Counts:
        """Counts of the refined mesh."""
        own = Counts(self.masters, self.slaves, self.outer, tuple(self.beam_rows), tuple(self.layer_rows))
        return own.refined(self.refinement)


@dataclass(frozen=True)
class SolverOptions:
    """How the motion is integrated, and when that ends.

    Attributes
    ----------
    modes, steps, parts, every : of the reduced kernel, see `reduction.Fineness`; those not given are of its lowest
        level
    tolerance : error of the reduced phase curve that is accepted [1]: modes and steps rise until the estimated error,
        which the record states (`error_estimate`), is below it. Not given: the lowest level, no estimate
    balance : whether the record states, of one period, the work of the drive and what alpha, beta and contact took of
        it [J]; the period takes several times as long. Not in fidelity "reduced"
    settle_limit : periods after which a motion that does not return is taken as it is
    """

    modes: int | None = None
    steps: int | None = None
    parts: int | None = None
    every: int | None = None
    tolerance: float | None = None
    balance: bool = False
    settle_limit: int = 200

    def __post_init__(self) -> None:
        """Refuse numbers that cannot be."""
        for name, value in {**self.fineness, "settle_limit": self.settle_limit}.items():
            _check_count(name, value)
        _check_flag("balance", self.balance)
        if self.tolerance is not None and not _positive(self.tolerance):
            raise CalibError(f"tolerance is above 0, such as 0.01; got {self.tolerance!r}")

    @property
    def fineness(self) -> dict[str, int]:
        """What is stated of `reduction.Fineness`."""
        stated = {"modes": self.modes, "steps": self.steps, "parts": self.parts, "every": self.every}
        return {name: value for name, value in stated.items() if value is not None}


GROUPS = (ContactOptions, GeometryOptions, MeshOptions, SolverOptions)
Group = TypeVar("Group", ContactOptions, GeometryOptions, MeshOptions, SolverOptions)


@dataclass(frozen=True)
class BeamOptions:
    """All options of the simulator: which kernel runs, and the groups of the others.

    Attributes
    ----------
    fidelity : "reduced" (default), "full" or "auto"
    """

    fidelity: Fidelity = "reduced"
    contact: ContactOptions = field(default_factory=ContactOptions)
    geometry: GeometryOptions = field(default_factory=GeometryOptions)
    mesh: MeshOptions = field(default_factory=MeshOptions)
    solver: SolverOptions = field(default_factory=SolverOptions)

    @classmethod
    def of(cls, fidelity: Fidelity, options: Mapping[str, Any]) -> "BeamOptions":
        """Sort flat options.

        Raises
        ------
        CalibError : an option that is unknown, cannot be, or does not go with another
        """
        known = list(SIGNATURE.parameters)
        for name in options:
            if name not in known:
                raise CalibError(
                    f"unknown option {name!r} of 'delaminated_beam'{nearest(name, known)}; it takes {', '.join(known)}"
                )
        return cls(
            fidelity,
            contact=_of_group(ContactOptions, options),
            geometry=_of_group(GeometryOptions, options),
            mesh=_of_group(MeshOptions, options),
            solver=_of_group(SolverOptions, options),
        )

    def __post_init__(self) -> None:
        """Refuse options that do not go together."""
        _check_choice("fidelity", self.fidelity, ("reduced", "full", "auto"))
        if self.contact.damper == "lagged" and self.fidelity != "full":
            raise CalibError(
                "the reduced kernel takes contact damping implicitly; damper 'lagged' needs fidelity 'full', "
                f"not {self.fidelity!r}"
            )
        if self.solver.balance and self.fidelity == "reduced":
            raise CalibError("an energy balance is of the full kernel; take fidelity 'full' or 'auto', or drop balance")
        if self.solver.every is not None and self.half_pairs % self.solver.every:
            raise CalibError(
                f"every divides the {self.half_pairs} elements of half the layer; {self.solver.every} does not"
            )
        line = (self.half_pairs + self.mesh.counts.outer) * (1 if self.geometry.symmetric else 2) + 1
        if self.fidelity != "reduced" and line > MAX_LINE_NODES:
            raise CalibError(
                f"a line of {line} nodes along the layer; fidelity {self.fidelity!r} takes {MAX_LINE_NODES} at most: "
                "lower refinement, masters, slaves or outer, or set symmetric = true"
            )

    @property
    def half_pairs(self) -> int:
        """Elements along half of the layer."""
        counts = self.mesh.counts
        return counts.masters // 2 * counts.slaves


def _of_group(group: type[Group], options: Mapping[str, Any]) -> Group:
    return group(**{option.name: options[option.name] for option in fields(group) if option.name in options})


def _signature() -> inspect.Signature:
    """Return the flat options as keywords with their defaults."""
    own = [option for option in fields(BeamOptions) if option.name == "fidelity"]
    flat = [option for group in GROUPS for option in fields(group)]
    return inspect.Signature(
        [
            inspect.Parameter(option.name, kind, default=option.default, annotation=option.type)
            for options, kind in (
                (own, inspect.Parameter.POSITIONAL_OR_KEYWORD),
                (flat, inspect.Parameter.KEYWORD_ONLY),
            )
            for option in options
        ]
    )


SIGNATURE = _signature()


def described() -> str:
    """List all options as the docstrings of their groups describe them."""
    texts = [(inspect.getdoc(group) or "").partition(f"{'-' * 10}\n")[2] for group in (BeamOptions, *GROUPS)]
    return "\n".join(text.strip() for text in texts)


def _check_choice(name: str, value: str, known: Sequence[str]) -> None:
    if value not in known:
        raise CalibError(f"unknown {name} {value!r}{nearest(str(value), known)}; there are {', '.join(known)}")


def _check_count(name: str, value: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise CalibError(f"{name} is a whole number from 1 on, got {value!r}")


def _check_flag(name: str, value: bool) -> None:
    if not isinstance(value, bool):
        raise CalibError(f"{name} is true or false, got {value!r}")


def _positive(value: object) -> bool:
    """Whether it is a number above 0."""
    return isinstance(value, int | float) and not isinstance(value, bool) and 0.0 < value < math.inf
