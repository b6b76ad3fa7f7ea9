"""A formula of a force: a sum of at most four terms, each a coefficient times one or two shapes of its arguments."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calib.diagnosis.candidate import Candidate
from calib.diagnosis.discovery.free_force import DISPLACEMENT, SYMBOLS, VELOCITY
from calib.diagnosis.discovery.shapes import (
    ABOVE,
    BELOW,
    CONSTANT,
    EVEN_POWER,
    MAX_FACTORS,
    MAX_TERMS,
    ODD_POWER,
    SHAPES,
    Shape,
    shape_values,
    terms,
)
from calib.modelling.effect import Effect
from calib.modelling.parameter import Parameter

POWERS = {DISPLACEMENT: (1.0, 0.0), VELOCITY: (1.0, -1.0)}  # of metre and second, of an argument
LETTERS = "ab"  # of the numbers of a factor; those of a second factor are "de"
SECOND_LETTERS = "de"


@dataclass(frozen=True)
class Factor:
    """A shape of an argument with its numbers.

    Attributes
    ----------
    code : of the shape
    argument : "displacement" or "velocity"
    numbers : both, in SI; 1 where the shape has none
    bounds : of those that are free
    fixed : whether its numbers are held: a whole exponent of a power, a one-sided shape that begins at zero
    """

    code: int
    argument: str
    numbers: tuple[float, float] = (1.0, 1.0)
    bounds: tuple[tuple[float, float], tuple[float, float]] = ((-np.inf, np.inf), (-np.inf, np.inf))
    fixed: bool = False

    @property
    def shape(self) -> Shape:
        """What is known of its shape."""
        return SHAPES[self.code]

    @property
    def free(self) -> tuple[int, ...]:
        """Which of its numbers are fitted."""
        if self.fixed:
            return ()
        return tuple(k for k in range(2) if self.shape.free[k])

    @property
    def structure(self) -> tuple[object, ...]:
        """All but the values of its free numbers."""
        free = self.free
        return self.code, self.argument, *(None if k in free else n for k, n in enumerate(self.numbers))

    @property
    def power(self) -> float:
        """Power of the unit of its argument that its value has."""
        if self.code == ODD_POWER and self.fixed:
            return self.numbers[0]
        return self.shape.power(*self.numbers)

    def values(self, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Values (n,) at displacements [m] and velocities [m/s]."""
        u = np.ascontiguousarray(v if self.argument == VELOCITY else x, dtype=float)
        return shape_values(self.code, u, *self.numbers)

    def at(self, numbers: Mapping[int, float]) -> "Factor":
        """Return it with other numbers, by their place."""
        q, r = self.numbers
        return replace(self, numbers=(numbers.get(0, q), numbers.get(1, r)))

    def written(self, style: str, names: Sequence[str]) -> str:
        """Text of it as "plain", "latex" or "code".

        names : of its two numbers where they are free
        """
        u = SYMBOLS[self.argument]
        q, r = (name if k in self.free else f"{self.numbers[k]:g}" for k, name in enumerate(names))
        if self.code in (EVEN_POWER, ODD_POWER) and not self.free:
            return _power(u, int(self.numbers[0]), self.code == EVEN_POWER, style)
        if self.code in (ABOVE, BELOW) and self.fixed:
            return _one_sided(u if self.code == ABOVE else f"-{u}", r, style)
        text = {"plain": self.shape.plain, "latex": self.shape.latex, "code": self.shape.code}[style]
        written = text.format(u=u, q=q, r=r)
        return written.removesuffix("^1") if style == "plain" else written.replace("^{1}", "")


def _one_sided(u: str, exponent: str, style: str) -> str:
    """Power of the positive part of u."""
    if style == "code":
        return f"max(0.0, {u}) ** {exponent}"
    positive = f"max(0, {u})" if style == "plain" else rf"\max(0, {u})"
    if exponent == "1":
        return positive
    return f"{positive}^{exponent}" if style == "plain" else f"{positive}^{{{exponent}}}"


def _power(u: str, exponent: int, even: bool, style: str) -> str:
    """Power whose value is even or odd in u."""
    absolute = {"plain": f"|{u}|", "latex": f"|{u}|", "code": f"abs({u})"}[style]
    if exponent == 0:
        return "1.0" if style == "code" else "1"
    natural = even == (exponent % 2 == 0)
    if style == "code":
        factors = [u] * exponent if natural else [*([u] * (exponent - 1)), absolute]
        return " * ".join(factors)
    if natural:
        return _raised(u, exponent, style)
    if exponent == 1:
        return absolute
    if even:
        return _raised(absolute, exponent, style)
    space = " " if style == "plain" else r"\,"
    return f"{u}{space}{_raised(absolute, exponent - 1, style)}"


def _raised(base: str, exponent: int, style: str) -> str:
    if exponent == 1:
        return base
    return f"{base}^{exponent}" if style == "plain" else f"{base}^{{{exponent}}}"


@dataclass(frozen=True)
class FormulaTerm:
    """A coefficient times one or two factors.

    Attributes
    ----------
    factors : at most two
    coefficient : in SI
    """

    factors: tuple[Factor, ...]
    coefficient: float = 1.0

    @property
    def structure(self) -> tuple[object, ...]:
        """All but its values."""
        return tuple(factor.structure for factor in self.factors)

    @property
    def arguments(self) -> frozenset[str]:
        """On which it depends."""
        return frozenset(f.argument for f in self.factors if not (f.code == EVEN_POWER and f.numbers[0] == 0.0))

    @property
    def free(self) -> list[tuple[int, int]]:
        """Factor and place of each number beside the coefficient that is fitted."""
        return [(i, k) for i, factor in enumerate(self.factors) for k in factor.free]

    @property
    def unit(self) -> str:
        """Unit of the coefficient: of a force per unit mass over that of its factors."""
        metre, second = 1.0, -2.0
        for factor in self.factors:
            m, s = POWERS[factor.argument]
            metre, second = metre - m * factor.power, second - s * factor.power
        return unit_text(metre, second)

    def values(self, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Product of its factors (n,), without the coefficient."""
        product = np.ones(len(x))
        for factor in self.factors:
            product = product * factor.values(x, v)
        return product

    def with_whole_exponents(self) -> "FormulaTerm":
        """Return it with the nearest whole exponent in the place of a free one."""
        coefficient, factors = self.coefficient, []
        for factor in self.factors:
            if factor.code == ODD_POWER and not factor.fixed:
                exponent = max(1.0, float(round(factor.numbers[0])))
                coefficient /= factor.numbers[1] ** exponent
                factor = Factor(ODD_POWER, factor.argument, (exponent, 1.0), fixed=True)
            factors.append(factor)
        return FormulaTerm(tuple(factors), coefficient)

    def at(self, numbers: Sequence[float]) -> "FormulaTerm":
        """Return it with other free numbers, in the order of `free`."""
        new: dict[int, dict[int, float]] = {}
        for (i, k), number in zip(self.free, numbers, strict=True):
            new.setdefault(i, {})[k] = float(number)
        return replace(self, factors=tuple(f.at(new.get(i, {})) for i, f in enumerate(self.factors)))


def structure_of(terms: Sequence[FormulaTerm]) -> tuple[str, ...]:
    """All of a sum but its values, whatever the order of its terms."""
    return tuple(sorted(repr(term.structure) for term in terms))


def unit_text(metre: float, second: float) -> str:
    """Unit with these powers of metre and second: "1/(m^2 s^2)"."""
    above = [_unit_power(n, p) for n, p in (("m", metre), ("s", second)) if p > 0.0]
    below = [_unit_power(n, -p) for n, p in (("m", metre), ("s", second)) if p < 0.0]
    if not below:
        return " ".join(above) or "1"
    divisor = below[0] if len(below) == 1 else f"({' '.join(below)})"
    return f"{' '.join(above) or '1'}/{divisor}"


def _unit_power(name: str, power: float) -> str:
    return name if power == 1.0 else f"{name}^{power:g}"


@dataclass(frozen=True)
class Number:
    """A number of a formula.

    Attributes
    ----------
    name : in its text
    value : in SI
    unit : of it
    meaning : in words
    null : 0 for a coefficient, None for a number of a shape
    low, high : its bounds
    """

    name: str
    value: float
    unit: str
    meaning: str
    null: float | None = None
    low: float = -np.inf
    high: float = np.inf


@dataclass(frozen=True)
class Formula:
    """A sum of terms: force per unit mass  [m/s^2]."""

    terms: tuple[FormulaTerm, ...] = field(default=())

    @property
    def structure(self) -> tuple[str, ...]:
        """All but its values, whatever the order of its terms."""
        return structure_of(self.terms)

    @property
    def length(self) -> int:
        """How many numbers are fitted."""
        return sum(1 + len(term.free) for term in self.terms)

    def values(self, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Force per unit mass (n,) at displacements [m] and velocities [m/s]."""
        return sum((term.coefficient * term.values(x, v) for term in self.terms), np.zeros(len(x)))

    @property
    def coefficients(self) -> tuple[Number, ...]:
        """Coefficients of the terms, in their order."""
        return tuple(
            Number(f"c{k}", term.coefficient, term.unit, f"coefficient of {self._factors(term, k, 'plain', {})}", 0.0)
            for k, term in enumerate(self.terms, 1)
        )

    @property
    def shape_numbers(self) -> tuple[Number, ...]:
        """Numbers of the shapes that are fitted, in the order of the terms."""
        numbers = []
        for k, term in enumerate(self.terms, 1):
            for i, place in term.free:
                factor = term.factors[i]
                m, s = POWERS[factor.argument]
                power = factor.shape.lengths[place] or 0
                unit = unit_text(m * power, s * power)
                meaning = f"{factor.shape.meanings[place]} of term {k}"
                numbers.append(
                    Number(
                        _letter(i, place, k), factor.numbers[place], unit, meaning, None, *factor.bounds[place]
                    )  # fmt: skip
                )
        return tuple(numbers)

    @property
    def numbers(self) -> tuple[Number, ...]:
        """All numbers that are fitted."""
        return (*self.coefficients, *self.shape_numbers)

    def at(self, values: Mapping[str, float]) -> "Formula":
        """Return it with these values by name."""
        changed = []
        for k, term in enumerate(self.terms, 1):
            moved = term.at([values[_letter(i, place, k)] for i, place in term.free])
            changed.append(replace(moved, coefficient=float(values[f"c{k}"])))
        return Formula(tuple(changed))

    @property
    def text(self) -> str:
        """Sum of its terms with names for its numbers."""
        return self._written("plain")

    @property
    def latex(self) -> str:
        """The same as LaTeX."""
        return self._written("latex")

    def code(self, names: Mapping[str, str]) -> str:
        """Expression of Python for it, with these expressions for its numbers."""
        written = [
            f"{names[f'c{k}']} * {self._factors(term, k, 'code', names)}" for k, term in enumerate(self.terms, 1)
        ]
        return " + ".join(written)

    def _written(self, style: str) -> str:
        return " + ".join(self._term(term, k, style) for k, term in enumerate(self.terms, 1))

    def _term(self, term: FormulaTerm, k: int, style: str) -> str:
        own = self._factors(term, k, style, {})
        name = f"c{k}" if style == "plain" else f"c_{{{k}}}"
        space = " " if style == "plain" else r"\,"
        if own == "1":
            return name
        if style == "plain" and own.startswith("1/"):
            return f"{name}{own[1:]}"
        return f"{name}{space}{own}"

    def _factors(self, term: FormulaTerm, k: int, style: str, known: Mapping[str, str]) -> str:
        texts = []
        for i, factor in enumerate(term.factors):
            names = [_letter(i, place, k) for place in range(2)]
            shown = [known.get(n, n if style == "plain" else f"{n[0]}_{{{n[1:]}}}") for n in names]
            texts.append(factor.written(style, shown))
        return {"plain": " ", "latex": r"\,", "code": " * "}[style].join(texts)

    def candidate(self, prefix: str, bodies: tuple[str, ...], place: str = "body") -> Candidate:
        """Return it as a candidate effect that the kernel interprets, at its values.

        prefix : of the names of its parameters
        bodies, place : on which it acts
        """
        parameters, held = [], {}
        free, form = (
            [f"{prefix}_{n.name}" for n in self.coefficients],
            [f"{prefix}_{n.name}" for n in self.shape_numbers],
        )
        for k, (name, value) in enumerate(self._layout(prefix)):
            own = name in free
            parameters.append(Parameter(name, "1", 0.0, f"number {k} of the formula", null=0.0 if own else None))
            if not own:
                held[name] = value
        scale = {f"{prefix}_{n.name}": abs(n.value) or 1.0 for n in self.numbers}
        bounds = {f"{prefix}_{n.name}": (n.low, n.high) for n in self.shape_numbers}
        effect = Effect(
            name=prefix, site="force", law=terms, parameters=tuple(parameters), meaning="a formula of a force",
            equation=self.text, bodies=bodies, place=place,
        )  # fmt: skip
        return Candidate(effect, tuple(free), held, scale, bounds=bounds, form=tuple(form))

    def _layout(self, prefix: str) -> list[tuple[str, float]]:
        """Name and value of each number of the law, in their order."""
        layout: list[tuple[str, float]] = []
        for k in range(1, MAX_TERMS + 1):
            term = self.terms[k - 1] if k <= len(self.terms) else FormulaTerm((), 0.0)
            layout.append((f"{prefix}_c{k}", term.coefficient))
            for i in range(MAX_FACTORS):
                factor = term.factors[i] if i < len(term.factors) else Factor(CONSTANT, DISPLACEMENT)
                layout += [
                    (f"{prefix}_shape{k}{i}", float(factor.code)),
                    (f"{prefix}_argument{k}{i}", float(factor.argument == VELOCITY)),
                    *((f"{prefix}_{_letter(i, place, k)}", factor.numbers[place]) for place in range(2)),
                ]
        return layout


def _letter(factor: int, place: int, term: int) -> str:
    """Name of a number of a shape: of a factor, by its place, of a term."""
    return f"{(LETTERS, SECOND_LETTERS)[factor][place]}{term}"
