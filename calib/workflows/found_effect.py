"""The effect file of a force that was found: its formula, or the table of its splines, beside the study."""

import hashlib
import importlib
import re
import sys
import textwrap
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.diagnosis.candidate import Scales, candidates
from calib.diagnosis.discovery.continuation import known_region
from calib.diagnosis.discovery.document import OF_HISTORY
from calib.diagnosis.discovery.formula import Number
from calib.diagnosis.discovery.formulas import FormulaTrial, prefix_of
from calib.diagnosis.discovery.free_force import DISPLACEMENT, SYMBOLS, UNITS, VELOCITY, FreeForce
from calib.diagnosis.discovery.outcome import FOUND, Discovery
from calib.diagnosis.discovery.trial import ForceTrial, described
from calib.diagnosis.fit import Fit
from calib.errors import CalibError
from calib.execution.files import whole
from calib.study_file import FORCE_FOUND, StudyFile
from calib.study_file.candidates import named_effect
from calib.workflows.extension import extended_study
from calib.workflows.new import skeleton

FOLDER, BEGINNING = "effects", "found_"  # of the effect file, beside the study; of its name
MARK = "Written by `calib discover`."  # in each such file
SLUG_DIGEST_DIGITS = 6  # hexadecimal, of a study's name that the file's name does not tell
MAX_SLUG_CHARACTERS = 40  # of a study's name that the file's name takes  [count]
GROUPS = {frozenset([DISPLACEMENT]): "stiffness", frozenset([VELOCITY]): "damping"}  # of an effect, by its arguments
SIZE_RATIOS = (0.3, 1.0, 3.0)  # of typical sizes over that which was identified  [1]


def apply_force(file: StudyFile, discovery: Discovery) -> Path | None:
    """Write the force as an effect file, and the study with it in its model; None where none was found.

    Nor where the records cannot tell of what it is a function. Of a force that depends on history the model has the law
    of the library that predicts best. The study that a diagnosis has extended is another file, and stays.

    Raises
    ------
    CalibError : a file of that name is there, which `calib discover` has not written
    """
    chosen = discovery.chosen
    if discovery.verdict == OF_HISTORY:
        best = discovery.histories[0]
        return extended_study(file, best.fit, [best.candidate], file.effect_references(), part=FORCE_FOUND)
    if chosen is None or discovery.verdict != FOUND:
        return None
    name = effect_name(file)
    trial = discovery.formula_trial
    if trial is None:
        fit, text = _spline_text(file, name, discovery, chosen)
    else:
        fit, text = trial.fit, _formula_text(file, name, discovery, chosen, trial)
    reference = _written(file.path.parent, name, _as_written(file), text)
    effect = chosen.fitted.model.forces[0].effect
    loaded = named_effect(reference, effect.bodies, file.path.parent)
    usable, refused = candidates(
        file.study.model, [loaded], file.study.objective.references, file.study.space.names
    )  # fmt: skip
    if not usable:
        raise CalibError(f"the effect {name!r} that was found cannot be used: {refused[name]}")
    return extended_study(file, fit, usable[:1], {name: reference}, part=FORCE_FOUND)


def effect_name(file: StudyFile) -> str:
    """Name of the effect of a force that was found in a study."""
    name = file.study.name
    slug = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
    short = slug[:MAX_SLUG_CHARACTERS].strip("_")
    if short == slug and re.fullmatch(r"[\w .-]+", name, re.ASCII):
        return f"{BEGINNING}{slug or 'force'}"
    digest = hashlib.sha256(name.encode()).hexdigest()[:SLUG_DIGEST_DIGITS]  # of what the slug does not tell
    return f"{BEGINNING}{short or 'force'}_{digest}"


def _as_written(file: StudyFile) -> str:
    """Name of a study in the text of its effect file."""
    return re.sub(r'["\\]', "'", file.study.name)


def _source(study: str) -> str:
    return f"found by calib discover in the study '{study}'"


def _written(folder: Path, name: str, study: str, text: str) -> str:
    """Write the effect file; return the reference under which a study file knows it.

    study : its name, as the file has it
    """
    path = folder / FOLDER / f"{name}.py"
    if path.exists():
        known = path.read_text(encoding="utf-8")
        if MARK not in known or _source(study) not in known:
            whose = "is another study's" if MARK in known else "`calib discover` has not written it"
            raise CalibError(f"{path} is there, and {whose}: move it away, or rename the study")
    path.parent.mkdir(exist_ok=True)
    with whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    importlib.invalidate_caches()
    sys.modules.pop(f"{FOLDER}.{name}", None)  # of an earlier force
    return f"{FOLDER}.{name}:EFFECT"


def _common(file: StudyFile, name: str, discovery: Discovery, chosen: ForceTrial) -> dict[str, object]:
    """Words that both kinds of file have in common."""
    study = _as_written(file)
    where = f"{chosen.place.preposition} {chosen.body}"
    return {
        "name": name,
        "title": f"A force {where} that was found in the records of the study '{study}'.",
        "meaning": f"a force {where}, found in the records of a study: a {described(chosen.arguments, chosen.place)}",
        "source": _source(study),
        "summary": _wrapped(discovery.summary.replace("\\", "/")),
        "group": GROUPS.get(frozenset(chosen.all_arguments), "load"),
        "place": chosen.fitted.model.forces[0].effect.place,
    }


def _wrapped(text: str, width: int = 110) -> str:
    """Text in lines of limited length."""
    return textwrap.fill(text[:1].upper() + text[1:] + ".", width)


def _formula_text(file: StudyFile, name: str, discovery: Discovery, chosen: ForceTrial, trial: FormulaTrial) -> str:
    """Text of the effect file of a formula."""
    formula = trial.formula
    scales = Scales.of(file.study.objective.references.values())
    names = {n.name: f"p[{k}]" for k, n in enumerate(formula.numbers)}
    numbers = [_parameter(n, trial.prefix) for n in formula.numbers]
    natural = [
        (f"{trial.prefix}_{n.name}", _multiples(n.value / scales.scale(n.unit, n.value))) for n in formula.coefficients
    ]
    used = {argument for term in formula.terms for argument in term.arguments}
    states = chosen.fitted.model.states if discovery.states is None else discovery.states
    known = known_region(discovery, trial, states)
    region = [
        (SYMBOLS[a].upper(), UNITS[a], *map(_digits, (*known[a], *visited)))
        for a, visited in states.region.items()
        if a in used
    ]
    return skeleton(
        "found_formula.py.j2",
        {
            **_common(file, name, discovery, chosen),
            "equation": formula.text,
            "code": formula.code(names),
            "region": region,
            "symbols": [symbol for symbol, *_ in region],
            "numbers": numbers,
            "natural": natural,
        },
    )


def _multiples(size: float) -> tuple[float, ...]:
    """Typical sizes in natural scales."""
    return tuple(float(f"{ratio * size:.3g}") for ratio in SIZE_RATIOS)


def _digits(value: float) -> str:
    return f"{value:.6g}"


def _parameter(number: Number, prefix: str) -> Mapping[str, str]:
    """Words of a parameter in the file: bounds of those that are finite, and the null of a coefficient."""
    bounds = (("low", number.low), ("high", number.high))
    rest = [] if number.null is None else [f"null={number.null}"]
    rest += [f"{end}={value:.6g}" for end, value in bounds if np.isfinite(value)]
    return {
        "name": f"{prefix}_{number.name}",
        "unit": number.unit,
        "value": f"{number.value:.10g}" if "." in f"{number.value:.10g}" or "e" in f"{number.value:.10g}"
        else f"{number.value:.1f}",
        "meaning": number.meaning,
        "rest": "".join(f", {text}" for text in rest),
    }  # fmt: skip


def _spline_text(file: StudyFile, name: str, discovery: Discovery, chosen: ForceTrial) -> tuple[Fit, str]:
    """Fit by the size of the whole force, and text of the effect file of its splines."""
    fitted, forces = chosen.fitted, chosen.fitted.model.forces
    scale = f"{prefix_of([*file.study.model.parameters, *file.study.space.names])}_scale"
    code = " + ".join(_call(force, k) for k, force in enumerate(forces, 1))
    text = skeleton(
        "found_spline.py.j2",
        {
            **_common(file, name, discovery, chosen),
            "tables": [_table(force, fitted.fit) for force in forces],
            "code": code,
            "scale": scale,
            "arguments": ", ".join(map(SYMBOLS.__getitem__, chosen.all_arguments)),
        },
    )
    own = np.isin(fitted.fit.names, fitted.model.coefficients)
    columns = np.column_stack([fitted.fit.columns[:, ~own], fitted.fit.columns[:, own] @ fitted.coefficients])
    names = (*np.array(fitted.fit.names)[~own].tolist(), scale)
    point = replace(fitted.fit.point, values={**fitted.fit.point.values, scale: 1.0})
    return replace(fitted.fit, columns=columns, names=names, point=point), text


def _call(force: FreeForce, number: int) -> str:
    """Expression for a free force with its table."""
    function = "surface" if len(force.arguments) == 2 else "curve"
    return f"{function}({', '.join(SYMBOLS[a] for a in force.arguments)}, TABLE_{number})"


def _table(force: FreeForce, fit: Fit) -> str:
    """Numbers of a free force, as lines of Python."""
    held = [p.nominal for p in force.effect.parameters if p.null is None]
    numbers = [*held, *force.all_coefficients(np.array([fit.value(name) for name in force.coefficients]))]
    lines = [", ".join(f"{n:.10g}" for n in numbers[k : k + 8]) for k in range(0, len(numbers), 8)]
    return "[" + ",\n     ".join(lines) + "]"
