"""Outputs of programs, in every format that there is a reader for."""

# ruff: noqa: E501 - one case a line

import base64
import random
import zipfile
import zlib
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import h5py
import numpy as np
from fuzzing.case import OwnError, write_files
from fuzzing.kinds.record import restructured
from fuzzing.mutations import damaged, text_damaged
from output_formats import FORMATS, TIME, Format
from scipy.io import savemat

from calib.simulators.command.options import OutputReading
from calib.simulators.command.reading import Instants, OutputFault, read_columns, record_of

BOMB = 3 * 10**9  # bytes that a few megabytes make
TEXTUAL = (".csv", ".txt", ".dat", ".frd", ".pvd", ".vtu")


@cache
def _files() -> dict[str, dict[str, bytes]]:
    found = {}
    with TemporaryDirectory() as temporary:
        for name, form in FORMATS.items():
            folder = Path(temporary) / name
            folder.mkdir()
            form.write(folder / form.file)
            found[name] = {path.name: path.read_bytes() for path in folder.iterdir()}
    return found


@cache
def _squeezed(size: int) -> bytes:
    """Zeros, compressed."""
    packer = zlib.compressobj(9)
    parts = [packer.compress(bytes(2**20)) for _ in range(size // 2**20)]
    return b"".join(parts) + packer.flush()


def _bomb(path: Path, form: Format, rng: random.Random) -> str | None:
    """A small file that is large when it is unpacked."""
    size = rng.choice([BOMB, 2**28, 2**26])
    if path.suffix == ".npz":
        with (
            zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
            archive.open("t.npy", "w", force_zip64=True) as file,
        ):
            file.write(
                b"\x93NUMPY\x01\x00v\x00"
                + f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({size // 8},), }}".ljust(117).encode()
                + b"\n"
            )
            for _ in range(size // 2**20):
                file.write(bytes(2**20))
        return f"{size} bytes in an archive"
    if path.suffix == ".vtu" and b"vtkZLib" in path.read_bytes():
        packed = _squeezed(size)
        blocks = rng.choice([1, 3])
        head = np.array([blocks, size, size, *[len(packed)] * blocks], "<u4").tobytes()
        data = base64.b64encode(head) + base64.b64encode(packed * blocks)
        text = path.read_bytes()
        at = text.index(b">", text.index(b"<DataArray", text.index(b"PointData"))) + 1
        path.write_bytes(text[:at] + data + text[text.index(b"</DataArray>", at) :])
        return f"{blocks} blocks of {size} bytes"
    if path.suffix == ".mat":
        savemat(path, {"t": TIME, "tip": np.zeros(size // 8 if size < BOMB else 2**24)}, do_compression=True)
        return f"{size} bytes of zeros"
    if path.suffix in (".h5", ".nc"):
        with h5py.File(path, "w") as file:
            file.create_dataset("time", data=np.arange(size // 8.0 / 4) if size == 2**26 else TIME)
            rows = file["time"].size
            file.create_dataset("u", (rows, size // 8 // rows), "f8", compression="gzip", chunks=True)
        return f"{size} bytes that were never written"
    return None


class _Outputs:
    name = "reader"

    def samples(self) -> list[str]:
        return list(FORMATS)

    def make(self, sample: str, rng: random.Random | None, folder: Path) -> list[str]:
        form = FORMATS[sample]
        (folder / "format").write_text(sample)
        write_files(_files()[sample], folder)
        if rng is None:
            return []
        path = folder / rng.choice([form.file, *_files()[sample]])
        if rng.random() < 0.02:
            done = _bomb(path, form, rng)
            if done is not None:
                return [done]
        if rng.random() < 0.03:
            target = rng.choice(
                ["../outside/secret.txt", "../outside/secret.nc", path.name, "/dev/zero", "/etc/passwd", ".."]
            )
            path.unlink()
            path.symlink_to(target)
            return [f"a symbolic link to {target}"]
        if path.suffix in (".h5", ".nc") and b"HDF" in path.read_bytes()[:8] and rng.random() < 0.6:
            return restructured(path, rng, folder)
        content = path.read_bytes()
        path.write_bytes((text_damaged if path.suffix in TEXTUAL and rng.random() < 0.7 else damaged)(content, rng))
        return ["bytes"]

    def read(self, folder: Path) -> None:
        form = FORMATS[(folder / "format").read_text()]
        stated = {
            "reader": form.reader,
            "file": form.file,
            "bodies": {"tip": {"displacement": {"column": form.column, "unit": "mm"}}},
        }
        reading = OutputReading.of({**stated, **form.options})
        try:
            columns = read_columns(folder, reading, None)
            record_of(columns, reading, Instants(np.linspace(0.0, 0.9, 10)), {})
        except OutputFault as fault:
            raise OwnError(f"{fault.status}: {fault.reason}") from fault

    def readable(self, folder: Path) -> frozenset[str]:
        return frozenset()


OUTPUT = _Outputs()
