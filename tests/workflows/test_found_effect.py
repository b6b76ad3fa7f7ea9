"""Effect files of forces that were found: as any effect, continued linearly, and in a study that uses them."""

import itertools
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from workflows.test_discover import STUDY, record

from calib.diagnosis.discovery.formula import Factor, Formula, FormulaTerm
from calib.diagnosis.discovery.formulas import FormulaTrial
from calib.diagnosis.discovery.free_force import DISPLACEMENT, VELOCITY, free_force
from calib.diagnosis.discovery.outcome import Discovery
from calib.diagnosis.discovery.penalised import FreeModel, PenalisedFit, States
from calib.diagnosis.discovery.place import ForcePlace
from calib.diagnosis.discovery.shapes import ABOVE, ODD_POWER, SINE
from calib.diagnosis.discovery.trial import ForceTrial
from calib.diagnosis.fit import Fit
from calib.diagnosis.signature import Point
from calib.errors import CalibError
from calib.records import write
from calib.study_file import load
from calib.testing import EffectSuite
from calib.workflows.found_effect import apply_force, effect_name

REGION = States(np.linspace(-2e-3, 3e-3, 50), np.linspace(-0.3, 0.2, 50))
RATE = Factor(ODD_POWER, VELOCITY, (1.0, 1.0), fixed=True)
FORMULA = Formula(
    (
        FormulaTerm((Factor(ODD_POWER, DISPLACEMENT, (3.0, 1.0), fixed=True),), -4e6),
        FormulaTerm((Factor(ABOVE, DISPLACEMENT, (1e-3, 1.5), ((-2e-3, 3e-3), (-np.inf, np.inf))),), -300.0),
        FormulaTerm(
            (Factor(SINE, DISPLACEMENT, (4e-3, 1e-4)), Factor(ODD_POWER, VELOCITY, (1.0, 1.0), fixed=True)), 2.0
        ),
    )
)
BASE = {"mass": 1.0, "damping": 2.0, "stiffness": 4000.0}


def fit(values, names):
    columns = np.random.default_rng(0).standard_normal((60, len(names)))
    point, none = Point({**BASE, **values}, (), {}), np.zeros((60, 0))
    residual, rows = np.random.default_rng(1).standard_normal(60), np.zeros(60, dtype=int)
    return Fit(point, (), residual, columns, names, (), none, rows)


def found(formula):
    """Return a search whose force is a formula, or splines where it is None."""
    forces = (free_force("mass", [DISPLACEMENT], REGION.region), free_force("mass", [VELOCITY], REGION.region))
    coefficients = [name for force in forces for name in force.coefficients]
    sizes = dict(zip(coefficients, np.linspace(-1.0, 1.0, len(coefficients)), strict=True))
    held = {p.name: p.nominal for force in forces for p in force.effect.parameters if p.null is None}
    smoothing = SimpleNamespace(absorbed=np.zeros((len(coefficients), 0)))
    free = fit({**held, **sizes}, ("damping", "stiffness", *coefficients))
    fitted = PenalisedFit(free, FreeModel(forces, (), REGION), smoothing, 1.0)
    trial = ForceTrial(ForcePlace("mass", {"mass": 1.0}), ((DISPLACEMENT,), (VELOCITY,)), fitted, None)
    formulas = ()
    if formula is not None:
        numbers = {f"found_{n.name}": n.value for n in formula.numbers}
        own = fit(numbers, ("damping", "stiffness", *numbers))
        formulas = (FormulaTrial(formula, formula.candidate("found", ("mass",)), "found", own, None, predicts=True),)
    return Discovery("found", "a force on mass is missing", (), (trial,), trial, states=REGION, formulas=formulas)


NUMBER = itertools.count()  # of studies: modules of one name cannot be imported from two folders


def written(place):
    for name, amplitude, seed in (("soft", 6.0, 0), ("hard", 9.0, 1)):
        write(record(amplitude, seed, {}), place / f"{name}.nc")
    (place / "study.toml").write_text(STUDY.replace("bent spring", f"spring {next(NUMBER)}"))
    return load(place)


@pytest.fixture
def file(tmp_path):
    return written(tmp_path)


@pytest.fixture(
    scope="module", params=[FORMULA, pytest.param(None, marks=pytest.mark.slow)], ids=["formula", "splines"]
)
def applied(request, tmp_path_factory):
    extended = load(apply_force(written(tmp_path_factory.mktemp("found")), found(request.param)))
    [effect] = extended.study.model.effects
    return request.param, extended, effect


def law(effect, x, v):
    p = effect.bound({q.name: q.nominal for q in effect.parameters}).p
    return effect.law.function(0.0, x, v, p, np.zeros(4), np.zeros(4))


def test_the_force_becomes_an_effect_of_its_own_in_the_extended_study(applied):
    formula, extended, effect = applied
    assert effect.bodies == ("mass",)
    if formula is None:
        assert [(p.name, p.unit, p.null) for p in effect.parameters] == [("found_scale", "1", 0.0)]
        assert extended.study.space.start["found_scale"] == 1.0
        return
    assert effect.equation == FORMULA.text
    assert [(p.name, p.unit, p.null) for p in effect.parameters] == [
        ("found_c1", "1/(m^2 s^2)", 0.0), ("found_c2", "1/(m^0.5 s^2)", 0.0), ("found_c3", "1/s", 0.0),
        ("found_a2", "m", None), ("found_a3", "m", None), ("found_b3", "m", None),
    ]  # fmt: skip
    assert {"found_c1", "found_c2", "found_c3"} < set(extended.study.space.names)
    assert extended.study.space.fixed["found_a2"] == pytest.approx(1e-3)
    assert extended.study.space.start["found_c1"] == -4e6


def test_the_law_is_that_which_was_found_inside_the_region_and_linear_outside(applied):
    formula, _, effect = applied
    x, v = REGION.x[5:-5:7], REGION.v[5:-5:7]
    fitted = found(None).chosen.fitted
    expected = fitted.model.matrix(x, v) @ fitted.coefficients if formula is None else formula.values(x, v)
    inside = [law(effect, *state) for state in zip(x, v, strict=True)]
    assert inside == pytest.approx(expected, rel=1e-9)
    edge, near, far = (law(effect, 3e-3 + out, 0.1) for out in (0.0, 1e-3, 2e-3))
    assert far - near == pytest.approx(near - edge)
    slope = (law(effect, 3e-3, 0.1) - law(effect, 3e-3 - 1e-8, 0.1)) / 1e-8
    assert (near - edge) / 1e-3 == pytest.approx(slope, rel=1e-3)


@pytest.mark.slow
def test_it_is_an_effect_as_calib_needs_them(applied):
    _, _, loaded = applied

    class Found(EffectSuite):
        effect = loaded.__class__(**{**vars(loaded), "bodies": None})
        present = {p.name: p.nominal for p in loaded.parameters}

    suite = Found()
    for name in dir(Found):
        if name.startswith("test_"):
            getattr(suite, name)()
    assert all(math.isfinite(size) for sizes in loaded.natural.values() for size in sizes)


@pytest.mark.slow
def test_a_file_of_another_author_is_not_replaced(file):
    first = apply_force(file, found(FORMULA))
    assert apply_force(file, found(None)) == first
    [path] = (file.path.parent / "effects").glob("found_*.py")
    path.write_text("# mine\n")
    with pytest.raises(CalibError, match="has not written it"):
        apply_force(file, found(FORMULA))


def test_without_a_force_nothing_is_written(file):
    assert apply_force(file, Discovery("nothing", "no force", ())) is None
    assert not (file.path.parent / "effects").exists()


def test_the_study_that_a_diagnosis_has_extended_stays(file):
    diagnosed = file.path.with_name("study.extended.toml")
    diagnosed.write_text("of a diagnosis")
    assert apply_force(file, found(FORMULA)).name == "study.found.toml"
    assert diagnosed.read_text() == "of a diagnosis"


def test_a_force_of_which_nobody_knows_the_arguments_is_not_applied(file):
    assert apply_force(file, replace(found(FORMULA), verdict="undetermined")) is None
    assert not (file.path.parent / "effects").exists()


@pytest.mark.parametrize(
    "names", [("梁", "柱"), ("beam A of " + 40 * "x", "beam B of " + 40 * "x"), ("müller 1", "m ller 1")]
)
def test_forces_of_two_studies_in_one_folder_have_files_of_their_own(tmp_path, names):
    files = []
    for name in names:
        for record_name, amplitude, seed in (("soft", 6.0, 0), ("hard", 9.0, 1)):
            write(record(amplitude, seed, {}), tmp_path / f"{record_name}.nc")
        path = tmp_path / f"{len(files)}.toml"
        path.write_text(STUDY.replace("bent spring", name))
        files.append(load(path))
    assert len({effect_name(file) for file in files}) == 2
    assert all(effect_name(file).isidentifier() and effect_name(file).isascii() for file in files)


def test_the_force_of_another_study_is_not_overwritten(tmp_path):
    first = written(tmp_path)
    apply_force(first, found(FORMULA))
    text = (tmp_path / "study.toml").read_text()
    (tmp_path / "other.toml").write_text(text.replace(first.study.name, first.study.name.replace(" ", "-")))
    with pytest.raises(CalibError, match="is there, and is another study's: move it away, or rename the study"):
        apply_force(load(tmp_path / "other.toml"), found(FORMULA))
    apply_force(first, found(FORMULA))  # its own is written anew
