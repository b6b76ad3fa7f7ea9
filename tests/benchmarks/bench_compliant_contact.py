"""Cost of `four_dof` in a compliant contact, beside its rigid stop in the same run: ratios, not seconds.

    PYTHONPATH=tests python tests/benchmarks/bench_compliant_contact.py

CPU seconds of 1000 periods, compiled before they are timed, with contacts of a fiftieth of the period. The loss of
each law is about that of the rigid stop beside it. Once more with a force law on all bodies, whose loads are
collocated: beside the rigid stop with that law, which itself stands beside the one without.
"""

import numpy as np
from benchmarks.bench_four_dof import cpu

from calib.effects.quadratic_drag import EFFECT as DRAG
from calib.modelling.effect import places_of
from calib.modelling.model import Model
from calib.records.excitation import Excitation
from calib.simulators.four_dof import FourDof
from calib.simulators.impact import kernel
from calib.simulators.impact.initial_state import start
from calib.simulators.impact.problem import IMPACTS
from calib.simulators.impact.scratch import scratch

FREQUENCY = 26.24  # Hz
PERIODS = 1000
EXCITATION = Excitation("end", "displacement", frequency=FREQUENCY, amplitude=1.5e-3)
LOSS = {0.05: 20.0, 0.5: 4.0}  # s/m, of hunt_crossley at some 0.4 m/s


def runner(contact, effects=(), **values):
    """Make the function () -> (impacts, share of the time in contact) of the first periods from rest."""
    simulator = FourDof(contact=contact)
    values = {**Model(simulator, effects).nominal, "c2": 1.0, **values}
    laws = [effect.bound(values, places_of(simulator)) for effect in effects]
    problem = simulator.problem(values, EXCITATION, laws)
    rows, none, impacts = np.zeros((PERIODS, 10)), np.zeros((0, 10)), np.zeros((0, 10))

    def run():
        state = start(problem, np.zeros(4), np.zeros(4))
        w = scratch(problem)
        outcome = kernel.advance(problem, state, w, PERIODS, 0.0, 10**9, rows, np.zeros(0), none, impacts)
        assert outcome == kernel.DONE
        return int(state.counters[IMPACTS]), state.clock[1] * FREQUENCY / PERIODS

    run()
    return run


def compare(e, effects):
    """Print the ratios to a rigid stop with the restitution `e`."""
    rigid = runner("rigid", effects, restitution=e)
    for contact in ("kelvin_voigt", "hunt_crossley", "lankarani_nikravesh"):
        loss = {"hunt_crossley": LOSS[e]} if contact == "hunt_crossley" else {"restitution": e}
        for exponent in (1.0, 1.5):
            own = runner(contact, effects, contact_time=0.02 / FREQUENCY, contact_exponent=exponent, **loss)
            mine, (impacts, share) = cpu(own, 5)
            his, (rigid_impacts, _) = cpu(rigid, 5)
            print(
                f"e {e:.2f} {contact:20s} n {exponent:.1f}: {mine / his:5.2f} times the rigid stop; {impacts} "
                f"impacts (rigid {rigid_impacts}), {100.0 * share:.1f} % of the time in contact"
            )


def main():
    """Print the ratios."""
    for e in (0.05, 0.5):
        compare(e, ())
        lawless, lawful = (cpu(runner("rigid", effects, restitution=e), 5)[0] for effects in ((), (DRAG,)))
        print(f"e {e:.2f}, with a force law: {lawful / lawless:5.2f} times without it for the rigid stop, beside which")
        compare(e, (DRAG,))


if __name__ == "__main__":
    main()
