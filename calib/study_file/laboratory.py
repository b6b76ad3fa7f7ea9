"""The laboratory of a study file: what [diagnosis] bench says of the next measurement."""

from collections.abc import Mapping, Sequence

from calib.diagnosis.laboratory import Laboratory, base_record, mistakes_of
from calib.errors import CalibError
from calib.modelling.model import Model
from calib.objective import Reference
from calib.study_file.mistakes import Mistakes
from calib.study_file.schema import BenchTable
from calib.units import to_si

BENCH_KEY = ("diagnosis", "bench")


def read_laboratory(
    bench: BenchTable, references: Mapping[str, Reference], model: Model, mistakes: Mistakes
) -> Laboratory:
    """Read what the laboratory can do; what does not suit records or simulator is noted with its key.

    Parameters
    ----------
    references : all records of the study, by name
    """
    compared = {name: reference for name, reference in references.items() if reference.use != "holdout"}
    unit = compared[base_record(compared)].excitation.unit
    laboratory = Laboratory(
        frequency=_bounds("frequency", bench.frequency, "Hz", mistakes),
        amplitude=_bounds("amplitude", bench.amplitude, unit, mistakes),
        release=_bounds("release", bench.release, "m", mistakes),
        tests=None if bench.tests is None else tuple(bench.tests),
        channels=_channels(bench.channels, mistakes),
        simulations=bench.simulations,
    )
    for key, mistake in mistakes_of(laboratory, compared, model):
        mistakes.add((*BENCH_KEY, key), mistake)
    return laboratory


def _bounds(key: str, stated: Sequence[str] | None, unit: str, mistakes: Mistakes) -> tuple[float, float] | None:
    """Bounds in SI; None where none are stated, or a mistake is noted."""
    if stated is None:
        return None
    with mistakes.at(*BENCH_KEY, key):
        low, high = (to_si(value, unit) for value in stated)
        if not 0.0 < low <= high < float("inf"):
            raise CalibError(f"expected [low, high] with 0 < low <= high, got [{stated[0]!r}, {stated[1]!r}]")
        return low, high
    return None


def _channels(stated: Sequence[str] | None, mistakes: Mistakes) -> tuple[tuple[str, str], ...] | None:
    if stated is None:
        return None
    pairs = [name.rpartition(".") for name in stated]
    for name, (body, _, channel) in zip(stated, pairs, strict=True):
        if not (body and channel):
            mistakes.add((*BENCH_KEY, "channels"), f"expected 'body.channel', such as 'mass.velocity', got {name!r}")
    return tuple((body, channel) for body, _, channel in pairs if body and channel)
