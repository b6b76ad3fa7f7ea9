"""A report as it was written, without the minute."""

import re
from pathlib import Path


def page_content(path: Path) -> str:
    """Return the text of a report, of which only the time of writing is left out."""
    text, count = re.subn(r"\d{4}-\d\d-\d\d \d\d:\d\d UTC", "", path.read_text(encoding="utf-8"))
    assert count == 1
    return text
