"""A figure that shows itself in a notebook."""

from pathlib import Path

from matplotlib.figure import Figure

from calib.errors import CalibError
from calib.report.plots.style import png


class Plot:
    """A figure that shows itself in a notebook.

    Attributes
    ----------
    figure : of matplotlib
    """

    def __init__(self, figure: Figure):
        self.figure = figure

    def save(self, path: str | Path) -> Path:
        """Write the figure as PNG, SVG or PDF, by the suffix."""
        try:
            self.figure.savefig(path)
        except (OSError, ValueError) as error:
            raise CalibError(f"{path} cannot be written: {error}") from error
        return Path(path)

    def __repr__(self) -> str:
        width, height = self.figure.get_size_inches()
        axes = [f"{one.get_ylabel()} over {one.get_xlabel()}" for one in self.figure.axes if one.get_xlabel()]
        return f"plot of {width:g} x {height:g} in: {'; '.join(axes)}\n  save('plot.png') writes it"

    def _repr_png_(self) -> bytes:
        return png(self.figure)
