"""Part of the chapter on the next measurement: which one would distinguish the alternatives."""

from dataclasses import dataclass

from calib.diagnosis.design_document import DesignVariableResult, MeasurementResult
from calib.diagnosis.document import DiagnosisResult
from calib.diagnosis.laboratory import AMPLITUDE_RANGE, FREQUENCY_RANGE, RELEASE_RANGE
from calib.diagnosis.measurement import DECISIVE_Z
from calib.report.formatting import number, quantity, signed
from calib.report.pages.picture import Picture, pictured
from calib.report.plots.separation import separation_lines, separation_map
from calib.units import count

MIN_ROUNDED_Z = 1.0  # of a predicted separation, below which it is written to two digits  [standard deviations]
SEPARATION_MAP = (
    "Predicted separation of the two least distinguishable explanations by a steady tone, over its frequency and "
    "amplitude: by how many standard deviations of the noise their records would differ once each is refitted to that "
    "record too. Cells: a regular grid; dots: refinement about the best. The white line is where z = 3, from which "
    "models count as distinguishable. The noise is taken to be proportional to the motion, as in the records."
)
SEPARATION_LINES = (
    "Predicted separation z of the two least distinguishable explanations by tests that are searched over one setting. "
    "Star: the best, confirmed by simulation at the refitted parameters; dashed line: z = 3; hollow: z below 0.1; "
    "cross: no regular motion, or a failed simulation."
)
NAMES = {"amplitude": "amplitude", "frequency": "frequency", "release": "displacement of release"}
RANGES = {"amplitude": AMPLITUDE_RANGE, "frequency": FREQUENCY_RANGE, "release": RELEASE_RANGE}


@dataclass(frozen=True)
class MeasurementRow:
    """The best measurement of a kind of test with its predicted separations."""

    kind: str
    description: str
    z: str
    z_max: str
    z_refit: str
    confirmed: bool
    decisive: bool


@dataclass(frozen=True)
class NextMeasurement:
    """Table and figures of the search for the next measurement.

    `several` says whether there are more than two explanations; the map and the lines are None where not searched.
    """

    rows: tuple[MeasurementRow, ...]
    several: bool
    map: Picture | None
    lines: Picture | None
    bounds: str
    unavailable: str
    effort: str


def next_measurement(diagnosis: DiagnosisResult) -> NextMeasurement | None:
    """Everything that the page shows of the search for the next measurement; None where there was none."""
    design, measurements = diagnosis.design, diagnosis.measurements
    if design is None:
        return None
    kinds = {measurement.kind for measurement in measurements}
    unavailable = [f"{kind}: {reason}" for kind, reason in design.unavailable.items() if kind not in kinds]
    return NextMeasurement(
        rows=tuple(_row(measurement) for measurement in measurements),
        several=len(design.models) > 2,
        map=pictured(separation_map(design, measurements), "separation-map", SEPARATION_MAP),
        lines=pictured(separation_lines(design, measurements), "separation-lines", SEPARATION_LINES),
        bounds="; ".join(_bounds(variable) for variable in design.variables),
        unavailable="; ".join(unavailable),
        effort=f"{count(len(design.points), 'setting')} with {count(design.simulations, 'simulation')} "
        f"(at most {design.max_simulations})",
    )


def _row(measurement: MeasurementResult) -> MeasurementRow:
    return MeasurementRow(
        kind=measurement.kind,
        description=measurement.description,
        z=separation_text(measurement.z),
        z_max=separation_text(measurement.z_max),
        z_refit="-" if measurement.z_refit is None else separation_text(measurement.z_refit),
        confirmed=measurement.confirmed,
        decisive=measurement.z >= DECISIVE_Z,
    )


def separation_text(z: float) -> str:
    """Write a predicted separation; a small one to two digits, as sentences about it do."""
    return number(z, 2) if abs(z) < MIN_ROUNDED_Z else signed(z)


def _bounds(variable: DesignVariableResult) -> str:
    """Write the bounds of a setting, and where they come from."""
    low, high = quantity(variable.low, variable.unit), quantity(variable.high, variable.unit)
    source = "stated in the study file"
    if not variable.stated:
        least, most = RANGES[variable.name]
        what = "the largest displacement" if variable.name == "release" else "that"
        source = f"derived: {least:g} to {most:g} times {what} of the records"
    return f"{NAMES[variable.name]} {low} to {high} ({source})"
