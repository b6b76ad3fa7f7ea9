"""One run of a study's simulator at values given by hand."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import click
import xarray as xr

from calib.cli.given import settings
from calib.errors import CalibError
from calib.execution.pool import REFUSED, Failure
from calib.execution.pools.settings import PoolSettings
from calib.execution.workers import workers
from calib.modelling.model import Model
from calib.modelling.parameter import values_for
from calib.objective import INITIAL_STATE, Objective, Reference
from calib.records import OK, channels, failed, write
from calib.records.cycles import kind_of_motion
from calib.report.plots.motion import simulation_picture
from calib.study import simulated
from calib.study_file import load
from calib.units import shown


def simulate_once(study: Path, given: Sequence[str], record: str | None, output: Path) -> bool:
    """Simulate one record of a study, write it to `output` and a picture beside it, and say what came out.

    Returns
    -------
    whether the run ended ok; what went wrong is printed, and kept in the record
    """
    file = load(study)
    chosen = file.reference(record)
    model, own = file.study.model, settings(given, file.study.model.parameters)
    values = values_for(file.study.space.fixed, chosen.name) | own
    objective = file.study.objective.on({chosen.name: _unless_given(chosen, model, own)})
    with workers(partial(_run, model, objective, chosen.name), PoolSettings(), file.study.timeout) as pool:
        [(_, answer)] = pool.map([values])
    if isinstance(answer, Failure) and answer.status == REFUSED:
        raise CalibError(answer.reason)
    run = failed(model.bodies, answer.status, answer.reason) if isinstance(answer, Failure) else answer
    if output.parent != Path():
        output.parent.mkdir(parents=True, exist_ok=True)
    write(run, output)
    click.echo(f"{output}: {run.attrs['status']}")
    if run.attrs["status"] != OK:
        click.echo(f"reason: {run.attrs.get('reason', 'not stated')}")
        return False
    picture = output.with_suffix(".png")
    simulation_picture(run, picture)
    for line in _described(run):
        click.echo(line)
    click.echo(f"picture: {picture}")
    return True


def _run(model: Model, objective: Objective, name: str, values: Mapping[str, float]) -> xr.Dataset:
    return simulated(model, objective, name, values)


def _unless_given(reference: Reference, model: Model, given: Mapping[str, float]) -> Reference:
    """Return the reference with its initial state as it is given, where a part of it is."""
    if not set(given) & set(model.initial):
        return reference
    return replace(reference, nuisance=[name for name in reference.nuisance if name != INITIAL_STATE])


def _described(record: xr.Dataset) -> Iterator[str]:
    """Say kind of motion and amplitudes of a simulated record."""
    motion = kind_of_motion(record)
    if "source" in record.attrs:
        yield f"made by: {record.attrs['source']}"
    yield f"kind of motion: {motion.kind} ({motion.evidence})"
    for channel in channels(record):
        values = record[channel]
        half = 0.5 * (values.max("time") - values.min("time"))
        for body in record.body.values:
            yield f"{channel} of {body}: amplitude {shown(float(half.sel(body=body)), values.attrs['units'])}"
