"""The map of a period of the beam, in both fidelities."""

import numpy as np
import pytest
from short_beam import EXCITATION, REQUEST, VALUES, attempt, beam, run

from calib.modelling.model import Model
from calib.modelling.simulator import Request

BOTH = pytest.mark.parametrize("fidelity", ["reduced", "full"])


def made(fidelity, phase=0.0, **values):
    return Model(beam(fidelity=fidelity, modes=24)).period_map({**VALUES, **values}, EXCITATION, phase)


@BOTH
def test_the_state_is_coordinates_and_their_rates(fidelity):
    map = made(fidelity)
    half = len(map.names) // 2
    assert map.bodies == ("beam", "layer")
    assert map.impacting
    assert all(name.endswith(".displacement") for name in map.names[:half])
    assert all(name.endswith(".velocity") for name in map.names[half:])
    assert half == (24 if fidelity == "reduced" else 64)
    omega = 2.0 * np.pi * EXCITATION.frequency
    np.testing.assert_allclose(map.scale[half:], omega * map.scale[:half])


@BOTH
def test_a_record_goes_on_from_a_state_of_the_map(fidelity):
    map = made(fidelity)
    state = map.orbit(map.initial, 20).states[-1]
    simulator = beam(fidelity=fidelity, modes=24)
    record = attempt(simulator, request=Request(periods=1, samples=100, settle=0, initial_state=state))
    settled = run(simulator)
    size = np.abs(settled.displacement.values).max()
    np.testing.assert_allclose(record.displacement, settled.displacement[:, :100], rtol=0, atol=1e-3 * size)


@BOTH
def test_impacts_of_the_map_are_those_of_the_record(fidelity):
    map, record = made(fidelity), run(beam(fidelity=fidelity, modes=24))
    orbit = map.orbit(map.initial, 40)
    last = orbit.impacts[orbit.impacts[:, 0] == 39.0]
    phases = np.sort(record.impact_time.values / EXCITATION.period % 1.0)[:: REQUEST.periods]
    assert len(last) == len(phases)
    np.testing.assert_allclose(np.sort(last[:, 1]), phases, atol=2e-3)


@BOTH
def test_misses_shrink_as_the_gap_narrows(fidelity):
    wide, narrow = (made(fidelity, s=s) for s in (8e-3, 6e-3))
    states = [map.orbit(map.initial, 15).states[-1] for map in (wide, narrow)]
    nearest = [map.near_misses(state).min() for map, state in zip((wide, narrow), states, strict=True)]
    assert nearest[0] - nearest[1] == pytest.approx(2e-3, rel=1e-6)
    assert not len(wide.orbit(wide.initial, 15).impacts)


@BOTH
def test_what_diverges_ends_with_a_status(fidelity):
    map = made(fidelity)
    orbit = map.orbit(map.initial + 1e6 * map.scale, 3)
    assert orbit.status in ("diverged", "unstable step")
    assert "grew beyond" in orbit.reason
    assert len(orbit.states) < 3


@BOTH
def test_there_is_no_derivative(fidelity):
    map = made(fidelity)
    assert map.tangent(map.initial, np.eye(len(map.names)), 1) is None


@BOTH
def test_a_section_at_half_a_period_is_between(fidelity):
    half, record = made(fidelity, phase=0.5), run(beam(fidelity=fidelity, modes=24))
    orbit = half.orbit(half.initial, 30)
    x = record.displacement.values
    np.testing.assert_allclose(orbit.displacement[:, -1], x[:, 50], rtol=0, atol=1e-4 * np.abs(x).max())
