"""A formula, typeset."""

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.mathtext import MathTextParser

from calib.report.plots.style import STYLE, Look

TERMS_OF_A_LINE = 2  # of a formula  [count]
POINTS_PER_INCH = 72.0  # of a figure, whose size is in inches  [1/inch]
SIZE, LEADING, MARGIN = 13.0, 7.0, 1.0  # of letters, between lines, around all  [points]


def formula_lines(latex: str) -> list[str]:
    """Formula in lines of a few terms each, in matplotlib's notation of mathematics."""
    terms = [f"c_{{{own}" for own in latex.removeprefix("c_{").split(" + c_{")]
    lines = [terms[k : k + TERMS_OF_A_LINE] for k in range(0, len(terms), TERMS_OF_A_LINE)]
    return [f"${'+' if k else ''}{' + '.join(line)}$" for k, line in enumerate(lines)]


def formula_figure(latex: str) -> Figure:
    """Formula alone, as large as it is."""
    lines = formula_lines(latex)
    with mpl.rc_context({**STYLE, "mathtext.fontset": "stix"}):
        font, parser = FontProperties(size=SIZE), MathTextParser("path")
        sizes = [parser.parse(line, dpi=POINTS_PER_INCH, prop=font)[:3] for line in lines]  # width, height, depth
        width = max(size[0] for size in sizes) + 2.0 * MARGIN
        height = sum(size[1] for size in sizes) + LEADING * (len(lines) - 1) + 2.0 * MARGIN
        figure = Figure(figsize=(width / POINTS_PER_INCH, height / POINTS_PER_INCH))
        top = height - MARGIN
        for line, (_, own, depth) in zip(lines, sizes, strict=True):
            look: Look = {"fontproperties": font, "math_fontfamily": "stix", "parse_math": True}
            figure.text(MARGIN / width, (top - own + depth) / height, line, **look)
            top -= own + LEADING
    return figure
