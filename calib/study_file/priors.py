"""Priors of a study file: what [confidence.priors] says of searched parameters."""

from collections.abc import Mapping

from calib.confidence.prior import Prior
from calib.errors import CalibError, nearest
from calib.modelling.model import Model
from calib.modelling.parameter import Space
from calib.study_file.mistakes import Mistakes
from calib.study_file.schema import PriorTable
from calib.units import to_si

KEY = ("confidence", "priors")
CENTRES = {"normal": "mean", "lognormal": "median"}  # kind of distribution -> key of its centre


def read_priors(tables: Mapping[str, PriorTable], space: Space, model: Model, mistakes: Mistakes) -> dict[str, Prior]:
    """Priors by the name of their parameter; mistakes are noted, each with its key."""
    priors = {}
    for name, table in tables.items():
        with mistakes.at(*KEY, name):
            if name not in space.names:
                raise CalibError(
                    f"no parameter {name!r} is searched{nearest(name, space.names)}; those are {', '.join(space.names)}"
                )
            prior = _prior(table, model.parameters[name.partition("@")[0]].unit)
            prior.check(space.windows[name])
            priors[name] = prior
    return priors


def _prior(table: PriorTable, unit: str) -> Prior:
    wanted = CENTRES[table.kind]
    stated = {"mean": table.mean, "median": table.median}
    centre = stated.pop(wanted)
    if centre is None or any(other is not None for other in stated.values()):
        raise CalibError(f"a {table.kind} prior takes the keys {wanted} and standard_deviation")
    return Prior(
        table.kind,
        to_si(centre, unit),
        to_si(table.standard_deviation, unit if table.kind == "normal" else "1"),
    )
