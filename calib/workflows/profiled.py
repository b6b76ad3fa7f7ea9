"""The profiles of a calibrated study, for the prompt and the notebook."""

import base64
import html
from collections.abc import Mapping

from calib.confidence.document import ConfidenceResult
from calib.confidence.profile import WINDOW_END
from calib.report.plots.profiles import profiles_figure
from calib.units import shown
from calib.workflows.plot import Plot


class Profiled:
    """How sure the calibrated values of a study are, by profiles of the likelihood.

    Attributes
    ----------
    summary : the `ConfidenceResult` of confidence.json
    """

    def __init__(self, summary: ConfidenceResult):
        self.summary = summary

    @property
    def intervals(self) -> Mapping[str, tuple[float, float]]:
        """Parameter -> (low, high) of its interval [SI]; an open one ends with its window."""
        return {profile.name: (profile.low.value, profile.high.value) for profile in self.summary.profiles}

    def plot(self) -> Plot:
        """Likelihood ratio over each parameter, and contours of the pairs."""
        return Plot(profiles_figure(self.summary))

    def __repr__(self) -> str:
        own = self.summary
        lines = [f"{own.level:.1%} intervals of {own.name!r}, by profiles of the likelihood"]
        for profile in own.profiles:
            ends = " .. ".join(
                "open" if end.cause == WINDOW_END else shown(end.value, profile.unit)
                for end in (profile.low, profile.high)
            )
            lines.append(f"  {profile.name} = {shown(profile.value, profile.unit)}: {ends}; {profile.text}")
        return "\n".join([*lines, *(f"  mind: {remark}" for remark in own.remarks)])

    def _repr_html_(self) -> str:
        picture = base64.b64encode(self.plot()._repr_png_()).decode()
        return f'<pre>{html.escape(repr(self))}</pre><img alt="profiles" src="data:image/png;base64,{picture}">'
