"""Shapes of which the formula of a force is composed: functions of one argument with at most two numbers."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from calib.modelling.laws import force

MAX_TERMS, MAX_FACTORS = 4, 2  # of a formula, of a term  [count]
TERM_NUMBERS = 9  # of a term in a law: coefficient; code, argument and two numbers of each factor  [count]
(
    CONSTANT, EVEN_POWER, ODD_POWER, STEP, ABOVE, BELOW, POLE_BELOW, POLE_ABOVE, EXPONENTIAL, SINE, WELL, BUMP,
    STRIBECK, ODD_SINE,
) = range(14)  # fmt: skip


@njit(cache=True)
def shape_value(code: int, u: float, q: float, r: float) -> float:  # pragma: no cover - compiled
    """Value of a shape at u, which has the unit of q or r, where these are places or lengths.

    Codes and formulas stand in `SHAPES`; a pole that is reached is far away instead, so that a run does not end there.
    """
    if code == 1:
        return abs(u) ** q
    if code == 2:
        return np.sign(u) * abs(u / r) ** q
    if code == 3:
        return np.tanh(u / q)
    if code == 4:
        return max(0.0, u - q) ** r
    if code == 5:
        return max(0.0, q - u) ** r
    if code == 6:
        return max(1e-9 * abs(q), q + u) ** -r
    if code == 7:
        return max(1e-9 * abs(q), q - u) ** -r
    if code == 8:
        return np.exp(u / q)
    if code == 9:
        return np.sin(2.0 * np.pi * (u - r) / q)
    if code == 10:
        w = (u - q) / r
        return w * np.exp(-0.5 * w * w)
    if code == 11:
        w = (u - q) / r
        return np.exp(-0.5 * w * w)
    if code == 12:
        return np.tanh(u / q) * np.exp(-abs(u) / r)
    if code == 13:
        return np.sin(2.0 * np.pi * u / q)
    return 1.0


@force
def terms(t: float, x: float, v: float, p: np.ndarray, z: np.ndarray, dz: np.ndarray) -> float:
    """Return the force per unit mass [m/s^2] at x [m] and v [m/s]: sum of the terms whose coefficient is not zero.

    p holds for each term its coefficient, then for each of two factors code, argument (0 x, 1 v) and two numbers.
    """
    total = 0.0
    for k in range(MAX_TERMS):
        i = TERM_NUMBERS * k
        if p[i] != 0.0:
            one = shape_value(int(p[i + 1]), v if p[i + 2] == 1.0 else x, p[i + 3], p[i + 4])
            other = shape_value(int(p[i + 5]), v if p[i + 6] == 1.0 else x, p[i + 7], p[i + 8])
            total += p[i] * one * other
    return total


@njit(cache=True)
def shape_values(code: int, u: np.ndarray, q: float, r: float) -> np.ndarray:  # pragma: no cover - compiled
    """Values (n,) of a shape at u (n,)."""
    values = np.empty(u.size)
    for k in range(u.size):
        values[k] = shape_value(code, u[k], q, r)
    return values


@dataclass(frozen=True)
class Shape:
    """What is known of a shape beside its value.

    Attributes
    ----------
    lengths : of its two numbers, powers of the unit of the argument; None for one that it has not
    free : which of them are fitted; the others are held
    power : of the unit of the argument, of its value, by its numbers
    plain : of a program: text with {u}, {q}, {r}
    latex : the same as LaTeX
    code : the same as Python with numpy
    meanings : of its numbers
    """

    lengths: tuple[int | None, int | None]
    free: tuple[bool, bool]
    power: Callable[[float, float], float]
    plain: str
    latex: str
    code: str
    meanings: tuple[str, str] = ("", "")


def _none(q: float, r: float) -> float:
    return 0.0


SHAPES: dict[int, Shape] = {
    CONSTANT: Shape((None, None), (False, False), _none, "1", "1", "1.0"),
    EVEN_POWER: Shape((0, None), (False, False), lambda q, r: q, "|{u}|^{q}", "|{u}|^{{{q}}}", "abs({u}) ** {q}"),
    ODD_POWER: Shape(
        (0, 1), (True, False), _none, "sgn({u}) |{u}/{r}|^{q}",
        r"\operatorname{{sgn}}({u})\,\left|{u}/{r}\right|^{{{q}}}", "np.sign({u}) * abs({u} / {r}) ** {q}",
        ("exponent", "scale"),
    ),
    STEP: Shape(
        (1, None), (True, False), _none, "tanh({u}/{q})", r"\tanh({u}/{q})", "np.tanh({u} / {q})", ("scale", "")
    ),
    ABOVE: Shape(
        (1, 0), (True, False), lambda q, r: r, "max(0, {u} - {q})^{r}", r"\max(0, {u} - {q})^{{{r}}}",
        "max(0.0, {u} - {q}) ** {r}", ("place at which it begins", ""),
    ),
    BELOW: Shape(
        (1, 0), (True, False), lambda q, r: r, "max(0, {q} - {u})^{r}", r"\max(0, {q} - {u})^{{{r}}}",
        "max(0.0, {q} - {u}) ** {r}", ("place at which it begins", ""),
    ),
    POLE_BELOW: Shape(
        (1, 0), (True, False), lambda q, r: -r, "1/({q} + {u})^{r}", r"({q} + {u})^{{-{r}}}", "({q} + {u}) ** -{r}",
        ("distance of the pole", ""),
    ),
    POLE_ABOVE: Shape(
        (1, 0), (True, False), lambda q, r: -r, "1/({q} - {u})^{r}", r"({q} - {u})^{{-{r}}}", "({q} - {u}) ** -{r}",
        ("distance of the pole", ""),
    ),
    EXPONENTIAL: Shape(
        (1, None), (True, False), _none, "exp({u}/{q})", r"\exp({u}/{q})", "np.exp({u} / {q})", ("decay length", "")
    ),
    SINE: Shape(
        (1, 1), (True, True), _none, "sin(2 pi ({u} - {r})/{q})", r"\sin\frac{{2\pi({u} - {r})}}{{{q}}}",
        "np.sin(2.0 * np.pi * ({u} - {r}) / {q})", ("wavelength", "place of a zero"),
    ),
    ODD_SINE: Shape(
        (1, None), (True, False), _none, "sin(2 pi {u}/{q})", r"\sin\frac{{2\pi {u}}}{{{q}}}",
        "np.sin(2.0 * np.pi * {u} / {q})", ("wavelength", ""),
    ),
    WELL: Shape(
        (1, 1), (True, True), _none, "({u} - {q})/{r} exp(-(({u} - {q})/{r})^2/2)",
        r"\frac{{{u} - {q}}}{{{r}}}\,e^{{-({u} - {q})^2/(2 {r}^2)}}",
        "(({u} - {q}) / {r}) * np.exp(-0.5 * (({u} - {q}) / {r}) ** 2)", ("place of the middle", "width"),
    ),
    BUMP: Shape(
        (1, 1), (True, True), _none, "exp(-(({u} - {q})/{r})^2/2)",
        r"e^{{-({u} - {q})^2/(2 {r}^2)}}", "np.exp(-0.5 * (({u} - {q}) / {r}) ** 2)",
        ("place of the middle", "width"),
    ),
    STRIBECK: Shape(
        (1, 1), (True, True), _none, "tanh({u}/{q}) exp(-|{u}|/{r})", r"\tanh({u}/{q})\, e^{{-|{u}|/{r}}}",
        "np.tanh({u} / {q}) * np.exp(-abs({u}) / {r})", ("scale", "decay length"),
    ),
}  # fmt: skip
