"""Make the records of this folder from its tables: python experiments_ref/clapping_minimal/make_records.py."""

from pathlib import Path

from calib.records import write
from calib.records.table import Channel, Table, TimeColumn, read

HERE = Path(__file__).parent
DRIVES = {  # record: (amplitude [m], frequency [Hz]) of the drive
    "clapping": (1.50e-3, 26.24),
    "louder": (1.65e-3, 26.24),
    "slower": (1.50e-3, 25.60),
    "quiet": (0.90e-3, 26.24),
}
SIGMA = {"displacement": "0.010 mm", "velocity": "0.003 m/s"}  # standard deviation of the noise, README
COLUMN = {"displacement": ("displacement_mm", "mm"), "velocity": ("velocity_m_per_s", "m/s")}
WARNING = "not measured: computed outside this project with a compliant contact (README of clapping_minimal)"

for name, (amplitude, frequency) in DRIVES.items():
    channels = tuple(
        Channel(column=f"{body}_{COLUMN[c][0]}", body=body, channel=c, unit=COLUMN[c][1], sigma=SIGMA[c])
        for body in ("beam", "layer")
        for c in ("displacement", "velocity")
    )
    record, _ = read(Table(path=HERE / f"{name}.csv", channels=channels, time=TimeColumn(column="time_s", unit="s")))
    record.attrs.update(
        place="end",
        quantity="displacement",
        amplitude=amplitude,
        frequency=frequency,
        source=f"experiments_ref/clapping_minimal/{name}.csv",
        warning=WARNING,
    )
    write(record, HERE / f"{name}.nc")
