"""The sensitivity of a study, for the prompt and the notebook."""

import base64
import html

from calib.report.plots.sensitivity import sensitivity_figure
from calib.sweep.sensitivity import SensitivityResult
from calib.sweep.sensitivity.words import in_words, moving, shares_in_words, title
from calib.workflows.plot import Plot


class Sensitivity:
    """Which parameter moves which feature of a study's motion.

    Attributes
    ----------
    summary : the `SensitivityResult` of sensitivity.json
    """

    def __init__(self, summary: SensitivityResult):
        self.summary = summary

    def plot(self) -> Plot:
        """Shares of the kinds of motion, and the influence of every parameter on every output."""
        return Plot(sensitivity_figure(self.summary))

    def __repr__(self) -> str:
        found = self.summary
        lines = [f"sensitivity of {found.name!r} ({found.method}, {found.points} points)"]
        lines += [f"  {line}" for line in shares_in_words(found)]
        for output in found.outputs:
            moved = "; ".join(in_words(one, output) for one in moving(output)) or output.reason
            lines.append(f"  {title(output, len(found.measured_kind))}: {moved}")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        shown = base64.b64encode(self.plot()._repr_png_()).decode()
        shares = html.escape("; ".join(shares_in_words(self.summary)))
        return f'<p>{shares}</p><img alt="influence of parameters" src="data:image/png;base64,{shown}">'
