"""Studies, results and diagnoses as text, for the prompt and for print."""

import base64
import html
from collections.abc import Iterator, Mapping
from typing import Any

from calib.diagnosis.document import DiagnosisResult
from calib.report.formatting import measured_number
from calib.study.result import CalibrationResult
from calib.units import count, reading


def study_text(document: Mapping[str, Any]) -> str:
    """Write what is simulated, compared and searched, a line each."""
    study, model = document["study"], document["model"]
    effects = [entry if isinstance(entry, str) else entry["name"] for entry in model.get("effects", ())]
    windows = [
        f"{name} from {window.get('low')} to {window.get('high')}" for name, window in document["windows"].items()
    ]
    return "\n".join(
        [
            f"study {study['name']!r}, {count(study['budget'], 'trial')}",
            f"  model: {' + '.join([model['simulator'], *effects])}",
            f"  records: {', '.join(entry['name'] for entry in document['record'])}",
            f"  searched: {', '.join(windows)}",
        ]
    )


def calibration_text(summary: CalibrationResult) -> str:
    """Write kind and score of the best motion, and each parameter with its interval."""
    lines = [f"calibration of {summary.name!r}: {headline(summary)}"]
    for name, value, interval in parameter_rows(summary):
        lines.append(f"  {name} = {value} ({interval if interval == 'fixed' else f'95 % interval: {interval}'})")
    if not summary.values:
        lines += [f"  {count(kind.trials, 'trial')} {kind.status}: {kind.reason}" for kind in summary.failures]
    return "\n".join(lines)


def diagnosis_text(name: str, diagnosis: DiagnosisResult) -> str:
    """Write the verdict of a diagnosis on a study, the causes, and the reason."""
    causes = ", ".join(diagnosis.causes) or " or ".join(" + ".join(names) for names in diagnosis.classes)
    return f"diagnosis of {name!r}: {diagnosis.verdict}{f': {causes}' if causes else ''}\n  {diagnosis.full_summary}"


def headline(summary: CalibrationResult) -> str:
    """Write the kind of the best motion, or that there is none, and its score."""
    total = summary.score.total
    return f"{summary.motion.kind or summary.status}{'' if total is None else f', score {total:.4g}'}"


def parameter_rows(summary: CalibrationResult) -> Iterator[tuple[str, str, str]]:
    """Name, value and 95 % interval of each parameter; digits as the standard error justifies them."""
    for name, value in summary.values.items():
        ends, confidence = summary.intervals.get(name), summary.confidence
        factor, unit = reading(summary.units[name], value)
        error = None if confidence is None else confidence.standard_error.get(name)
        texts = [
            f"{measured_number(factor * number, None if error is None else factor * error)} {unit}".rstrip()
            for number in (value, *(ends or ()))
        ]
        yield name, texts[0], "fixed" if name not in summary.windows else " to ".join(texts[1:]) or "none"


def calibration_html(summary: CalibrationResult, unfinished: bool, picture: bytes) -> str:
    """What a notebook shows of a calibration.

    Parameters
    ----------
    unfinished : whether the search has not ended
    picture : PNG of measured and simulated motion; empty for none
    """
    rows = "".join(
        f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in row)}</tr>" for row in parameter_rows(summary)
    )
    notes = [*(["the search has not ended"] if unfinished else []), *summary.remarks]
    shown = base64.b64encode(picture).decode()
    return (
        f"<b>{html.escape(summary.name)}</b>: {html.escape(headline(summary))}"
        f"<table><tr><th>parameter</th><th>value</th><th>95 % interval</th></tr>{rows}</table>"
        + "".join(f"<p>{html.escape(note)}</p>" for note in notes)
        + (f'<img alt="measured and simulated" src="data:image/png;base64,{shown}">' if shown else "")
    )
