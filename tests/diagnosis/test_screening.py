"""Cheap first: effects that contain others are tested where simpler ones show."""

from types import SimpleNamespace

import numpy as np
import pytest
from straight_line import MODEL, START, TIME, TRUE, WINDOWS, Evidence, straight

from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.candidate import Candidate
from calib.diagnosis.refit import Fitter
from calib.diagnosis.screening import screened
from calib.diagnosis.signature import Point
from calib.execution.pool import InProcess
from calib.modelling.parameter import Parameter, Space

WAVE = np.sin(3.0 * TIME)
SHAPES = {"wave": WAVE, "warped": WAVE + 0.1 * np.sin(40.0 * TIME)}


def candidate(name, generalises):
    parameters = [Parameter(name, "1", 0.0, "", null=0.0)]
    effect = SimpleNamespace(
        name=name, null={name: 0.0}, parameters=parameters, differentiable=True, guess=None, generalises=generalises
    )
    return Candidate(effect, (name,), {}, {name: 100.0})


CANDIDATES = [candidate("wave", ()), candidate("warped", ("wave",))]


class InSegments(Evidence):
    """With segments of the record, for score tests."""

    def segments(self):
        return np.arange(self.measured.size) // 40

    def counted(self):
        return float(self.measured.size)


def scored(size, staged=True):
    """Suspects where the hidden wave has this size, and the names of what was simulated."""
    simulated = set()

    def simulate(run):
        simulated.update(name for name in SHAPES if run.values.get(name))
        rows = straight(run.values) + sum(run.values.get(name, 0.0) * shape for name, shape in SHAPES.items())
        return SimulatedRows(rows[None], np.ones(TIME.size))

    measured = straight(TRUE) + size * WAVE + np.random.default_rng(0).standard_normal(TIME.size)
    fitter = Fitter(InProcess(simulate), InSegments(measured), Space(WINDOWS), MODEL)
    null = fitter.fit(Point(START, (), {"record": SimulatedRows(straight(START)[None], np.ones(TIME.size))}))
    suspects, _ = screened(fitter, null, CANDIDATES, 0, staged=staged)
    return {s.name: s for s in suspects}, simulated


@pytest.mark.parametrize(("size", "staged", "tested"), [(0.0, True, False), (1.0, True, True), (0.0, False, True)])
def test_a_general_effect_is_tested_where_a_simpler_one_shows(size, staged, tested):
    suspects, simulated = scored(size, staged)
    assert set(suspects) == set(SHAPES)
    assert suspects["warped"].is_testable == tested
    assert suspects["warped"].deferred != tested
    assert ("warped" in simulated) == tested
    assert tested or "no simpler effect" in suspects["warped"].reason
