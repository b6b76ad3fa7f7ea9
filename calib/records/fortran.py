"""Numbers as Fortran writes them."""

import re

# 1.0D+03, and 1.234-105, where an exponent of three digits takes the place of its letter
NUMBER = re.compile(r"([+-]?(?:\d+\.\d*|\.\d+|\d+(?=[dD])))(?:[dD]([+-]?\d+)|([+-]\d{3}))")
OVERFLOW = re.compile(r"\*+")  # of a number that does not fit into its field


def fortran_value(text: str) -> float | None:
    """Value of a number with one of the exponents that only Fortran writes; None for any other text."""
    match = NUMBER.fullmatch(text.strip())
    return float(f"{match[1]}e{match[2] or match[3]}") if match else None


def overflowed(text: str) -> bool:
    """Whether a field is filled with asterisks because its number did not fit."""
    return OVERFLOW.fullmatch(text.strip()) is not None
