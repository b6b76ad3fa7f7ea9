"""What the page of an extended study shows of the study that it extends."""

from collections.abc import Mapping
from dataclasses import dataclass

import xarray as xr

from calib.records import OK
from calib.report.formatting import number, percent
from calib.study import CalibrationResult


@dataclass(frozen=True, eq=False)
class BaseStudy:
    """The study that another one extends, as it was calibrated.

    Attributes
    ----------
    result : of its calibration
    records : name of a reference -> record simulated at its best values, of those that it was calibrated on
    """

    result: CalibrationResult
    records: Mapping[str, xr.Dataset]


def base_points(base: BaseStudy | None) -> tuple[str, ...]:
    """Say how near the model without the extension comes, calibrated by itself; nothing without a base study."""
    if base is None or base.result.score.total is None:
        return ()
    held = {name: one for name, one in base.result.holdout.items() if one.status == OK}
    misfits = "; ".join(f"{name} {percent(one.misfit, 3)}" for name, one in held.items())
    text = f"Without the extension (study {base.result.name}): distance {number(base.result.score.total, 3)}"
    return (f"{text}{f', misfit of the records held out: {misfits}' if misfits else ''}.",)
