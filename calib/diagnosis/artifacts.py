"""The files of a diagnosis: its document, and the motions that it compares."""

from collections.abc import Mapping
from pathlib import Path

import netCDF4
import numpy as np
import xarray as xr

from calib.diagnosis.diagnose import Diagnosis
from calib.diagnosis.document import DiagnosisResult
from calib.diagnosis.part import Part
from calib.diagnosis.selection import Selection
from calib.diagnosis.serialise import diagnosis_result
from calib.errors import CalibError
from calib.execution.files import whole
from calib.execution.interrupt import uninterrupted
from calib.objective import Reference, gross_errors
from calib.records.held_response import is_held
from calib.records.response import HELD, HELD_AMPLITUDE
from calib.store.document import read_document, write_document

NAME = "diagnosis.json"
MOTIONS = "diagnosis.nc"


def write(
    diagnosis: Diagnosis, folder: Path, values: Mapping[str, float], references: Mapping[str, Reference]
) -> DiagnosisResult:
    """Write both files of a diagnosis of the calibrated `values`, and return what `read` reads of the first."""
    document = diagnosis_result(diagnosis, values).as_dict()
    write_motions(motions(diagnosis, references), folder)
    write_document(document, folder / NAME)
    return DiagnosisResult.from_dict(document)


def write_motions(views: Mapping[str, xr.Dataset], folder: Path) -> None:
    """Write diagnosis.nc, a group for each record; without records, remove it."""
    if not views:
        (folder / MOTIONS).unlink(missing_ok=True)
        return
    with whole(folder / MOTIONS) as temporary, uninterrupted():
        for index, (name, motion) in enumerate(views.items()):
            motion.to_netcdf(temporary, mode="a" if index else "w", group=name, engine="netcdf4")


def read(folder: Path) -> DiagnosisResult | None:
    """Return the diagnosis in a folder, None where there is none."""
    return read_document(folder / NAME, DiagnosisResult.from_dict, "diagnosis", "calib diagnose")


def read_motions(folder: Path) -> dict[str, xr.Dataset]:
    """Motions of each record as `motions` has them; empty where there are none."""
    path = folder / MOTIONS
    if not path.is_file():
        return {}
    try:
        with uninterrupted():
            with netCDF4.Dataset(path) as file:
                names = list(file.groups)
            return {name: xr.load_dataset(path, group=name, engine="netcdf4", decode_times=False) for name in names}
    except (OSError, ValueError, RuntimeError) as error:
        raise CalibError(f"{path}: not a readable netCDF file ({error}); run `calib diagnose` again") from error


def motions(diagnosis: Diagnosis, references: Mapping[str, Reference]) -> dict[str, xr.Dataset]:
    """The measured and simulated motions of each record, by its name.

    Returns
    -------
    Datasets over (row, time): measured, calibrated and, where there are causes, extended, each row in its unit; weight
    in [0, 1], 0 where a sample is not compared. Over row: sigma and innovation (standard deviations of the noise and of
    its innovation, in the row's unit), memory (row, lag; coefficients of its autoregression), and
    the coordinates body, channel, unit and source (from which sigma is estimated). time [s]. Attributes: cycle (of the
    motion, in periods) and, where the excitation has one, period [s]. Of a frequency response time numbers the points,
    of which frequency [Hz], level, sweep, direction and gross_error (1 of a gross error beside the extended model) are
    coordinates; held_amplitude [m] too where that of a body was held, which the attribute `held` names. Its rows are in
    standard uncertainties.
    """
    if diagnosis.selection is None or diagnosis.evidence is None:
        return {}
    selection = diagnosis.selection
    return {part.name: _motion(part, selection, references[part.name]) for part in diagnosis.evidence.parts}


def _motion(part: Part, selection: Selection, reference: Reference) -> xr.Dataset:
    """The measured and simulated motions of one record."""
    record = reference.compared
    channels = [channel for _, channel in part.rows]
    over = ("row", "time")
    calibrated = selection.null.point.simulated[part.name].rows
    views = {"measured": part.measured, "calibrated": calibrated, "weight": part.weight}
    if selection.causes:
        views["extended"] = selection.final.point.simulated[part.name].rows
    ar = np.zeros((len(part.rows), max([1, *(noise.ar.size for noise in part.noise)])))
    for own, noise in zip(ar, part.noise, strict=True):
        own[: noise.ar.size] = noise.ar
    noises = {
        "sigma": ("row", [noise.sigma for noise in part.noise]),
        "innovation": ("row", [noise.sigma * noise.innovation for noise in part.noise]),
        "memory": (("row", "lag"), ar),
    }
    points = _points(record, selection.final.point.simulated[part.name].trust) if part.is_swept else {}
    return xr.Dataset(
        {name: (over, rows) for name, rows in views.items()} | noises,
        coords=points
        | {
            "time": ("time", part.time, {"units": "1" if part.is_swept else "s"}),
            "body": ("row", [body for body, _ in part.rows]),
            "channel": ("row", channels),
            "unit": ("row", [record[channel].attrs.get("units", "1") for channel in channels]),
            "source": ("row", [part.source_of(noise) for noise in part.noise]),
        },
        attrs={"cycle": part.cycle}
        | ({} if part.period is None else {"period": part.period})
        | ({HELD: record.attrs[HELD]} if part.is_swept and is_held(record) else {}),
    )


def _points(response: xr.Dataset, trust: np.ndarray) -> dict[str, tuple[str, np.ndarray, dict[str, str]]]:
    """What is known of each point of a frequency response, as coordinates over time.

    trust : (n,) in the distance of each point from the response of the extended model
    """
    names = ("frequency", "level", "sweep", "direction", *((HELD_AMPLITUDE,) if is_held(response) else ()))
    known = {name: ("time", response[name].values, dict(response[name].attrs)) for name in names}
    gross = np.isin(np.arange(trust.size), gross_errors(trust)).astype(np.int8)
    return known | {"gross_error": ("time", gross, {"units": "1"})}
