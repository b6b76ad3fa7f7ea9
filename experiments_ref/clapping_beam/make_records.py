"""Make the records of this folder from its tables: python experiments_ref/clapping_beam/make_records.py."""

from pathlib import Path

from calib.records import write
from calib.records.table import Channel, Table, TimeColumn, read

HERE = Path(__file__).parent
DRIVES = {  # record: (amplitude [m], frequency [Hz]) of the drive
    "clapping": (0.92e-3, 26.51),
    "louder": (1.10e-3, 26.51),
    "slower": (0.92e-3, 24.00),
    "quiet": (0.30e-3, 26.51),
}
SIGMA = {"displacement": "0.004 mm", "velocity": "0.0015 m/s"}  # standard deviation of the noise, README
COLUMN = {"displacement": ("displacement_mm", "mm"), "velocity": ("velocity_m_per_s", "m/s")}
WARNING = "not measured: a finite-element stand-in for the paper's Fig. 2 (README of clapping_beam)"

for name, (amplitude, frequency) in DRIVES.items():
    channels = tuple(
        Channel(column=f"{body}_{COLUMN[c][0]}", body=body, channel=c, unit=COLUMN[c][1], sigma=SIGMA[c])
        for body in ("beam", "layer")
        for c in ("displacement", "velocity")
    )
    record, _ = read(Table(path=HERE / f"{name}.csv", channels=channels, time=TimeColumn(column="time_s", unit="s")))
    record.attrs.update(
        place="centre",
        quantity="displacement",
        amplitude=amplitude,
        frequency=frequency,
        source=f"experiments_ref/clapping_beam/{name}.csv",
        warning=WARNING,
        prescribed="beam.displacement,beam.velocity",
    )
    write(record, HERE / f"{name}.nc")
