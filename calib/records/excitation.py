"""The excitation of a record: harmonic, recorded, or none."""

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
import xarray as xr

from calib.errors import CalibError, nearest

UNITS = {"displacement": "m", "base motion": "m", "force": "N", "free decay": "1", "servo reference": "m"}
Quantity = Literal["displacement", "base motion", "force", "free decay", "servo reference"]


def unit_of(quantity: str) -> str:
    """SI unit of an excitation's quantity.

    Raises
    ------
    CalibError : there is no such quantity
    """
    if quantity not in UNITS:
        known = ", ".join(UNITS)
        raise CalibError(f"an excitation's quantity is one of {known}, got {quantity!r}{nearest(quantity, UNITS)}")
    return UNITS[quantity]


class Harmonic(NamedTuple):
    """A harmonic input: frequency [Hz], amplitude [unit of the excitation], phase [rad]."""

    frequency: float
    amplitude: float
    phase: float

    @property
    def period(self) -> float:
        """Period [s]."""
        return 1.0 / self.frequency


class Samples(NamedTuple):
    """A recorded input: time [s] and value [unit of the excitation], (n,) each."""

    time: np.ndarray
    value: np.ndarray


@dataclass(frozen=True, eq=False)
class Excitation:
    """A harmonic x(t) = amplitude cos(2 pi frequency t + phase) or a recorded x(t), acting at a named place.

    It belongs to a record, not to a model: a simulator's drive parameters are scales on it.

    Attributes
    ----------
    place : where it acts, as the simulator names it ("end", "centre", "mass")
    quantity : "displacement" (prescribed motion), "base motion", "force", "free decay" or "servo reference"
    unit : SI unit of the quantity
    frequency, amplitude, phase : of the harmonic  [Hz], [unit], [rad]; frequency alone states the period of a
        recorded periodic input
    time, value : (n,) arrays of the recorded input  [s], [unit]
    cutoff : zero-phase low-pass that a simulator applies where it needs derivatives of a recorded motion  [Hz]
    """

    place: str
    quantity: Quantity
    unit: str = ""
    frequency: float | None = None
    amplitude: float | None = None
    phase: float = 0.0
    time: np.ndarray | None = None
    value: np.ndarray | None = None
    cutoff: float | None = None

    def __post_init__(self) -> None:
        unit = unit_of(self.quantity)
        if not self.unit:
            object.__setattr__(self, "unit", unit)
        if self.frequency is not None and not self.frequency > 0.0:
            raise CalibError(f"the excitation's frequency must be positive [Hz], got {self.frequency}")
        if (self.time is None) != (self.value is None):
            raise CalibError("a recorded excitation needs both time [s] and value; one of them is missing")
        if self.time is not None and self.value is not None:
            _check_samples(self.time, self.value)
        elif self.quantity != "free decay" and (self.frequency is None or self.amplitude is None):
            raise CalibError(
                f"an excitation by {self.quantity} needs frequency [Hz] and amplitude [{self.unit}], "
                "or a recorded input"
            )

    @property
    def recorded(self) -> bool:
        """Whether the input is given by samples."""
        return self.time is not None

    @property
    def harmonic(self) -> bool:
        """Whether the input is harmonic."""
        return not self.recorded and self.quantity != "free decay"

    @property
    def periodic(self) -> bool:
        """Whether the excitation has a period."""
        return self.frequency is not None

    @property
    def period(self) -> float | None:
        """Period [s], or None without one."""
        return None if self.frequency is None else 1.0 / self.frequency

    @property
    def as_harmonic(self) -> Harmonic:
        """The harmonic input.

        Raises
        ------
        CalibError : the excitation is no harmonic
        """
        if self.frequency is None or self.amplitude is None or not self.harmonic:
            given = f"{self.quantity}{' by samples' if self.recorded else ''}"
            raise CalibError(f"a harmonic excitation is needed, got {given}; state its frequency and amplitude")
        return Harmonic(self.frequency, self.amplitude, self.phase)

    @property
    def as_samples(self) -> Samples:
        """The recorded input.

        Raises
        ------
        CalibError : the excitation is not given by samples
        """
        if self.time is None or self.value is None:
            raise CalibError(f"a recorded excitation is needed, got {self.quantity} without samples")
        return Samples(self.time, self.value)

    @property
    def attributes(self) -> dict[str, str | float]:
        """What a simulated record states of it in its attributes: where and what, and of a harmonic its numbers."""
        tone = self.as_harmonic._asdict() if self.harmonic else {}
        return {"place": self.place, "quantity": self.quantity, **tone}

    def scaled(self, factor: float) -> "Excitation":
        """Return the same excitation with `factor` times its amplitude."""
        return replace(
            self,
            amplitude=None if self.amplitude is None else factor * self.amplitude,
            value=None if self.value is None else factor * self.value,
        )

    @classmethod
    def of(cls, record: xr.Dataset) -> "Excitation":
        """Read the excitation that a record carries in its attributes and its `excitation` variable.

        Raises
        ------
        CalibError : place or quantity is missing, or there is neither a harmonic nor samples
        """
        attrs = record.attrs
        for key in ("place", "quantity"):
            if key not in attrs:
                raise CalibError(
                    f"the record does not state its excitation: attribute {key!r} is missing; "
                    "state it in [record.excitation] of the study file, or in the record"
                )
        recorded = "excitation" in record
        numbers = {k: float(attrs[k]) for k in ("frequency", "amplitude", "phase", "cutoff") if k in attrs}
        return cls(
            place=attrs["place"],
            quantity=attrs["quantity"],
            frequency=numbers.get("frequency"),
            amplitude=numbers.get("amplitude"),
            phase=numbers.get("phase", 0.0),
            time=record.time.values if recorded else None,
            value=record["excitation"].values if recorded else None,
            cutoff=numbers.get("cutoff"),
        )


def _check_samples(time: np.ndarray, value: np.ndarray) -> None:
    """Check that samples (n,) of a recorded input are finite, and that their time increases."""
    if time.shape != value.shape or time.ndim != 1 or time.size < 2:
        raise CalibError(
            "a recorded excitation needs time and value of one length, at least two samples; "
            f"got shapes {time.shape} and {value.shape}"
        )
    if not (np.isfinite(time).all() and np.isfinite(value).all()):
        raise CalibError("the recorded excitation holds NaN or infinity; cut those samples")
    if (np.diff(time) <= 0.0).any():
        raise CalibError("the time of the recorded excitation must increase from sample to sample")
