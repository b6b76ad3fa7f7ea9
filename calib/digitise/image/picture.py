"""The picture of a figure, as light."""

import struct
import warnings
import zlib
from pathlib import Path

import numpy as np
from PIL import Image, ImageOps, UnidentifiedImageError

from calib.errors import CalibError

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")
FORMATS = ("PNG", "JPEG", "TIFF", "BMP")
# pixels; a figure of 17 cm x 17 cm at 600 dots per inch has 16 million. Reading takes 115 bytes a pixel: 2.3 GB
MAX_PICTURE_PIXELS = 20_000_000


def read_picture(path: str | Path) -> np.ndarray:
    """Read a picture: red, green and blue (row, column, 3) in [0, 1]; what is transparent is white.

    A camera that was turned says so in the file (EXIF): rows and columns are those that a viewer shows.

    Raises
    ------
    CalibError : no such file, no picture of a known kind, damaged, or too large
    """
    path = Path(path)
    if not path.is_file():
        raise CalibError(f"{path}: no such file")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # Pillow warns of what it cannot make out
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # the bound below is smaller
            with Image.open(path, formats=FORMATS) as stored:
                columns, rows = stored.size
                if columns * rows > MAX_PICTURE_PIXELS:
                    raise CalibError(_too_large(path, f"{columns} x {rows} pixels"))
                picture = ImageOps.exif_transpose(stored)
                if picture.mode.startswith("I") or picture.mode == "F":
                    grey = np.asarray(picture, dtype=float)
                    return np.repeat((grey / max(float(grey.max()), 1.0))[:, :, None], 3, axis=2)
                whole = np.asarray(picture.convert("RGBA"), dtype=float) / 255.0
    except UnidentifiedImageError as error:
        raise CalibError(f"{path}: not a readable picture; expected {', '.join(FORMATS)}") from error
    except Image.DecompressionBombError as error:  # before the size can be asked for
        raise CalibError(_too_large(path, f"more than {2 * (Image.MAX_IMAGE_PIXELS or 0)} pixels")) from error
    except (OSError, ValueError, SyntaxError, EOFError, TypeError, IndexError, KeyError, OverflowError, MemoryError,
            struct.error, zlib.error, Warning) as error:  # fmt: skip
        raise CalibError(f"{path}: a damaged picture ({error}); make it again") from error
    light = whole[:, :, :3] * whole[:, :, 3:] + 1.0 - whole[:, :, 3:]
    if min(light.shape[:2]) < 8:
        raise CalibError(f"{path}: a picture of {columns} x {rows} pixels shows no curve; give a larger one")
    return light


def _too_large(path: Path, size: str) -> str:
    bound = f"the bound of {MAX_PICTURE_PIXELS / 1e6:g} million pixels"
    return f"{path}: a picture of {size} exceeds {bound}; cut out the figure, or scan it at fewer dots per inch"
