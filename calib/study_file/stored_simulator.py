"""What stands for the simulator of a study where only its results are shown."""

import math
from collections.abc import Mapping, Sequence

import xarray as xr

from calib.errors import CalibError
from calib.modelling.laws import BoundLaw
from calib.modelling.parameter import Parameter
from calib.modelling.simulator import Request
from calib.records.excitation import Excitation
from calib.study.result import ModelSummary


class StoredSimulator:
    """A model as its result describes it, effects included; it has parameters and bodies, and does not run.

    Parameters
    ----------
    summary : of result.json
    """

    sites = frozenset[str]()

    def __init__(self, summary: ModelSummary):
        self.name = summary.name
        self.bodies = tuple(summary.bodies)
        self.parameters = tuple(
            Parameter(name, one.unit, math.inf if one.nominal is None else one.nominal, one.meaning)
            for name, one in summary.parameters.items()
        )
        self.initial: Mapping[str, tuple[str, str]] = {
            name: (body, channel) for name, (body, channel) in summary.initial.items()
        }
        self.incidental = frozenset(summary.incidental)

    def run(
        self, values: Mapping[str, float], excitation: Excitation, laws: Sequence[BoundLaw], request: Request
    ) -> xr.Dataset:
        """Refuse to run.

        Raises
        ------
        CalibError : always
        """
        raise CalibError(f"simulator {self.name!r} was read from a result, which does not simulate")
