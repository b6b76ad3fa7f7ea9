"""The diagnosis of a calibrated study, for the prompt and the notebook."""

import html
from pathlib import Path
from typing import TYPE_CHECKING

from calib.diagnosis.document import DiagnosisResult
from calib.errors import CalibError
from calib.workflows.texts import diagnosis_text

if TYPE_CHECKING:
    from calib.workflows.study import Calibration, Study


class Diagnosed:
    """The diagnosis of a calibrated study.

    Attributes
    ----------
    summary : the `DiagnosisResult` of diagnosis.json
    calibration : that was diagnosed
    """

    def __init__(self, summary: DiagnosisResult, extended: "Study | None", calibration: "Calibration"):
        self.summary, self._extended, self.calibration = summary, extended, calibration

    @property
    def verdict(self) -> str:
        """Return "named", "one_of", "none", "unexplained" or "not_diagnosable"."""
        return self.summary.verdict

    @property
    def causes(self) -> list[str]:
        """Names of the effects that are named; empty where none is, or one of several (`summary.classes`)."""
        return list(self.summary.causes)

    def apply(self) -> "Study":
        """Return the study with the causes, of several the simplest, in its model.

        Raises
        ------
        CalibError : no effect of the model was named
        """
        if self._extended is None:
            raise CalibError(
                f"there is nothing to apply: the verdict is {self.verdict!r}, without an effect for the model"
            )
        return self._extended

    def report(self, path: str | Path) -> Path:
        """Write the page of the study, the diagnosis in it."""
        return self.calibration.report(path)

    def __repr__(self) -> str:
        return diagnosis_text(self.calibration.summary.name, self.summary)

    def _repr_html_(self) -> str:
        causes = f": {html.escape(', '.join(self.causes))}" if self.causes else ""
        return f"<b>{html.escape(self.verdict)}</b>{causes}<p>{html.escape(self.summary.summary)}</p>"
