"""The picture of a figure, as it is seen."""

import numpy as np
import pytest
from PIL import Image

from calib.digitise.image import read_picture

UPRIGHT = np.random.default_rng(0).integers(0, 255, (24, 40, 3), dtype=np.uint8)
STORED = {  # EXIF orientation: what is stored of a picture that is seen upright
    1: UPRIGHT,
    3: np.rot90(UPRIGHT, 2),
    6: np.rot90(UPRIGHT),
    8: np.rot90(UPRIGHT, -1),
}

QUALITY = {"jpg": {"quality": 100, "subsampling": 0}}


@pytest.mark.parametrize("orientation", STORED)
@pytest.mark.parametrize("form", ["jpg", "png", "tif"])
def test_a_picture_is_read_as_a_viewer_shows_it(tmp_path, orientation, form):
    """A camera stores the picture as its sensor lies, and beside it how it was held."""
    exif = Image.Exif()
    exif[0x0112] = orientation
    Image.fromarray(STORED[orientation]).save(tmp_path / f"p.{form}", exif=exif, **QUALITY.get(form, {}))
    seen = read_picture(tmp_path / f"p.{form}")
    assert seen.shape == UPRIGHT.shape
    assert np.abs(seen - UPRIGHT / 255.0).mean() < 0.02


def test_a_grey_picture_of_16_bits_is_turned_too(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6
    grey = UPRIGHT[:, :, 0].astype(np.uint16) * 256
    Image.fromarray(np.ascontiguousarray(np.rot90(grey))).save(tmp_path / "p.png", exif=exif)
    np.testing.assert_allclose(read_picture(tmp_path / "p.png")[:, :, 1], grey / grey.max())
