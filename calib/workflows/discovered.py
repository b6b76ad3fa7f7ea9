"""The force that was found in a calibrated study, for the prompt and the notebook."""

import base64
import html

from calib.diagnosis.discovery.document import DiscoveryResult
from calib.diagnosis.discovery.place import AT_INTERFACE
from calib.errors import CalibError
from calib.report.plots.found_force import found_force_figure
from calib.workflows.plot import Plot


class Discovered:
    """The search of a calibrated study for a force law.

    Attributes
    ----------
    summary : the `DiscoveryResult` of discovery.json
    name : of the study
    """

    def __init__(self, summary: DiscoveryResult, name: str):
        self.summary, self.name = summary, name

    @property
    def verdict(self) -> str:
        """Return "found", "nothing", "undetermined" or "not_diagnosable"."""
        return self.summary.verdict

    def plot(self) -> Plot:
        """Force over the visited region with its 95 % band.

        Raises
        ------
        CalibError : none was found
        """
        figure = found_force_figure(self.summary)
        if figure is None:
            raise CalibError(f"there is no force to plot: the verdict is {self.verdict!r}")
        return Plot(figure)

    def __repr__(self) -> str:
        found = self.summary
        names = [AT_INTERFACE[a] if found.interface else a for a in found.arguments]
        place = f"at the {found.body}" if found.interface else f"on {found.body}"
        where = f": force {place} over {', '.join(names)}" if found.body else ""
        return f"force law of {self.name!r}: {self.verdict}{where}\n  {self.summary.summary}"

    def _repr_html_(self) -> str:
        text = f"<b>{html.escape(self.verdict)}</b><p>{html.escape(self.summary.summary)}</p>"
        if not self.summary.functions:
            return text
        shown = base64.b64encode(self.plot()._repr_png_()).decode()
        return f'{text}<img alt="force over the visited region" src="data:image/png;base64,{shown}">'
