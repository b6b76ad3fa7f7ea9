"""A function that compiles a kernel in whichever process calls it."""

from numba import njit


@njit
def _sum(numbers):
    total = 0.0
    for number in numbers:
        total += number
    return total


def total(numbers):
    return _sum(numbers)
