"""Scale, shear and offset of a record as parameters of the model, so that they are sampled and not solved for.

Solved nuisances have their best value at each point of the other parameters: of a linear model with normal noise the
marginal likelihood is the same function of these, up to a constant factor. What is known of a nuisance beforehand, such
as how sure a digitised figure's axes are, counts where it is sampled only. The trigger stays solved: any is as likely.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import xarray as xr

from calib.confidence.prior import Prior
from calib.errors import CalibError
from calib.modelling.effect import Effect
from calib.modelling.laws import sensor
from calib.modelling.parameter import Parameter, Space, Window
from calib.objective import Objective, Reference
from calib.records import STATE, nuisance_sigma, with_channels
from calib.study import CalibrationStudy

SAMPLED_KINDS = ("scale", "shear", "offset")  # nuisances that are sampled where a record names them
NUISANCE_REACH = 5.0  # of the window of a nuisance, in standard uncertainties  [1]
FREE_SCALE_REACH = 0.2  # of the window of a scale of which nothing is known  [1]
FREE_SHEAR_REACH = 0.2  # of the window of such a shear, over displacement per velocity  [1]
FREE_OFFSET_REACH = 0.5  # of the window of such an offset, over the standard deviation of the displacement  [1]
PREFIX = "instrument"


@dataclass(frozen=True)
class SampledNuisance:
    """A nuisance of a record as a parameter.

    Attributes
    ----------
    name : of the parameter, with that of the record behind an @
    null : value at which the instrument is right
    window : in which it is sampled
    prior : what is known of it; None: it is equally likely everywhere in the window
    """

    name: str
    null: float
    window: Window
    prior: Prior | None


@sensor
def _read(record: xr.Dataset, p: Mapping[str, float]) -> xr.Dataset:
    """Return a simulated record as an instrument shows it: scale x + shear v + offset, and scale v."""
    changed = {}
    for channel in STATE:
        if channel in record:
            values = p[f"{PREFIX}_scale_{channel}"] * record[channel].values
            if channel == "displacement":
                offsets = [p.get(f"{PREFIX}_offset_{body}", 0.0) for body in record.body.values]
                values = values + xr.DataArray(offsets, dims="body").values[:, None]
                if "velocity" in record:
                    values = values + p[f"{PREFIX}_shear"] * record["velocity"].values
            changed[channel] = values
    return with_channels(record, changed)


def instrument(bodies: Sequence[str]) -> Effect:
    """Effect of an instrument with scales, shear and an offset of each of these bodies."""
    parameters = [Parameter(f"{PREFIX}_scale_{c}", "1", 1.0, f"scale of the {c}", null=1.0) for c in STATE]
    parameters.append(Parameter(f"{PREFIX}_shear", "s", 0.0, "displacement per velocity", null=0.0))
    parameters += [Parameter(f"{PREFIX}_offset_{b}", "m", 0.0, f"zero of the displacement of {b}", null=0.0)
                   for b in bodies]  # fmt: skip
    return Effect(
        name=PREFIX, site="sensor", law=_read, parameters=tuple(parameters),
        meaning="scale, shear and zero of the record's axes",
    )  # fmt: skip


def nuisances_of(reference: Reference) -> list[SampledNuisance]:
    """Nuisances of a record that can be sampled: it names them, or states how uncertain they are."""
    record, named = reference.record, [kind for kind in reference.nuisance if kind in SAMPLED_KINDS]
    sigmas = {key: sigma for key, sigma in nuisance_sigma(record).items() if sigma > 0.0}
    bodies = [str(body) for body in record.body.values]
    spread = {c: float(record[c].std()) for c in STATE if c in record}
    free = {f"scale.{c}": (1.0, FREE_SCALE_REACH) for c in spread}
    if set(STATE) <= set(spread) and spread["velocity"] > 0.0:
        free["shear"] = (0.0, FREE_SHEAR_REACH * spread["displacement"] / spread["velocity"])
    if "displacement" in spread:
        free |= {f"offset.{body}": (0.0, FREE_OFFSET_REACH * spread["displacement"]) for body in bodies}
    found = []
    for key, (null, reach) in free.items():
        if key not in sigmas and key.partition(".")[0] not in named:
            continue
        prior = Prior("normal", null, sigmas[key]) if key in sigmas else None
        half = NUISANCE_REACH * sigmas[key] if key in sigmas else reach
        name = f"{PREFIX}_{key.replace('.', '_')}@{reference.name}"
        found.append(SampledNuisance(name, null, Window(null - half, null + half), prior))
    return found


def with_sampled_nuisances(
    study: CalibrationStudy, priors: Mapping[str, Prior]
) -> tuple[CalibrationStudy, dict[str, Prior], dict[str, float]]:
    """Return a study whose calibrated records have their nuisances as parameters, their priors, and their null values.

    Raises
    ------
    CalibError : no record has any
    """
    references = study.objective.references
    own = {name: nuisances_of(references[name]) for name in study.objective.scored}
    sampled = [one for several in own.values() for one in several]
    if not sampled:
        raise CalibError(
            "there is no nuisance to sample: expected a calibrated record that names scale, shear or offset as "
            "nuisance, or a digitised one that states how uncertain these are (attribute nuisance_sigma)"
        )
    kept = {
        name: replace(one, nuisance=tuple(n for n in one.nuisance if n not in SAMPLED_KINDS)) if own.get(name) else one
        for name, one in references.items()
    }
    windows = {one.name: one.window for one in sampled}
    extended = replace(
        study,
        model=study.model.extended(instrument(study.model.bodies)),
        space=Space({**study.space.windows, **windows}, study.space.fixed),
        objective=Objective(kept, study.objective.terms, study.objective.elsewhere),
        definition={**study.definition, "sampled nuisances": {n: [w.low, w.high] for n, w in windows.items()}},
    )
    known = {one.name: one.prior for one in sampled if one.prior is not None}
    return extended, {**priors, **known}, {one.name: one.null for one in sampled}


def unused_uncertainties(study: CalibrationStudy) -> list[str]:
    """Say which calibrated records state how uncertain their axes are, where their nuisances are not sampled."""
    names = [
        name
        for name in study.objective.scored
        if any(one.prior is not None for one in nuisances_of(study.objective.references[name]))
    ]
    if not names:
        return []
    return [
        f"{', '.join(names)}: the record states how uncertain its scale, shear or offset is, which the posterior "
        "distribution does not take into account; --sample-nuisances does"
    ]
