"""The state once per period of the excitation."""

import numpy as np
import xarray as xr

from calib.errors import CalibError
from calib.records.cycles.gaps import gaps_in
from calib.records.cycles.loop import period_of
from calib.records.record import STATE


def poincare(record: xr.Dataset, phase: float = 0.0) -> xr.Dataset:
    """State of each body once per period of the excitation.

    At phase 0 the record's own section is taken where it has one: it is longer than the record. Instants inside a gap
    in time are left out.

    Parameters
    ----------
    record : Dataset with displacement (body, time) [m] and velocity (body, time) [m/s]; either may be absent
    phase : float in [0, 1)  [1]

    Returns
    -------
    Dataset with displacement (body, cycle) [m] and velocity (body, cycle) [m/s]
    """
    if not 0.0 <= phase < 1.0:
        raise CalibError(f"a section's phase is in [0, 1) periods, got {phase}")
    own = section(record) if phase == 0.0 else {}
    if not own:
        period, time = period_of(record), record.time.values
        first = int(np.ceil(time[0] / period - phase - 1e-6))
        last = int(np.floor(time[-1] / period - phase + 1e-6))
        if last < first:
            raise CalibError(f"the record never passes phase {phase} of its period of {period:.6g} s; record more")
        at = (np.arange(first, last + 1) + phase) * period
        for before, behind in gaps_in(time):
            at = at[(at <= before) | (at >= behind)]
        if not at.size:
            raise CalibError(f"the record passes phase {phase} of its period in gaps alone; record without gaps")
        present = [channel for channel in STATE if channel in record]
        own = {c: np.array([np.interp(at, time, row) for row in record[c].values]) for c in present}
    return xr.Dataset(
        {c: (("body", "cycle"), v, {"units": record[c].attrs.get("units", "")}) for c, v in own.items()},
        coords={"body": record.body.values},
        attrs={"phase": phase},
    )


def section(record: xr.Dataset) -> dict[str, np.ndarray]:
    """Stroboscopic section (body, period) at phase 0 of each channel of the record; empty without one."""
    have = record.variables
    names = [c for c in STATE if c in have and f"section_{c}" in have]
    return {c: have[f"section_{c}"].values for c in names}
