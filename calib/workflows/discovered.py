"""The force that was found in a calibrated study, for the prompt and the notebook."""

import base64
import html
from collections.abc import Sequence
from typing import TYPE_CHECKING

from calib.diagnosis.discovery.document import DiscoveryResult, FormulaResult, NumberResult
from calib.diagnosis.discovery.place import AT_INTERFACE
from calib.errors import CalibError
from calib.report.plots.found_force import found_force_figure
from calib.units import plain_number
from calib.workflows.plot import Plot

if TYPE_CHECKING:
    from calib.workflows.study import Study


class Discovered:
    """The search of a calibrated study for a force law.

    Attributes
    ----------
    summary : the `DiscoveryResult` of discovery.json
    name : of the study
    """

    def __init__(self, summary: DiscoveryResult, name: str, extended: "Study | None" = None):
        self.summary, self.name, self._extended = summary, name, extended

    @property
    def verdict(self) -> str:
        """Return "found", "nothing", "undetermined" or "not_diagnosable"."""
        return self.summary.verdict

    @property
    def formula(self) -> FormulaResult | None:
        """Formula of the force; None where none predicts as well as the free function."""
        return self.summary.formula

    @property
    def extended(self) -> "Study":
        """Study with the force in its model, as an effect file of its own.

        Raises
        ------
        CalibError : no force was found, or it was not applied
        """
        if self._extended is None:
            raise CalibError(
                f"there is no extended study: the verdict is {self.verdict!r}, and `discover(apply=True)` writes one "
                "where a force is found"
            )
        return self._extended

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
        formula = f"\n  {found.formula.equation}" if found.formula is not None else ""
        law = f"\n  {found.histories[0].text}" if found.depends_on_history else ""
        return f"force law of {self.name!r}: {self.verdict}{where}\n  {found.summary}{formula}{law}"

    def _repr_html_(self) -> str:
        text = f"<b>{html.escape(self.verdict)}</b><p>{html.escape(self.summary.summary)}</p>"
        if self.summary.formula is not None:
            text += formula_html(self.summary.formula)
        if self.summary.depends_on_history:
            law = self.summary.histories[0]
            text += f"<p>{html.escape(law.effect)}: {html.escape(law.equation)}</p>{numbers_html(law.numbers)}"
        if not self.summary.functions:
            return text
        shown = base64.b64encode(self.plot()._repr_png_()).decode()
        return f'{text}<img alt="force over the visited region" src="data:image/png;base64,{shown}">'


def formula_html(formula: FormulaResult) -> str:
    """Formula as LaTeX, which a notebook typesets, with a table of its numbers."""
    return f"<p>$${html.escape(formula.latex)}$$</p>{numbers_html(formula.numbers)}"


def numbers_html(numbers: Sequence[NumberResult]) -> str:
    """Table of the numbers of a formula or a law."""
    rows = "".join(
        f"<tr><td>{n.name}</td><td>{plain_number(n.value)}</td>"
        f"<td>{'' if n.error is None else plain_number(n.error, 1)}</td>"
        f"<td>{html.escape(n.unit)}</td><td>{html.escape(n.meaning)}</td></tr>"
        for n in numbers
    )
    heads = "<tr><th></th><th>value</th><th>std. error</th><th>unit</th><th></th></tr>"
    return f"<table>{heads}{rows}</table>"
