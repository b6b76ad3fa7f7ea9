"""The terms of which the formula of a force may be composed, over the region that the records visit.

Numbers of a shape that make it nonlinear stand on a grid over the region; the best are refined afterwards.
"""

import itertools
from collections.abc import Iterator, Mapping

import numpy as np

from calib.diagnosis.discovery.formula import Factor, FormulaTerm
from calib.diagnosis.discovery.free_force import DISPLACEMENT, VELOCITY
from calib.diagnosis.discovery.shapes import (
    ABOVE,
    BELOW,
    BUMP,
    EVEN_POWER,
    EXPONENTIAL,
    ODD_POWER,
    ODD_SINE,
    POLE_ABOVE,
    POLE_BELOW,
    SINE,
    STEP,
    STRIBECK,
    WELL,
)

Region = Mapping[str, tuple[float, float]]  # argument -> least and largest value
FREE = (-np.inf, np.inf)
MAX_DEGREE = 5  # of a product of powers  [1]
EXPONENTS = (0.35, 0.5, 0.75, 1.5, 2.5, 3.5)  # at which a free one is tried  [1]
EXPONENT_BOUNDS = (0.3, 7.0)  # a lower one nearly jumps at zero, as a tanh does, where it takes thousands of steps  [1]
STEP_SCALES = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0)  # of tanh, over the largest value of the argument  [1]
STOP_PLACES = 12  # inside the region  [count]
STOP_EXPONENTS = (1.0, 1.5, 2.0, 3.0)  # [1]
POLE_DISTANCES = (0.05, 0.15, 0.4, 1.0, 2.5)  # beyond the region, over its width  [1]
POLE_EXPONENTS = (1.0, 2.0, 3.0, 4.0)  # [1]
DECAY_LENGTHS = (0.1, 0.25, 0.6, 1.5)  # over the width of the region  [1]
WAVELENGTHS = np.geomspace(0.15, 1.5, 12)  # over the width of the region  [1]
WAVE_PHASES = (0.0, 0.125, 0.25, 0.375)  # of half a period  [wavelengths]
WELL_PLACES, WELL_WIDTHS = 12, (0.04, 0.08, 0.15, 0.3)  # inside the region [count], over its width  [1]
STRIBECK_LENGTHS = (0.03, 0.1, 0.3)  # over the largest value of the argument  [1]


def dictionary(arguments: tuple[tuple[str, ...], ...], region: Region) -> list[FormulaTerm]:
    """Terms over the arguments of additive functions.

    Parameters
    ----------
    arguments : of each function
    region : least and largest value of each argument
    """
    entries = [FormulaTerm((Factor(EVEN_POWER, DISPLACEMENT, (0.0, 1.0)),))]
    for argument in dict.fromkeys(a for own in arguments for a in own):
        entries += [FormulaTerm((factor,)) for factor in _of_one(argument, *region[argument])]
    if any(len(own) == 2 for own in arguments):
        entries += list(_products(region))
    return entries


def _powers(argument: str, degree: int) -> list[Factor]:
    """Even and odd powers up to a degree."""
    codes = ODD_POWER, EVEN_POWER
    return [Factor(code, argument, (float(n), 1.0), fixed=True) for n in range(1, degree + 1) for code in codes]


def _of_one(argument: str, low: float, high: float) -> Iterator[Factor]:
    """Shapes of one argument."""
    width, largest = high - low, max(abs(low), abs(high))
    yield from _powers(argument, MAX_DEGREE)
    scale = float(f"{largest:.1e}")
    for exponent in EXPONENTS:
        yield Factor(ODD_POWER, argument, (exponent, scale), (EXPONENT_BOUNDS, FREE))
    for share in STEP_SCALES:
        yield Factor(STEP, argument, (share * largest, 1.0), ((1e-4 * largest, 3.0 * largest), FREE))
    for share, sign in itertools.product(DECAY_LENGTHS, (-1.0, 1.0)):
        ends = sorted((sign * 0.03 * width, sign * 10.0 * width))
        yield Factor(EXPONENTIAL, argument, (sign * share * width, 1.0), ((ends[0], ends[1]), FREE))
    if argument == VELOCITY:
        for exponent in STOP_EXPONENTS[:3]:
            yield from _one_sided(argument, exponent)
        bounds = (1e-4 * largest, 3.0 * largest)
        for share, length in itertools.product(STEP_SCALES[:3:2], STRIBECK_LENGTHS):
            yield Factor(STRIBECK, argument, (share * largest, length * largest), (bounds, bounds))
    else:
        yield from _local(argument, low, high)


def _one_sided(argument: str, exponent: float) -> list[Factor]:
    """Powers of the positive part of an argument, and of its negative."""
    return [Factor(code, argument, (0.0, exponent), fixed=True) for code in (ABOVE, BELOW)]


def _local(argument: str, low: float, high: float) -> Iterator[Factor]:
    """Shapes that belong to a place: stops, poles, waves and wells."""
    width = high - low
    inside = low + width * np.linspace(0.0, 1.0, STOP_PLACES + 2)[1:-1]
    for place, exponent, code in itertools.product(inside, STOP_EXPONENTS, (ABOVE, BELOW)):
        yield Factor(code, argument, (float(place), exponent), ((low, high), FREE))
    for share, exponent in itertools.product(POLE_DISTANCES, POLE_EXPONENTS):
        for code, end in ((POLE_BELOW, -low), (POLE_ABOVE, high)):
            bounds = (end + 0.01 * width, end + 10.0 * width)
            yield Factor(code, argument, (end + share * width, exponent), (bounds, FREE))
    for share in WAVELENGTHS:
        yield Factor(ODD_SINE, argument, (float(share * width), 1.0), ((0.1 * width, 4.0 * width), FREE))
    for share, phase in itertools.product(WAVELENGTHS, WAVE_PHASES):
        length = float(share * width)
        places = (0.1 * width, 4.0 * width), (low - width, high + width)
        yield Factor(SINE, argument, (length, phase * length), places)
    inside = low + width * np.linspace(0.0, 1.0, WELL_PLACES + 2)[1:-1]
    for place, share, code in itertools.product(inside, WELL_WIDTHS, (WELL, BUMP)):
        yield Factor(code, argument, (float(place), share * width), ((low, high), (0.01 * width, width)))


def _products(region: Region) -> Iterator[FormulaTerm]:
    """Products of powers of both arguments, of their one-sided parts, and of a step of the velocity."""
    largest = max(abs(end) for end in region[VELOCITY])
    sides_x, sides_v = _one_sided(DISPLACEMENT, 1.0), _one_sided(VELOCITY, 1.0)
    for one, other in itertools.product(sides_x, [*sides_v, *_powers(VELOCITY, 2)]):
        yield FormulaTerm((one, other))
    for one, other in itertools.product(_powers(DISPLACEMENT, 2), sides_v):
        yield FormulaTerm((one, other))
    for i in range(1, MAX_DEGREE):
        for one in _powers(DISPLACEMENT, i)[-2:]:
            for j in range(1, MAX_DEGREE - i + 1):
                yield from (FormulaTerm((one, other)) for other in _powers(VELOCITY, j)[-2:])
            if i <= 2:
                for share in STEP_SCALES[1:4]:
                    bounds = ((1e-4 * largest, 3.0 * largest), FREE)
                    yield FormulaTerm((one, Factor(STEP, VELOCITY, (share * largest, 1.0), bounds)))
