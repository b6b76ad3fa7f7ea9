"""Texts that are looked for in the lines of a file, as a user states them."""

import re
from collections.abc import Callable, Sequence

from calib.errors import CalibError


def text_pattern(text: str) -> re.Pattern[str]:
    """Return what finds a text: itself or, of "/.../", the regular expression between the slashes.

    Raises
    ------
    CalibError : an empty text, or no regular expression
    """
    if not text.strip("/"):
        raise CalibError('expected a text that is not empty, such as "ERROR"')
    if not is_regular(text):
        return re.compile(re.escape(text))
    try:
        return re.compile(text[1:-1])
    except (re.error, RecursionError, OverflowError) as error:
        raise CalibError(f"{text!r} is no regular expression ({error}); mend it") from error


def is_regular(text: str) -> bool:
    """Whether a text stands for a regular expression."""
    return len(text) > 2 and text.startswith("/") and text.endswith("/")


def comment_test(stated: str | Sequence[str]) -> Callable[[str], bool]:
    """Return what says whether a line is a comment.

    Parameters
    ----------
    stated : characters, each of which makes a line a comment that begins with it; or a list of texts, each of which
        makes one a comment that begins with it behind any blanks, and of which "/.../" is a regular expression that is
        looked for in the whole line

    Raises
    ------
    CalibError : an empty text in a list, or no regular expression
    """
    if isinstance(stated, str):
        characters = tuple(stated)
        return lambda line: line.startswith(characters)
    patterns = [(text_pattern(text), is_regular(text)) for text in stated]

    def is_comment(line: str) -> bool:
        begin = len(line) - len(line.lstrip())
        return any(pattern.search(line) if regular else pattern.match(line, begin) for pattern, regular in patterns)

    return is_comment
