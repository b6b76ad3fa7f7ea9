"""The admissible window of a calibrated study, for the prompt and the notebook."""

import base64
import html
from pathlib import Path

from calib.confidence.window.artifacts import WINDOW_DATA
from calib.confidence.window.document import WindowResult
from calib.confidence.window.words import alone, share_in_words, together
from calib.execution.netcdf import read_dataset
from calib.report.plots.window import window_figure
from calib.workflows.plot import Plot


class AdmissibleWindow:
    """Where in the box of its parameters a model behaves as was measured.

    Attributes
    ----------
    summary : the `WindowResult` of window.json
    data : the Dataset of window.nc

    Parameters
    ----------
    folder : of the results
    """

    def __init__(self, summary: WindowResult, folder: Path):
        self.summary = summary
        self.data = read_dataset(folder / WINDOW_DATA)

    def plot(self) -> Plot:
        """Slices and projections, coloured by what bounds the window."""
        return Plot(window_figure(self.summary, self.data))

    def __repr__(self) -> str:
        own = self.summary
        lines = [f"window of {own.name!r}: {share_in_words(own)}"]
        lines += [f"  {one.name}: alone {alone(one)}; together {together(one)}" for one in own.parameters]
        return "\n".join([*lines, *(f"  mind: {remark}" for remark in own.remarks)])

    def _repr_html_(self) -> str:
        picture = base64.b64encode(self.plot()._repr_png_()).decode()
        return f'<pre>{html.escape(repr(self))}</pre><img alt="window" src="data:image/png;base64,{picture}">'
