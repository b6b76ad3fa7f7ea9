"""The energy balance of a whole period with its impacts."""

import numpy as np
import pytest
from simulators.delaminated_beam.beams import FIGURE_12, FIGURE_14, advance, beam, cosine

from calib.simulators.delaminated_beam import explicit
from calib.simulators.delaminated_beam.structure import elastic_energy

HALF = beam()


def balance(plan, state, drive):
    """Audit a run: the change of the energy, and the work done with what was lost by cause  [J]."""

    def audited(part):
        energy, before = np.zeros(6), elastic_energy(HALF.structure, HALF.displacement(plan, state))
        explicit.audit(plan, state, 0.0, part, energy)
        return energy, before

    run, start = audited(drive)
    after, end = audited(drive[:1])  # one more step, for the kinetic energy at the end
    change = (after[4] + end) - (run[4] + start)
    return change, run[:4]


@pytest.mark.slow
@pytest.mark.parametrize("figure", [FIGURE_12, FIGURE_14], ids=["figure 12", "figure 14"])
def test_the_energy_of_a_period_is_accounted_for(figure):
    """Work of the drive = change + losses to alpha, to beta and in contact; contact is open at both ends.

    The smallest of the terms is a ten-thousandth of the work; what is missing is far less than that.
    """
    plan, state, steps = HALF.figure(*figure)
    drive = cosine(steps)
    advance(plan, state, drive)
    change, (work, alpha, beta, contact) = balance(plan, state, drive)
    assert min(alpha, beta, contact) > 1e-6 * work
    assert work == pytest.approx(change + alpha + beta + contact, abs=1e-8 * work)


def test_without_losses_the_energy_stays():
    """Free motion on the supports: no drive, no damping, no contact."""
    plan = HALF.plan(0.5 * HALF.critical)
    u = 1e-4 * HALF.structure.static_shape()
    u -= u[HALF.structure.mesh.driven] * np.exp(-((HALF.nodes[:, :1] / 0.05) ** 2))
    u.ravel()[HALF.structure.held] = 0.0
    state = HALF.begin(plan, u)
    before, energy = elastic_energy(HALF.structure, u), np.zeros(6)
    explicit.audit(plan, state, 0.0, np.zeros(20_000), energy)
    late = elastic_energy(HALF.structure, HALF.displacement(plan, state))
    once = np.zeros(6)
    explicit.audit(plan, state, 0.0, np.zeros(1), once)
    assert once[4] > 0.1 * late
    assert once[4] + late == pytest.approx(energy[4] + before, rel=1e-4)
    assert not energy[:4].any()
