"""The records of a study file, each with its excitation and with what is computed of it."""

import os
from dataclasses import replace
from pathlib import Path
from typing import cast

import xarray as xr

from calib.errors import CalibError, nearest
from calib.execution.files import checksum, verified
from calib.modelling.model import Model
from calib.modelling.simulator import Request, Simulator
from calib.objective import Reference
from calib.records import is_response, read, rename_bodies
from calib.records.excitation import Excitation, Quantity, unit_of
from calib.records.held_response import at_one_level
from calib.records.response import HELD
from calib.records.response_table import SUFFIXES as RESPONSE_SUFFIXES
from calib.records.response_table import has_frequencies, read_response
from calib.study import check_solvable
from calib.study_file.columns import checked_drive, stated_level, stated_record
from calib.study_file.ignored import check_ignored
from calib.study_file.mistakes import Mistakes
from calib.study_file.schema import ExcitationTable, RecordTable, StudyToml
from calib.units import to_si

REQUEST_KEYS = ("periods", "samples", "settle", "step_budget")  # keys of [study] that a [[record]] may have for itself
USUAL_PERIODIC_SAMPLES = 10.0  # samples a period, that most records have at least
MIN_PERIODIC_SAMPLES = 3.0  # samples a period, of a periodic excitation; Nyquist's limit is 2


def references(shape: StudyToml, model: Model | None, mistakes: Mistakes) -> dict[str, Reference | None]:
    """Read every [[record]]; what is wrong is noted, and leaves None."""
    known: dict[str, Reference | None] = {}
    for index, entry in enumerate(shape.record):
        if mistakes.within("record", index):
            known[entry.name] = None
            continue
        if entry.name in known:
            mistakes.add(("record", index, "name"), f"a second record {entry.name!r}; give each its own name")
            continue
        with mistakes.at("record", index):
            known[entry.name] = _reference(shape, index, entry, model, mistakes)
    if model is not None:
        check_ignored(known, model.simulator, mistakes)
    if not mistakes.within("record") and not any(entry.use == "calibrate" for entry in shape.record):
        mistakes.add(("record",), 'no record to calibrate on; set use = "calibrate" for one of them at least')
    return known


def _reference(
    shape: StudyToml, index: int, entry: RecordTable, model: Model | None, mistakes: Mistakes
) -> Reference | None:
    key = ("record", index)
    record, excitation = None, None
    drive = None if entry.table is None else checked_drive(entry.table, entry.excitation, key, mistakes)
    readable = not mistakes.within(*key)
    with mistakes.at(*key, "path"):
        file = _file(entry, mistakes.path.parent)
        if entry.table is None:
            record = _read(file, entry.excitation)
        elif readable:
            record, excitation = stated_record(entry.table, entry.excitation, drive, file, key, mistakes)
    if record is None:
        return None
    if entry.bodies is not None:
        with mistakes.at(*key, "bodies"):
            record = rename_bodies(record, entry.bodies, entry.name)
    with mistakes.at(*key, "excitation", "held"):
        record = _held(record, entry.excitation)
    with mistakes.at(*key, "excitation"):
        if excitation is None:
            of = _response_excitation if is_response(record) else _excitation
            excitation = of(entry.excitation, record)
        elif entry.excitation is not None and entry.excitation.frequency is not None:  # a recorded input with a period
            excitation = replace(excitation, frequency=to_si(entry.excitation.frequency, "Hz"))
    if model is not None:
        with mistakes.at(*key, "bodies"):
            _check_bodies(record, model, mistakes.from_python)
        with mistakes.at(*key, "excitation"):
            _check_excitation(excitation, model.simulator)
            if model.confirming is not None:
                _check_excitation(excitation, model.confirming.simulator)
    if excitation is None:
        return None
    with mistakes.at(*key, "excitation", "frequency"):
        _check_sampling(record, excitation)
    if mistakes.within(*key, "excitation", "frequency"):
        return None
    request = _request(shape, entry, excitation, record)
    if model is not None and not mistakes.within(*key, "excitation"):
        with mistakes.at(*key, "excitation"):
            _check_taken(excitation, request, model.simulator)
    with mistakes.at(*key, "nuisance"):
        reference = Reference(
            name=entry.name,
            record=record,
            use=entry.use,
            nuisance=_nuisance(entry, record),
            excitation=excitation,
            request=request,
        )
        if model is not None:
            check_solvable(model, reference)
        return reference
    return None


def _read(file: Path, how: ExcitationTable | None) -> xr.Dataset:
    """Read a record, a response with the level that [record.excitation] states where its file has none."""
    if file.suffix.lower() not in RESPONSE_SUFFIXES or not has_frequencies(file):
        return read(file)
    return read_response(file, None if how is None else stated_level(how))


def _response_excitation(how: ExcitationTable | None, record: xr.Dataset) -> Excitation:
    """Excitation of a response: of its place and quantity as stated, its first frequency and level."""
    place = record.attrs.get("place", "") if how is None or how.place is None else how.place
    quantity = record.attrs.get("quantity", "") if how is None else how.quantity
    if not place or not quantity:
        raise CalibError(
            "the response does not say where and by what its bodies are driven; state place and quantity in "
            "[record.excitation], or as comments of the file: '# place: mass', '# quantity: force'"
        )
    if how is not None and how.frequency is not None:
        raise CalibError("the frequencies are those of the response; drop the key frequency")
    unit, stated = unit_of(quantity), str(record["level"].attrs["units"])
    if stated != unit:
        raise CalibError(f"the level is in {stated}, but an excitation by {quantity} is in {unit}; mend one of the two")
    return Excitation(
        place, cast(Quantity, quantity), frequency=float(record["frequency"][0]), amplitude=float(record["level"][0])
    )


def _held(record: xr.Dataset, how: ExcitationTable | None) -> xr.Dataset:
    """Return a response whose controller held the amplitude of a body at one level a sweep; any other as it is."""
    if how is None or how.held is None:
        return record
    if not is_response(record):
        raise CalibError("the amplitude of a body is held in a frequency response, and this record is over time")
    if how.held != record.attrs.get(HELD, how.held):
        raise CalibError(f"the record says that {record.attrs[HELD]!r} was held; drop the key or mend one of the two")
    return at_one_level(record, how.held)


def _nuisance(entry: RecordTable, record: xr.Dataset) -> tuple[str, ...]:
    """Nuisances that the study file names, else those that the record states of itself."""
    if entry.nuisance is not None:
        return tuple(entry.nuisance)
    return tuple(name.strip() for name in str(record.attrs.get("nuisance", "")).split(",") if name.strip())


def _file(entry: RecordTable, folder: Path) -> Path:
    path = folder / expanded(entry.path, folder)
    place = ", or set CALIB_DATA to the folder that has it" if "${CALIB_DATA}" in entry.path else ""
    verified(path, entry.sha256, entry.origin, hint=place)
    return path


def expanded(text: str, folder: Path) -> str:
    """Put the data folder for ${CALIB_DATA}: the environment's, else `shared/data` beside the checkout of the study."""
    if "${CALIB_DATA}" in text:
        text = text.replace("${CALIB_DATA}", os.environ.get("CALIB_DATA") or str(_beside(folder)))
    if "${" in text:
        raise CalibError(f"only ${{CALIB_DATA}} is expanded in a path, got {text!r}")
    return text


def _beside(folder: Path) -> Path:
    places = [parent.parent / "shared" / "data" for parent in (folder.resolve(), *folder.resolve().parents)]
    return next((place for place in places if place.is_dir()), places[0])


def digest(entry: RecordTable, folder: Path) -> str:
    """SHA-256 of the file of a record, whose path is relative to `folder`."""
    return checksum(folder / expanded(entry.path, folder))


def _excitation(how: ExcitationTable | None, record: xr.Dataset) -> Excitation:
    """Return the excitation that the study file states, else the record's own."""
    if how is None:
        return Excitation.of(record)
    if how.column is not None:
        raise CalibError("a column of a table was named, but the record has no [record.table]; drop the key column")
    unit, amplitude = unit_of(how.quantity), how.amplitude
    if how.unit is not None and amplitude is not None and not isinstance(amplitude, str):
        amplitude = f"{amplitude!r} {how.unit}"
    return Excitation(
        place=how.place or record.attrs.get("place", ""),
        quantity=_quantity(how),
        frequency=None if how.frequency is None else to_si(how.frequency, "Hz"),
        amplitude=None if amplitude is None else to_si(amplitude, unit),
        phase=to_si(how.phase, "rad"),
        cutoff=None if how.cutoff is None else to_si(how.cutoff, "Hz"),
    )


def _quantity(how: ExcitationTable) -> Quantity:
    """Return the quantity as it stands: the excitation that it is for refuses one that there is not."""
    return cast(Quantity, how.quantity)


def _check_bodies(record: xr.Dataset, model: Model, from_python: bool) -> None:
    for body in (str(b) for b in record.body.values):
        if body not in model.bodies:
            pair = "{%r: 'simulator body'}" if from_python else '{ "%s" = "simulator body" }'
            key = "bodies=" if from_python else "bodies = "
            raise CalibError(
                f"the record's body {body!r} is none of simulator {model.simulator.name!r}"
                f"{nearest(body, model.bodies)}, which has {', '.join(model.bodies)}; "
                f"say which is which: {key}{pair % body}{' in calib.Record' if from_python else ''}"
            )


def _check_excitation(excitation: Excitation | None, simulator: Simulator) -> None:
    takes = getattr(simulator, "excitations", None)  # optional: without it the simulator itself refuses, when it runs
    if excitation is None or takes is None or (excitation.quantity, excitation.place) in takes:
        return
    known = [f"{quantity} at {place!r}" for quantity, place in sorted(takes)]
    places = {place for _, place in takes}
    hint = "" if excitation.place in places else nearest(excitation.place, sorted(places))
    raise CalibError(
        f"the record is driven by {excitation.quantity} at {excitation.place!r}; simulator {simulator.name!r} takes "
        f"{', '.join(known)}{hint}; mend [record.excitation], or choose another simulator or other [model] options"
    )


def _check_taken(excitation: Excitation, request: Request, simulator: Simulator) -> None:
    """Let the simulator refuse what it cannot compute, if it looks at that."""
    check = getattr(simulator, "check", None)
    if check is not None:
        check(excitation, request)


def _check_sampling(record: xr.Dataset, excitation: Excitation) -> None:
    """Refuse a record with so few samples a period that a unit must be wrong."""
    period = excitation.period
    if is_response(record) or period is None or record.time.size < 2:
        return
    time = record.time.values
    step = float(time[-1] - time[0]) / (time.size - 1)
    if period < MIN_PERIODIC_SAMPLES * step:
        raise CalibError(
            f"the record lasts {time.size * step / period:.4g} periods of {period / step:.3g} samples (expected at "
            f"least {MIN_PERIODIC_SAMPLES:g} samples a period): check the unit of time and the frequency"
            f"{_likely_unit(period / step)}"
        )


def _likely_unit(samples: float) -> str:
    """Say which unit the numbers of time, taken as seconds, have if a period of so few samples is to have enough."""
    for unit, factor in (("ms", 1e3), ("us", 1e6)):
        if samples * factor >= USUAL_PERIODIC_SAMPLES:
            return f"; were its time in {unit}, it would have {samples * factor:.3g} samples a period"
    return ""


def _request(shape: StudyToml, entry: RecordTable, excitation: Excitation, record: xr.Dataset) -> Request:
    own = {key: getattr(entry, key) for key in REQUEST_KEYS if getattr(entry, key) is not None}
    general = {key: getattr(shape.study, key) for key in REQUEST_KEYS}
    times = record.time.values if excitation.recorded or not excitation.periodic else None
    return Request(times=times, **(general | own))
