"""Coverage of each pixel by the ink of one colour."""

import numpy as np

MAX_COLOUR_DEVIATION = 0.3  # from mixtures of ink and paper, over the difference between the pixel and paper
COMPRESSION_GRAIN = 0.04  # the same deviation as image compression makes it, over the difference between ink and paper
MAX_COVERAGE = 1.25  # coverage above which a pixel is of a darker ink
MIN_CONTRAST = 0.08  # difference of colours [0, sqrt 3] below which ink is indistinguishable from paper


def paper(light: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Colour (3,) of most of the panel."""
    return np.median(light[inside], axis=0)


def coverage(light: np.ndarray, ink: np.ndarray, paper: np.ndarray) -> np.ndarray:
    """Share (row, column) of each pixel that is ink: 1 within a line, between 0 and 1 at its edges, 0 elsewhere.

    A pixel's colour is paper + share (ink - paper) where nothing else is; the colour of another ink lies off that line.

    Parameters
    ----------
    light : (row, column, 3) in [0, 1]
    ink, paper : (3,)
    """
    along = ink - paper
    length = np.linalg.norm(along)
    away = light - paper
    share = away @ along / length**2
    off = np.linalg.norm(away - share[:, :, None] * along, axis=2) / length
    return np.where(
        (off < MAX_COLOUR_DEVIATION * share + COMPRESSION_GRAIN) & (share < MAX_COVERAGE), np.clip(share, 0.0, 1.0), 0.0
    )
