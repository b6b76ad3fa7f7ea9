"""Measured and simulated records: tables of samples, excitations, cycles."""

from calib.records.file import read, write
from calib.records.record import (
    CHANNELS,
    DETAILS,
    INTERVAL,
    MIN_SECTION_PERIODS,
    OK,
    SIMULATIONS,
    STATE,
    channels,
    failed,
    fills_periods,
    make,
    mean_interval,
    nuisance_sigma,
    prescribed,
    prescription,
    rename_bodies,
    stated_period,
    with_channels,
)
from calib.records.response import is_response
from calib.records.schema import check

__all__ = [
    "CHANNELS",
    "DETAILS",
    "INTERVAL",
    "OK",
    "MIN_SECTION_PERIODS",
    "SIMULATIONS",
    "STATE",
    "channels",
    "check",
    "failed",
    "fills_periods",
    "is_response",
    "make",
    "mean_interval",
    "nuisance_sigma",
    "prescribed",
    "prescription",
    "read",
    "rename_bodies",
    "stated_period",
    "with_channels",
    "write",
]
