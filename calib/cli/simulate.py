"""One run of a study's simulator at values given by hand."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import click
import xarray as xr

from calib.cycles import kind_of_motion
from calib.errors import CalibError, nearest
from calib.model import Model
from calib.objective import Reference
from calib.parameter import values_for
from calib.pool import REFUSED, Failure, LocalPool
from calib.record import OK, channels, failed, write
from calib.report.figures import simulation_picture
from calib.study_toml import StudyFile, load
from calib.units import shown, to_si


def simulate_once(study: Path, settings: Sequence[str], record: str | None, output: Path) -> bool:
    """Simulate one record of a study, write it to `output` and a picture beside it, and say what came out.

    Returns
    -------
    whether the run ended ok; what went wrong is printed, and kept in the record
    """
    file = load(study)
    reference = _reference(file, record)
    values = file.study.space.fixed | _settings(settings, file.study.model.parameters)
    with LocalPool(partial(_run, file.study.model, reference), 1, file.study.timeout) as pool:
        [(_, simulated)] = pool.map([values_for(values, reference.name)])
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
    return model.run(values, reference.excitation, reference.request)


def _reference(file: StudyFile, name: str | None) -> Reference:
    known = {**file.study.objective.references, **file.others}
    name = name or next(iter(known))
    if name not in known:
        raise CalibError(f"--record: no record {name!r}{nearest(name, known)}; the study has {', '.join(known)}")
    return known[name]


def _settings(settings: Sequence[str], parameters: Mapping) -> dict[str, float]:
    """Read NAME=VALUE texts into SI values."""
    values = {}
    for setting in settings:
        name, equals, text = (part.strip() for part in setting.partition("="))
        if not equals:
            raise CalibError(f"--set: expected NAME=VALUE, got {setting!r}")
        if name not in parameters:
            raise CalibError(
                f"--set: unknown parameter {name!r}{nearest(name, parameters)}; the model has {', '.join(parameters)}"
            )
        try:
            values[name] = to_si(_number(text), parameters[name].unit)
        except CalibError as error:
            raise CalibError(f"--set {name}: {error}") from error
        low, high, unit = (getattr(parameters[name], key) for key in ("low", "high", "unit"))
        if not low <= values[name] <= high:
            raise CalibError(f"--set {name}: expected a value in [{low:g}, {high:g}] {unit}, got {text}")
    return values


def _number(text: str) -> float | str:
    """Take a bare number as one in SI."""
    try:
        return float(text)
    except ValueError:
        return text


def _described(record: xr.Dataset) -> Iterator[str]:
    """Say kind of motion and amplitudes of a simulated record."""
    motion = kind_of_motion(record)
    yield f"kind of motion: {motion.kind} ({motion.evidence})"
    for channel in channels(record):
        values = record[channel]
        half = 0.5 * (values.max("time") - values.min("time"))
        for body in record.body.values:
            yield f"{channel} of {body}: amplitude {shown(float(half.sel(body=body)), values.attrs['units'])}"
