"""A search for a force law as its result is written: functions on grids, with their errors."""

from collections.abc import Mapping

import numpy as np

from calib.diagnosis.discovery.describing_function import describing_function
from calib.diagnosis.discovery.document import (
    DiscoveryResult,
    FormulaResult,
    FunctionResult,
    HistoryResult,
    NumberResult,
    TrialResult,
)
from calib.diagnosis.discovery.formula import Formula
from calib.diagnosis.discovery.formulas import FormulaTrial
from calib.diagnosis.discovery.free_force import DISPLACEMENT, UNITS, VELOCITY
from calib.diagnosis.discovery.history import HistoryTrial
from calib.diagnosis.discovery.outcome import Discovery
from calib.diagnosis.discovery.partial_spline import Part, PartialSpline
from calib.diagnosis.discovery.penalised import States
from calib.diagnosis.discovery.trial import ForceTrial, described
from calib.diagnosis.document import GateResult

CURVE_POINTS, SURFACE_POINTS = 101, 25  # of each argument, of a function of one and of two  [count]
PURE_SHARE = 0.999  # of the squares of an absorbed function that one argument alone makes, to be called by it  [1]


def discovery_result(discovery: Discovery, values: Mapping[str, float]) -> DiscoveryResult:
    """Return what is written of a search that began at the calibrated `values`."""
    gates = tuple(GateResult(g.name, g.passed, g.summary, g.z, g.tried) for g in discovery.gates)
    common = DiscoveryResult(
        verdict=discovery.verdict,
        summary=discovery.summary,
        trials=tuple(_trial(trial) for trial in discovery.trials),
        gates=gates,
        cut_short=discovery.cut_short,
        curves=tuple(discovery.curves.values()),
        values=dict(values),
        simulations=discovery.simulations,
        seconds=discovery.seconds,
    )
    chosen, states, null_left_out = discovery.chosen, discovery.states, discovery.null_left_out
    if chosen is None or states is None or null_left_out is None or chosen.left_out is None:
        return common
    partial, fit = discovery.partial_spline, chosen.fitted.fit
    force, error = (partial or chosen.fitted).surface(states.x, states.v)
    calibrated = [name for name in fit.names if name not in chosen.fitted.model.coefficients]
    return DiscoveryResult(
        **{
            **vars(common),
            "body": chosen.body,
            "interface": bool(chosen.place.gap),
            "arguments": chosen.all_arguments,
            "functions": functions(chosen, states, partial),
            "formulas": tuple(map(_formula, discovery.formulas)),
            "histories": tuple(map(_history, discovery.histories)),
            "rms": (float(np.sqrt(np.mean(force**2))), float(np.sqrt(np.mean(error**2)))),
            "explained": discovery.explained,
            "left_out": null_left_out.names,
            "left_out_deviance": (null_left_out.deviance, chosen.left_out.deviance),
            "undetermined": undetermined(chosen),
            "rivals": discovery.rivals,
            "parameters": {name: fit.value(name) for name in calibrated},
            "describing_function": describing_function(discovery),
        }
    )


def _formula(trial: FormulaTrial) -> FormulaResult:
    errors = trial.errors()
    numbers = tuple(
        NumberResult(n.name, n.value, _finite(errors[n.name]), n.unit, n.meaning) for n in trial.formula.numbers
    )
    left_out = None if trial.left_out is None else trial.left_out.deviance
    return FormulaResult(
        trial.formula.text, trial.formula.latex, numbers, trial.fit.chi2, left_out, trial.ric, trial.ties,
        trial.on_front, trial.predicts, trial.explains,
    )  # fmt: skip


def _finite(error: float | None) -> float | None:
    return error if error is not None and np.isfinite(error) else None


def _history(trial: HistoryTrial) -> HistoryResult:
    errors = trial.errors()
    numbers = tuple(
        NumberResult(p.name, trial.values[p.name], _finite(errors.get(p.name)), p.unit, p.meaning)
        for p in trial.candidate.effect.parameters
    )
    left_out = None if trial.left_out is None else trial.left_out.deviance
    return HistoryResult(trial.name, trial.candidate.effect.equation, numbers, trial.fit.chi2, left_out)


def functions(trial: ForceTrial, states: States, partial: PartialSpline | None = None) -> tuple[FunctionResult, ...]:
    """Functions of a model over the visited region, without what calibration absorbs.

    Of additive functions the first alone has a constant: those after it vanish at zero.

    partial : where a formula predicts as well, the force beside which it is stated
    """
    results = []
    for number, arguments in enumerate(trial.arguments):
        count = CURVE_POINTS if len(arguments) == 1 else SURFACE_POINTS
        points = [np.linspace(*states.region[a], count) for a in arguments]
        grid = [axis.ravel() for axis in np.meshgrid(*points, indexing="ij")]
        at = dict(zip(arguments, grid, strict=True))
        rows = _rows(trial, number, at, grid[0].size)
        if partial is None:
            (force, error), own = trial.fitted.combination(rows), ()
        else:
            part = _part(trial, number, at, grid[0].size)
            force, error = partial.combination(rows, part)
            own = tuple(partial.formula_alone(rows, part).tolist())
        results.append(
            FunctionResult(
                arguments=arguments,
                units=tuple(UNITS[a] for a in arguments),
                region=tuple(states.region[a] for a in arguments),
                points=tuple(tuple(axis.tolist()) for axis in points),
                force=tuple(force.tolist()),
                error=tuple(error.tolist()),
                visited=tuple(_visited(points, [_along(states, a) for a in arguments]).ravel().tolist()),
                formula=own,
            )
        )
    return tuple(results)


def _part(trial: ForceTrial, number: int, at: Mapping[str, np.ndarray], count: int) -> Part:
    """Make the function of a formula that returns the values (count,) of what belongs to one of the functions."""
    zero = np.zeros(count)
    x, v = at.get(DISPLACEMENT, zero), at.get(VELOCITY, zero)

    def part(formula: Formula) -> np.ndarray:
        own = Formula(tuple(t for t in formula.terms if t.arguments and t.arguments <= set(trial.arguments[number])))
        rest = Formula(tuple(t for t in formula.terms if t not in own.terms))
        return own.values(x, v) + (rest.values(zero, zero) if not number else -own.values(zero, zero))

    return part


def _rows(trial: ForceTrial, number: int, at: Mapping[str, np.ndarray], count: int) -> np.ndarray:
    """Rows (count, p) by the coefficients of all functions: the values of one of them at these arguments."""
    forces, zero = trial.fitted.model.forces, np.zeros(count)
    blocks = [np.zeros((count, len(force.coefficients))) for force in forces]
    blocks[number] = forces[number].matrix(at.get(DISPLACEMENT, zero), at.get(VELOCITY, zero))
    if number:
        blocks[number] = blocks[number] - forces[number].matrix(zero, zero)
    else:
        for other in range(1, len(forces)):
            blocks[other] = forces[other].matrix(zero, zero)
    return np.column_stack(blocks)


def _along(states: States, argument: str) -> np.ndarray:
    """Visited values of an argument."""
    return states.x if argument == DISPLACEMENT else states.v


def _visited(points: list[np.ndarray], values: list[np.ndarray]) -> np.ndarray:
    """Whether states are visited within one step of each point of a grid."""
    nearest = [np.rint((v - p[0]) / (p[1] - p[0])).astype(int) for p, v in zip(points, values, strict=True)]
    visited = np.zeros([p.size for p in points], dtype=bool)
    inside = [np.clip(own, 0, p.size - 1) for p, own in zip(points, nearest, strict=True)]
    visited[tuple(inside)] = True
    grown = np.pad(visited, 1)
    for axis in range(grown.ndim):
        grown = grown | np.roll(grown, 1, axis) | np.roll(grown, -1, axis)
    return np.asarray(grown[tuple(slice(1, -1) for _ in points)])


def undetermined(trial: ForceTrial) -> tuple[str, ...]:
    """Linear functions that calibrated parameters absorb, in words."""
    fitted = trial.fitted
    shapes = fitted.model.visited @ fitted.smoothing.absorbed
    names = []
    x, v = fitted.model.states.x, fitted.model.states.v
    for text, shape in (("a constant", np.ones_like(x)), ("a multiple of the displacement", x),
                        ("a multiple of the velocity", v)):  # fmt: skip
        inside = shapes @ (np.linalg.pinv(shapes) @ shape)
        if inside @ inside > PURE_SHARE * (shape @ shape):
            names.append(text)
    return tuple(names)


def _trial(trial: ForceTrial) -> TrialResult:
    left_out = None if trial.left_out is None else trial.left_out.deviance
    fitted = trial.fitted
    return TrialResult(
        trial.body, described(trial.arguments, trial.place), fitted.fit.chi2, left_out, fitted.effective_parameters
    )  # fmt: skip
