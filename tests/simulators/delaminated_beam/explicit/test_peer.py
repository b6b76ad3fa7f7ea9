"""Free vibration of the same mesh in akantu, a general explicit code."""

import numpy as np
import pytest
from simulators.delaminated_beam.beams import ALUMINIUM, PERIOD, advance, beam

pytest.importorskip("akantu")


def tip_of_akantu(b, step, displacement, steps, tip):
    from simulators.delaminated_beam.akantu_peer import model

    held = [*b.structure.held, b.structure.driven]
    peer, _mesh = model(b.structure.mesh, ALUMINIUM, step, displacement, held)
    moved = peer.getDisplacement()
    found = []
    for _ in range(steps):
        peer.solveStep()
        found.append(moved[tip, 1])
    return np.array(found)


@pytest.mark.slow
def test_free_vibration_is_that_of_akantu():
    """Bilinear elements, a small amplitude, a tenth of a period from the bent shape."""
    b = beam(symmetric=False, bilinear=True)
    step = 0.8 * b.critical
    steps, tip = int(0.1 * PERIOD / step), int(b.structure.mesh.lines[0][-1])
    middle = np.exp(-((b.nodes[:, :1] / 0.05) ** 2))  # is left where it is
    displacement = 1e-8 * b.structure.static_shape() * (1.0 - middle)
    displacement.ravel()[[*b.structure.held, b.structure.driven]] = 0.0
    plan = b.plan(step)
    state = b.begin(plan, displacement)
    ours = []
    for _ in range(steps):
        advance(plan, state, np.zeros(1))
        ours.append(b.displacement(plan, state)[tip, 1])
    peer = tip_of_akantu(b, step, displacement, steps + 1, tip)[1:]  # its first step takes the acceleration as zero
    assert np.abs(ours - peer).max() < 1e-5 * np.abs(peer).max()
