"""The columns that [record.table] and [record.excitation] state."""

import warnings
from collections import Counter
from dataclasses import fields
from pathlib import Path
from typing import cast

import xarray as xr

from calib.errors import CalibError, nearest
from calib.records import table
from calib.records.delimited import TextLayout
from calib.records.excitation import Excitation, Quantity, unit_of
from calib.records.motion_unit import motion_quantity, motion_unit
from calib.records.order_tracking import tracked
from calib.records.response_columns import (
    AMPLITUDE,
    IN_PHASE,
    PAIRS,
    PHASE,
    QUADRATURE,
    ResponseColumns,
    StatedLevel,
    UnitColumn,
)
from calib.records.response_table import ResponseTable, read_response_columns
from calib.records.sheet import UnknownColumn, UnknownRows
from calib.study_file.mistakes import Mistakes
from calib.study_file.schema import ChannelTable, ExcitationTable, TableTable
from calib.units import to_si

TEXT_KEYS = {field.name for field in fields(TextLayout)}  # keys of [record.table] that delimited text has
OVER_TIME = ("time", "rate", "margin", "cutoff", "decimate", "tracking")  # keys that a response does not have
OVER_FREQUENCY = ("sweep", "direction", "elements")  # keys that a response alone has
PARTS_OF_RESPONSE = [what for pair in PAIRS for what in pair]
Key = tuple[str | int, ...]


def checked_drive(
    how: TableTable, excitation: ExcitationTable | None, key: Key, mistakes: Mistakes
) -> table.ExcitationColumn | None:
    """Note what is wrong with the keys of a table; return the column over time that is the excitation, if one is."""
    drive = None
    if how.frequency is None:
        with mistakes.at(*key, "excitation"):
            drive = _drive(excitation)
        _check_units(how, drive, key, mistakes)
        if how.tracking is not None and drive is None and not mistakes.within(*key, "excitation"):
            mistakes.add(
                (*key, "table", "tracking"),
                "tracking needs the excitation as measured: state its column in [record.excitation]",
            )
        if how.tracking is not None and how.cutoff is not None:
            mistakes.add(
                (*key, "table", "cutoff"),
                "a low-pass changes the motion that is tracked, and tracking filters more narrowly; drop cutoff",
            )
    _check_keys(how, key, mistakes)
    return drive


def stated_record(
    how: TableTable,
    excitation: ExcitationTable | None,
    drive: table.ExcitationColumn | None,
    file: Path,
    key: Key,
    mistakes: Mistakes,
) -> tuple[xr.Dataset | None, Excitation | None]:
    """Read the record that [record.table] states, and the excitation of one over time; what is wrong is noted."""
    try:
        if how.frequency is None:
            record, recorded = table.read(_table(how, drive, file))
            if how.tracking is None:
                return record, recorded
            return tracked(record, how.tracking.sine, how.tracking.cycles, how.tracking.harmonics), None
        return _response(how, excitation, file, key, mistakes), None
    except UnknownColumn as error:
        mistakes.add((*key, *_place_of(how, error.column)), str(error))
    except UnknownRows as error:
        mistakes.add((*key, "table", error.key), str(error))
    return None, None


def _check_keys(how: TableTable, key: Key, mistakes: Mistakes) -> None:
    """Note keys of a table over frequency that stand in one over time, and the other way round."""
    over_frequency = how.frequency is not None
    for name in OVER_TIME if over_frequency else OVER_FREQUENCY:
        if name in how.model_fields_set:
            what = "a table over time has, and this one has a frequency" if over_frequency else (
                "a frequency response has, and this table has no frequency"
            )  # fmt: skip
            mistakes.add((*key, "table", name), f"{name} is a key that {what}; drop one of the two")
    for index, channel in enumerate(how.channels):
        if channel.of is not None and (not over_frequency or channel.channel in (AMPLITUDE, IN_PHASE, QUADRATURE)):
            mistakes.add((*key, "table", "channels", index, "of"), f"of belongs to a {PHASE}; drop it")
        if channel.harmonic > 1 and not over_frequency:
            mistakes.add(
                (*key, "table", "channels", index, "harmonic"),
                "a harmonic belongs to a frequency response, and this table has no frequency; drop it",
            )


def _check_units(how: TableTable, drive: table.ExcitationColumn | None, key: Key, mistakes: Mistakes) -> None:
    """Check the units of the columns of a table, each noted with its own key."""
    for index, channel in enumerate(_channels(how)):
        place = (*key, "table", "channels", index)
        with mistakes.at(*place, "unit"):
            table.si_factor(channel)
        if not mistakes.within(*place):
            with mistakes.at(*place, "sigma"):
                table.si_sigma(channel)
    uses = Counter(channel.column for channel in how.channels)
    for column in (column for column, count in uses.items() if count > 1):
        where = mistakes.place(*key, "table", "channels")
        warnings.warn(f"{where}: column {column!r} is {uses[column]} channels; check their columns", stacklevel=2)
    if how.time is not None:
        with mistakes.at(*key, "table", "time", "unit"):
            to_si(f"1 {how.time.unit}", "s")
    if drive is not None:
        with mistakes.at(*key, "excitation", "unit"):
            table.si_factor(drive)


def _place_of(how: TableTable, column: str | int) -> Key:
    """Key below [[record]] that names a column first."""
    for index, channel in enumerate(how.channels):
        if channel.column == column:
            return "table", "channels", index, "column"
    for clock in ("time", "frequency"):
        own = getattr(how, clock)
        if own is not None and own.column == column:
            return "table", clock, "column"
    for number in ("sweep", "direction"):
        if getattr(how, number) == column:
            return "table", number
    return "excitation", "column"


def _channels(how: TableTable) -> tuple[table.Channel, ...]:
    return tuple(table.Channel(**channel.model_dump(exclude={"of", "harmonic"})) for channel in how.channels)


def _table(how: TableTable, drive: table.ExcitationColumn | None, file: Path) -> table.Table:
    """Table over time that [record.table] states."""
    return table.Table(
        path=file,
        channels=_channels(how),
        drive=drive,
        time=None if how.time is None else table.TimeColumn(**how.time.model_dump()),
        rate=None if how.rate is None else to_si(how.rate, "Hz"),
        first=how.first,
        last=how.last,
        margin=how.margin,
        cutoff=None if how.cutoff is None else to_si(how.cutoff, "Hz"),
        decimate=how.decimate,
        text=TextLayout(**how.model_dump(include=TEXT_KEYS, exclude_none=True)),
    )


def _drive(how: ExcitationTable | None) -> table.ExcitationColumn | None:
    """Return the column that is the excitation, if one is."""
    if how is None or how.column is None:
        return None
    if how.place is None or how.unit is None:
        raise CalibError("an excitation read from a column needs place and unit in [record.excitation]")
    if how.amplitude is not None or how.phase != 0.0:
        raise CalibError("an excitation read from a column has its own amplitude and phase; drop these two keys")
    return table.ExcitationColumn(
        column=how.column,
        place=how.place,
        quantity=cast(Quantity, how.quantity),  # as it stands: the column refuses one that there is not
        unit=how.unit,
        scale=how.scale,
        cutoff=None if how.cutoff is None else to_si(how.cutoff, "Hz"),
    )


# --- frequency responses


def stated_level(how: ExcitationTable) -> StatedLevel | None:
    """Amplitude of the excitation that [record.excitation] states, if it does."""
    if how.amplitude is None:
        return None
    unit = unit_of(how.quantity)
    stated = f"{how.amplitude!r} {how.unit}" if how.unit and not isinstance(how.amplitude, str) else how.amplitude
    return StatedLevel(to_si(stated, unit), unit)


def _response(
    how: TableTable, excitation: ExcitationTable | None, file: Path, key: Key, mistakes: Mistakes
) -> xr.Dataset | None:
    """Read the frequency response that [record.table] states; None where its keys are mistaken, each noted."""
    level = None
    with mistakes.at(*key, "excitation"):
        level = _level(excitation)
    with mistakes.at(*key, "excitation", "unit"):
        _check_level(level, excitation)
    per = (unit_of(excitation.quantity),) if level is not None and excitation is not None else ()
    of_body: dict[int, dict[tuple[str, str], UnitColumn]] = {1: {}}
    for index, channel in enumerate(how.channels):
        place = (*key, "table", "channels", index)
        if channel.channel not in PARTS_OF_RESPONSE:
            mistakes.add(
                (*place, "channel"),
                f"a frequency response has the channels {', '.join(PARTS_OF_RESPONSE)}, got {channel.channel!r}"
                f"{nearest(channel.channel, PARTS_OF_RESPONSE)}",
            )
            continue
        own = of_body.setdefault(channel.harmonic, {})
        if (channel.body, channel.channel) in own:
            of = f" of harmonic {channel.harmonic}" if channel.harmonic > 1 else ""
            mistakes.add(place, f"a second column is the {channel.channel}{of} of body {channel.body!r}; keep one")
        own[channel.body, channel.channel] = UnitColumn(channel.column, channel.unit, channel.scale, channel.of or "")
        with mistakes.at(*place, "unit"):
            _check_part(channel, per)
        with mistakes.at(*place, "sigma"):
            _check_sigma(channel, per)
    if how.frequency is None or level is None or mistakes.within(*key):
        return None
    frequency = how.frequency
    with mistakes.at(*key, "table", "frequency", "unit"):
        to_si(f"1 {frequency.unit}", "Hz")
    with mistakes.at(*key, "table", "frequency", "sigma"):
        to_si(1.0 if frequency.sigma is None else frequency.sigma, "Hz")
    if mistakes.within(*key):
        return None
    sigmas: dict[int, dict[str, UnitColumn | str | float]] = {order: {} for order in of_body}
    for channel in how.channels:
        if channel.sigma is not None:
            sigmas[channel.harmonic][channel.body] = channel.sigma
    columns = ResponseColumns(
        UnitColumn(frequency.column, frequency.unit), of_body.pop(1), level, frequency.sigma, sigmas.pop(1), how.sweep,
        how.direction, of_body, sigmas,
    )  # fmt: skip
    layout = TextLayout(**how.model_dump(include=TEXT_KEYS, exclude_none=True))
    return read_response_columns(ResponseTable(file, columns, how.elements, how.first, how.last, layout))


def _level(how: ExcitationTable | None) -> UnitColumn | StatedLevel:
    if how is None:
        raise CalibError(
            "the level of the excitation is not stated: give its quantity, its place and the column that is its "
            "amplitude, or one amplitude of all points, in [record.excitation]"
        )
    unit_of(how.quantity)
    if how.cutoff is not None or how.phase != 0.0:
        raise CalibError("a frequency response has no time: drop the keys phase and cutoff")
    if how.column is None:
        level = stated_level(how)
        if level is None:
            raise CalibError(
                "expected the column that is the amplitude of the excitation, or one amplitude of all points"
            )
        return level
    if how.amplitude is not None:
        raise CalibError("the level is read from a column; drop the key amplitude")
    if how.unit is None:
        raise CalibError('the column of the level states no unit; give one, such as unit = "N"')
    return UnitColumn(how.column, how.unit, how.scale)


def _check_level(level: UnitColumn | StatedLevel | None, how: ExcitationTable | None) -> None:
    """Refuse a column of levels whose unit is none of the excitation's quantity."""
    if not isinstance(level, UnitColumn) or how is None:
        return
    if unit_of(how.quantity) == "N":
        to_si(f"({level.scale}) * (1 {level.unit})", "N")
    else:
        motion_unit(level.unit, level.scale)


def _check_part(channel: ChannelTable, per: tuple[str, ...]) -> None:
    if channel.channel == PHASE:
        to_si(f"({channel.scale}) * (1 {channel.unit})", "rad")
    else:
        motion_unit(channel.unit, channel.scale, per)


def _check_sigma(channel: ChannelTable, per: tuple[str, ...]) -> None:
    if channel.sigma is None:
        return
    if channel.channel in (PHASE, QUADRATURE):
        own = next(first for first, second in PAIRS if second == channel.channel)
        raise CalibError(f"sigma is that of either part of a response: state it of {own}, not of {channel.channel}")
    if isinstance(channel.sigma, str):
        motion_quantity(channel.sigma, per)
