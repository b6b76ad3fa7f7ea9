"""The residuals of one term on one record, in blocks of one body and channel."""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from calib import plugins
from calib.errors import CalibError, nearest
from calib.objective.prepared_reference import PreparedReference, SensedRecord
from calib.objective.prepared_response import PreparedResponse
from calib.objective.terms import Feature, Term
from calib.records import STATE
from calib.records import channels as channels_of


class Blocks:
    """One term on one record: the measured values, and the factors that scale differences to residuals."""

    def __init__(self, term: Term, record: str, compared: PreparedReference | PreparedResponse):
        self.term, self.record = term, record
        feature = term.feature
        label = f"term {term.label!r}, record {record!r}"
        for body in term.bodies or ():
            if body not in compared.bodies:
                raise CalibError(
                    f"{label}: no body {body!r}{nearest(body, compared.bodies)}; the reference has {compared.bodies}"
                )
        _check_channels(feature, compared.record, label)
        try:
            if hasattr(feature, "prepared"):
                feature = feature.prepared(compared.record, term.bodies)
            reference = feature(compared.record, term.bodies)
        except CalibError as error:
            raise CalibError(f"{label}: {error}") from error
        self.measured = _cubed(reference)
        self.shape = self.measured.shape
        names = [str(body) for body in reference.body.values]
        channels = [str(c) for c in reference.channel.values] if "channel" in reference.dims else [feature.name]
        finite = np.isfinite(self.measured)
        if term.bodies is not None and not finite.all():
            body = names[int(np.argwhere(~finite)[0][0])]
            raise CalibError(f"{label}: the reference shows no {feature.name} of {body!r}; leave this body out")
        free = np.array([[(b, c) not in compared.prescribed for c in channels] for b in names])
        self.mask = finite & free[:, :, None]
        if free.any() and not self.mask.any():
            raise CalibError(f"{label}: the reference shows no {feature.name} of any body; drop the term")
        self._names = [(b, c) for b in names for c in channels]
        sizes = self.mask.sum(axis=2)
        self.layout = [(b, c, int(n)) for (b, c), n in zip(self._names, sizes.ravel(), strict=True) if n]
        self.number = len(self.layout)
        self._feature = feature
        self._factor = self._factors(feature, reference, compared.record, sizes)
        self._wraps = getattr(feature, "wraps", None)
        self._bare = getattr(feature, "values", None)
        self._raw = not getattr(feature, "aligned", True)
        self._trust = getattr(feature, "trust", None)

    @property
    def pairs(self) -> set[tuple[str, str]]:
        """(body, channel) pairs that are compared."""
        return {(body, channel) for body, channel, _ in self.layout}

    def _factors(self, feature: Feature, reference: xr.DataArray, record: xr.Dataset, sizes: np.ndarray) -> np.ndarray:
        """1 / scale, times 1 / sigma of unit mean square, over the root of the number of samples (body, channel, n)."""
        scale = _broadcast(feature.scale(reference), reference, self.shape)
        if not (scale[self.mask] > 0.0).all():
            body = self._names[int(np.argmax(((scale <= 0.0) & self.mask).any(axis=2).ravel()))][0]
            raise CalibError(
                f"term {self.term.label!r}, record {self.record!r}: {body!r} does not move in the reference, "
                "so that no difference can be related to it; leave this body out"
            )
        weight = np.ones(self.shape)
        sigma = feature.uncertainty(record, self.term.bodies) if hasattr(feature, "uncertainty") else None
        if sigma is not None:
            weight = 1.0 / _cubed(sigma)
            weight = weight / np.sqrt((weight**2).mean(axis=2, keepdims=True))
        sizes = np.maximum(sizes, 1)[:, :, None]
        return np.divide(weight, scale * np.sqrt(sizes), out=np.zeros(self.shape), where=self.mask)

    def active(self, prescribed: frozenset[tuple[str, str]]) -> np.ndarray:
        """Whether each block (body, channel) of the layout counts: what the simulator prescribes does not."""
        return np.array([(body, channel) not in prescribed for body, channel, _ in self.layout], dtype=bool)

    def residual(self, sensed: SensedRecord, active: np.ndarray) -> np.ndarray:
        """Differences over scale and root of their number, in the order of the layout; what does not count is 0."""
        record = sensed.raw if self._raw else sensed.record
        bodies = self.term.bodies
        try:
            simulated = _cubed(self._feature(record, bodies)) if self._bare is None else self._bare(record, bodies)
        except CalibError as error:
            raise CalibError(f"term {self.term.label!r}, simulated record {self.record!r}: {error}") from error
        simulated = simulated.reshape(*simulated.shape[:2], -1)
        if simulated.shape != self.shape:
            raise CalibError(
                f"term {self.term.label!r}, record {self.record!r}: expected values of shape {self.shape} (body, "
                f"channel, rest), got {simulated.shape} from the simulated record; name the channels to compare"
            )
        difference = simulated - self.measured
        if self._wraps:
            difference = (difference + 0.5 * self._wraps) % self._wraps - 0.5 * self._wraps
        if self._trust is not None:
            difference = difference * self._trust(record)
        residual = (difference * self._factor)[self.mask]
        sizes = [size for _, _, size in self.layout]
        if np.isnan(residual).any():  # nothing to measure in the simulation: off by the whole scale
            flat = np.repeat([1.0 / np.sqrt(size) for size in sizes], sizes)
            residual = np.where(np.isnan(residual), flat, residual)
        return residual if active.all() else residual * np.repeat(active, sizes)


def _check_channels(feature: Feature, record: xr.Dataset, label: str) -> None:
    have = channels_of(record)
    missing = [channel for channel in feature.channels if channel not in have]
    if not missing:
        return
    possible = _possible(have)
    hint = f"possible are {', '.join(possible)}" if possible else "choose a feature of what it has"
    raise CalibError(f"{label}: {feature.name} needs {missing[0]}, but the reference has {', '.join(have)}; {hint}")


def _possible(have: Sequence[str]) -> list[str]:
    """Names of the registered features that records with these channels can be compared by."""
    possible = []
    for name, maker in plugins.load_all("calib.features").items():
        needs = maker().channels
        if set(needs) <= set(have) and (needs or set(STATE) & set(have)):
            possible.append(name)
    if "phase_curve" not in possible and set(STATE) & set(have):
        one = next(c for c in STATE if c in have)
        possible.append(f'phase_curve with channels = ["{one}"]')
    return possible


def _broadcast(scale: xr.DataArray | float, reference: xr.DataArray, shape: tuple[int, ...]) -> np.ndarray:
    """Scale (body, channel, rest) of every value of the reference."""
    if isinstance(scale, xr.DataArray):
        if not all(index.equals(reference.indexes.get(name)) for name, index in scale.indexes.items()):
            scale = scale.broadcast_like(reference)
        every = scale.variable.set_dims(reference.sizes).transpose(*reference.dims).values
        return every.reshape(shape).astype(float)
    return np.broadcast_to(np.asarray(scale, dtype=float), shape)


def _cubed(values: xr.DataArray) -> np.ndarray:
    """Values (body, channel, rest)."""
    array = values.values
    if "channel" not in values.dims:
        array = array[:, None]
    return array.reshape(*array.shape[:2], -1)
