"""What the user can mend: everything else is a status in the data or a bug."""

import difflib
import re
from collections.abc import Iterable

CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")  # all but tab and line end


class CalibError(Exception):
    """A mistake in what the user gave; the message says what was expected, what came and what to do.

    Control characters in it, as a damaged file may hold, are written as escapes, lest a terminal obeys them.
    """

    def __str__(self) -> str:
        """The message."""
        return CONTROL.sub(lambda match: ascii(match[0])[1:-1], super().__str__())


class FirstRunFailed(CalibError):
    """The run that is made before a search has failed: nothing was simulated."""


class FirstTrialsFailed(CalibError):
    """The first trials of a search have all failed with one exception: nothing was simulated, the trials are kept."""


class WorkersLost(CalibError):
    """The workers that evaluate can be reached no longer: the run ends as if it was killed, and can go on."""


class CodeChanged(CalibError):
    """A file or program that decides records has changed since the study was read: the run ends as if it was killed."""


def nearest(name: str, known: Iterable[str]) -> str:
    """Return ``" (did you mean 'alpha'?)"`` for the known name most like `name`, or an empty string."""
    known = list(known)
    close = [one for one in known if str(one).lower() == str(name).lower()] or difflib.get_close_matches(
        str(name), known, 1
    )
    return f" (did you mean {close[0]!r}?)" if close else ""
