"""Addresses of views, and what is said of them and of their failures: without passwords."""

import re
from urllib.parse import unquote

from calib.errors import CalibError

JOURNAL_VIEW = "journal"  # address of the journal file in the study's folder
USER = re.compile(
    r"(?<=://)([^:/@]*):(.*)@"
)  # name and password; a password that is not escaped may hold any character
QUERY = re.compile(r"([?&][^=&]*(?:password|passwd|pwd|secret|token)[^=&]*=)([^&]*)", flags=re.IGNORECASE)
DELIMITERS = re.compile("[@:/?#&{}]")  # a password that is not escaped is cut there when its address is read
MIN_PIECE_CHARACTERS = 3  # of a password that was cut: shorter ones stand in many words
HIDDEN = "***"
POSTGRESQL = "postgresql"  # how its addresses begin, and the extra of calib that installs a driver
DRIVER = "psycopg"  # which that is


def address_without_password(view: str) -> str:
    """Address of a view, its passwords replaced by asterisks."""
    return QUERY.sub(rf"\1{HIDDEN}", USER.sub(rf"\1:{HIDDEN}@", view))


def without_password(text: str, view: str) -> str:
    """Return a text, such as the message of a driver, without the passwords in the address of `view`."""
    stated = [match[2] for pattern in (USER, QUERY) for match in pattern.finditer(view)]
    secrets = {text for password in stated for text in (password, unquote(password)) if text}
    pieces = {piece for password in secrets for piece in DELIMITERS.split(password)}
    secrets |= {piece for piece in pieces if len(piece) >= MIN_PIECE_CHARACTERS}
    for secret in sorted(secrets, key=len, reverse=True):
        text = text.replace(secret, HIDDEN)
    return text


def failure_reason(error: BaseException, view: str) -> str:
    """Return why a view failed, on one line and without its password: what the driver says, or how to install it."""
    chain = [error]
    while (cause := chain[-1].__cause__) is not None:
        chain.append(cause)
    if view.startswith(POSTGRESQL) and any(isinstance(one, ImportError) for one in chain):
        return (
            f'the driver of its address is not installed; pip install "calib[{POSTGRESQL}]" and begin the address '
            f"with {POSTGRESQL}+{DRIVER}://"
        )
    # SQLAlchemy's exceptions have that of the driver as `orig`, and add the statement and its values to the message
    own = next((said for one in reversed(chain) if (said := getattr(one, "orig", None)) is not None), chain[-1])
    text = " ".join(str(own).split())
    return without_password(text if isinstance(own, CalibError) else f"{type(own).__name__}: {text}", view)
