"""One run of a study's simulator at values given by hand."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import click
import xarray as xr

from calib.cli.given import settings
from calib.cycles import kind_of_motion
from calib.dynamics.stationary import stationary_record
from calib.errors import CalibError
from calib.model import Model
from calib.objective import Reference
from calib.parameter import values_for
from calib.pool import REFUSED, Failure, LocalPool
from calib.record import OK, channels, failed, write
from calib.report.figures import simulation_picture
from calib.study_toml import load
from calib.units import shown


def simulate_once(study: Path, given: Sequence[str], record: str | None, output: Path) -> bool:
    """Simulate one record of a study, write it to `output` and a picture beside it, and say what came out.

    Returns
    -------
    whether the run ended ok; what went wrong is printed, and kept in the record
    """
    file = load(study)
    chosen = file.reference(record)
    values = values_for(file.study.space.fixed, chosen.name) | settings(given, file.study.model.parameters)
    with LocalPool(partial(_run, file.study.model, chosen), 1, file.study.timeout) as pool:
        [(_, simulated)] = pool.map([values])
    if isinstance(simulated, Failure) and simulated.status == REFUSED:
        raise CalibError(simulated.reason)
    if isinstance(simulated, Failure):
        simulated = failed(file.study.model.bodies, simulated.status, simulated.reason)
    if output.parent != Path():
        output.parent.mkdir(parents=True, exist_ok=True)
    write(simulated, output)
    click.echo(f"{output}: {simulated.attrs['status']}")
    if simulated.attrs["status"] != OK:
        click.echo(f"reason: {simulated.attrs.get('reason', 'not said')}")
        return False
    picture = output.with_suffix(".png")
    simulation_picture(simulated, picture)
    for line in _described(simulated):
        click.echo(line)
    click.echo(f"picture: {picture}")
    return True


def _run(model: Model, reference: Reference, values: Mapping[str, float]) -> xr.Dataset:
    return stationary_record(model, values, reference.excitation, reference.request)


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
