"""Effect: a named physical or instrumental cause, absent at its null value."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calib.errors import CalibError
from calib.laws import PARAMETERS, SITES, BoundLaw, Law
from calib.parameter import Parameter

ALL = None  # bodies: whatever the simulator has


@dataclass(frozen=True)
class Effect:
    """A law at a site with the parameters it takes, in their order.

    At the null values of its parameters the record is bit-identical to the one without the effect, because the law is
    dropped before the run.
    """

    name: str
    site: str
    law: Law
    parameters: tuple[Parameter, ...]
    meaning: str
    bodies: tuple[str, ...] | None = ALL
    cite: str = ""

    def __post_init__(self):
        if self.site not in SITES:
            raise CalibError(f"effect {self.name!r} acts at {self.site!r}; sites are {', '.join(SITES)}")
        if self.law.site != self.site:
            raise CalibError(f"effect {self.name!r} acts at {self.site!r}, but its law is one of {self.law.site!r}")
        if len(self.parameters) > PARAMETERS:
            raise CalibError(f"effect {self.name!r} has {len(self.parameters)} parameters; a law takes {PARAMETERS}")
        if all(p.null is None for p in self.parameters):
            raise CalibError(f"effect {self.name!r} has no null value; give one of its parameters a null")

    @property
    def null(self) -> dict[str, float]:
        """Values of its parameters at which the effect is absent."""
        return {p.name: p.null for p in self.parameters if p.null is not None}

    def at_null(self, values: Mapping[str, float]) -> bool:
        """Whether the effect is absent at these values."""
        return all(values[name] == null for name, null in self.null.items())

    def bound(self, values: Mapping[str, float]) -> BoundLaw:
        """Return the law with its numbers taken from `values`."""
        p = np.zeros(PARAMETERS)
        p[: len(self.parameters)] = [values[q.name] for q in self.parameters]
        return BoundLaw(self.site, self.law.function, p, self.bodies, self.law.states)

    def sense(self, record, values: Mapping[str, float]):
        """Return what the instruments make of `record` (site `sensor`)."""
        return self.law.function(record, {q.name: values[q.name] for q in self.parameters})
