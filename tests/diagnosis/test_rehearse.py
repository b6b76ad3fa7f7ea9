"""Shares of a rehearsal's cases, and the size from which an effect is reliably named."""

import io
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from calib.cli.rehearse import show
from calib.diagnosis import rehearse as room
from calib.diagnosis.bench import Bench, Run
from calib.diagnosis.noise import RESIDUAL, Noise
from calib.diagnosis.part import Part
from calib.diagnosis.rehearse import NOTHING, RehearsalCase, Rehearsed, rates, rehearse, smallest
from calib.diagnosis.verdict import NAMED, NONE, ONE_OF
from calib.dynamics.swept_response import swept_response
from calib.features.frequency_response import ResponseDistance
from calib.modelling.model import Model
from calib.objective import Objective, Reference, Term
from calib.objective.prepared_response import PreparedResponse
from calib.objective.stable_stretches import read_at
from calib.records.excitation import Excitation
from calib.records.response import complex_amplitude, make_response, tolerances, with_amplitude
from calib.simulators.oscillator import Oscillator

UNITS = {"c2": "1/m"}


def cases(effect, strength, *verdicts):
    """Rehearse an effect, each time with another seed: named, among two alternatives, or not detected."""
    values = {"c2": strength / 10.0} if strength else {}
    classes = {NAMED: ((effect,),), ONE_OF: ((effect,), ("linear_drag",)), NONE: ()}
    return [
        Rehearsed(
            RehearsalCase(effect, strength, values, seed, UNITS if values else {}),
            verdict,
            (effect,) if verdict == NAMED else (),
            classes[verdict],
        )
        for seed, verdict in enumerate(verdicts)
    ]


PLAYED = [
    *cases(NOTHING, 0.0, NONE, NONE),
    *cases("quadratic_drag", 5.0, NONE, ONE_OF, NAMED, NAMED),
    *cases("quadratic_drag", 10.0, NAMED, NAMED, NAMED, ONE_OF),
    *cases("quadratic_drag", 20.0, NAMED, NAMED),
    *cases("support", 5.0, NAMED, NAMED),
    *cases("support", 10.0, NONE, NONE),
]


def test_shares_are_of_the_cases_of_one_size():
    shares = {(row.hidden.effect, row.hidden.strength): row for row in rates(PLAYED)}
    row = shares["quadratic_drag", 5.0]
    assert (row.cases, row.detected, row.named, row.covered) == (4, 0.75, 0.5, 0.75)
    assert (row.hidden.values, row.hidden.units) == ({"c2": 0.5}, UNITS)
    assert (shares[NOTHING, 0.0].cases, shares[NOTHING, 0.0].detected) == (2, 0.0)


def test_an_effect_is_reliably_named_from_a_size_above_which_it_always_is():
    least = smallest(PLAYED)
    assert least.keys() == {"quadratic_drag", "support"}
    assert least["quadratic_drag"].hidden.strength == 10.0
    assert least["support"] is None


def test_the_table_shows_shares_and_the_smallest_size():
    printed = io.StringIO()
    show(PLAYED, Console(file=printed, width=120, color_system=None))
    rows = [line.split() for line in printed.getvalue().splitlines()]
    [drag] = [row for row in rows if "quadratic_drag" in row]
    shown = " ".join(drag)
    assert all(text in shown for text in ("90%", "70%", "c2 = 1 1/m (z = 10)")), shown
    assert sum(one.detected for one in PLAYED[2:12]) / 10 == pytest.approx(0.9)


@pytest.mark.parametrize(("timeout", "of_a_case"), [(None, None), (30.0, 30.0 * room.MAX_CASE_RATIO * 120)])
def test_a_case_has_as_much_time_as_its_simulations_may_take(monkeypatch, timeout, of_a_case):
    opened = []

    @contextmanager
    def workers(function, evaluated_by, limit=None, *, modules):
        opened.append(limit)
        yield SimpleNamespace(map=lambda cases: iter(()))

    effort = SimpleNamespace(done=80, foreseen=120)
    fitter = SimpleNamespace(effort=effort, evidence=None)
    ready = SimpleNamespace(fitter=fitter, null=SimpleNamespace(point=SimpleNamespace(values={})), suspects=())
    monkeypatch.setattr(room, "workers", workers)
    monkeypatch.setattr(room, "bench_of", lambda study, others: None)
    monkeypatch.setattr(room, "prepared", lambda *arguments: ready)
    monkeypatch.setattr(room, "screened", lambda *arguments, staged: ([], 2.6))
    study = SimpleNamespace(timeout=timeout, evaluated_by=None, code=(), seed=1, without_search=lambda: None)
    rehearse(study, {}, {}, [], seeds=0)
    assert opened == [timeout, of_a_case]


@pytest.mark.slow
def test_a_rehearsed_response_has_the_noise_of_the_parts_on_flanks_too():
    values, drive = (
        {"mass": 1.0, "stiffness": 400.0, "damping": 1.0},
        Excitation("mass", "force", frequency=2.8, amplitude=0.1),
    )
    frequency, rows = np.linspace(2.9, 3.5, 25), (("mass", "in_phase"), ("mass", "quadrature"))
    wanted = make_response(frequency, ["mass"], np.ones((1, 25)), 0.1, "N", place="mass", quantity="force")
    model = Model(Oscillator())
    curve = swept_response(model, values, drive, wanted)
    exact = with_amplitude(wanted, read_at(curve, wanted))
    reference = Reference("sweep", exact, excitation=drive)
    steep = np.abs(np.gradient(complex_amplitude(exact)[0], frequency)) * tolerances(exact)[0]
    flank = np.flatnonzero(steep > tolerances(exact)[1][0])
    assert 3 <= flank.size < 25
    noise = (Noise(1.5, np.zeros(0), RESIDUAL),) * 2
    zero = np.zeros((2, 25))
    part = Part("sweep", rows, zero[0], zero, None, 1, (), noise, zero == 0.0, zero + 1.0, sweep=zero[0])
    bench = Bench(model, Objective({"sweep": reference}, [Term(ResponseDistance())]), {"sweep": rows})
    rng, left = np.random.default_rng(8), []
    for _ in range(60):
        view = bench(Run("sweep", values, stepped=room._driven(exact, part, rng)))
        noisy = replace(reference, record=room._noisy(room._simulated(view, exact, part), part, rng))
        compared = PreparedResponse(noisy, [Term(ResponseDistance())]).compared(curve)
        left.append([noisy.compared[name].values[0] - compared[name].values[0] for name in ("in_phase", "quadrature")])
    variance = np.mean(np.square(left), axis=(0, 1)) / 1.5**2
    assert variance[flank].mean() == pytest.approx(1.0, abs=0.2)
    assert variance.mean() == pytest.approx(1.0, abs=0.1)


def test_sizes_at_a_bound_are_rehearsed_once_with_the_z_that_they_have():
    candidate = SimpleNamespace(null=np.zeros(1), low=np.zeros(1), high=np.ones(1))
    suspect = SimpleNamespace(candidate=candidate, error=np.array([0.1]))
    found = room._sizes(suspect, (5.0, 8.0, 20.0, 40.0))  # 40 standard errors would be 4
    assert [strength for strength, _ in found] == [5.0, 8.0, pytest.approx(10.0)]
    assert [float(sizes[0]) for _, sizes in found] == pytest.approx([0.5, 0.8, 1.0])
