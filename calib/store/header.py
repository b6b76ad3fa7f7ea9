"""The header of a ledger's segment, and what a study opens its ledger with."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from calib.store.environment import Environment
from calib.store.plain import typed


@dataclass(frozen=True)
class StudyHeader:
    """What a store is opened with.

    Attributes
    ----------
    name : of the study
    definition : all that determines its trials, as JSON takes it, with the `windows` of the parameters
    screen : number of points of the screen
    budget : number of trials
    code : module outside calib that the study uses -> digest of its source, or distribution and version
    """

    name: str
    definition: Mapping[str, Any]
    screen: int
    budget: int
    code: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Header:
    """A header line of a ledger, in the order of its keys.

    Attributes
    ----------
    format : version of the ledger's format
    id : of the ledger
    segment : its number, from 0
    name, definition : of the study
    digest : SHA-256 of the definition
    screen : points of the screen
    first : number of the segment's first search trial
    hint : budget when the segment began
    budget : that of the study now
    versions, processor, cpu, blas : see `Environment`; empty where the ledger does not say
    code : see `StudyHeader`; left out of the line where it is empty
    time : when the line was written, in UTC
    further : keys that a later version has written, with their values
    """

    format: int
    id: str
    segment: int
    name: str
    definition: Mapping[str, Any]
    digest: str
    screen: int
    first: int
    hint: int
    budget: int
    versions: Mapping[str, str] = field(default_factory=dict)
    processor: str = ""
    cpu: str = ""
    blas: Mapping[str, str] = field(default_factory=dict)
    code: Mapping[str, str] = field(default_factory=dict)
    time: str = ""
    further: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def from_dict(cls, line: Mapping[str, Any]) -> "Header":
        """Return the header that the object of a line describes.

        Raises
        ------
        ValueError : a key is missing
        """
        own = {key: value for key, value in line.items() if key in HEADER_KEYS}
        return typed(cls, {**own, "further": {key: value for key, value in line.items() if key not in HEADER_KEYS}})

    def as_dict(self) -> dict[str, Any]:
        """Return the object of the line, further keys last."""
        own = {one.name: getattr(self, one.name) for one in fields(self) if one.name != "further"}
        if not self.code:
            del own["code"]
        return {**own, **self.further}

    @property
    def environment(self) -> Environment:
        """The environment in which the segment began."""
        return Environment(self.versions, self.processor, self.cpu, self.blas)

    def within(self, environment: Environment) -> "Header":
        """Return the header of a segment in another environment."""
        return replace(
            self,
            versions=environment.versions,
            processor=environment.processor,
            cpu=environment.cpu,
            blas=environment.blas,
        )


HEADER_KEYS = frozenset(one.name for one in fields(Header)) - {"further"}  # of a line, without its check sum
