"""What the kernel takes: the structure in each of its two regimes, the drive, the stop, the laws, the state."""

from typing import NamedTuple

import numpy as np


class Regimes(NamedTuple):
    """A linear structure in its two states, free (row 0) and in contact (row 1), in modal coordinates.

    In each the coordinates move as q(t) = shape y(t) + motion [cos wt, sin wt, 1] + motion_input U(t), where the modal
    part obeys y'' + 2 rate y' + stiffness y = f(t) with only those loads that `motion` does not carry. The witness

        W = witness_y . y + witness_v . y' + witness [cos wt, sin wt, 1] + witness_input . (U, U', U'')
            + witness_law . (accelerations by the laws)

    is positive while the state lasts: the clearance out of contact [m], the pressing acceleration in contact [m/s^2].
    The contact has a mode less; its place is taken by one without shape.

    Attributes
    ----------
    stiffness : (2, n) eigenvalues, any sign  [1/s^2]
    rate : (2, n) decay rates  [1/s]
    shape : (2, n, n) mass-normalised modes, in columns  [kg^-1/2]
    project : (2, n, n) shape^T M  [kg^1/2]
    motion : (2, n, 3) harmonic and constant part of the coordinates  [m]
    motion_input : (2, n) of the tabulated or law-made input U  [m per unit of U]
    load_input : (2, n, 3) modal load of U, U', U''
    load_constant : (2, n) modal load at rest that no static deflection carries (modes without stiffness)
    witness_y, witness_v : (2, n)
    witness : (2, 3)
    witness_input : (2, 3)
    witness_law : (2, n) of the laws' accelerations of the coordinates
    """

    stiffness: np.ndarray
    rate: np.ndarray
    shape: np.ndarray
    project: np.ndarray
    motion: np.ndarray
    motion_input: np.ndarray
    load_input: np.ndarray
    load_constant: np.ndarray
    witness_y: np.ndarray
    witness_v: np.ndarray
    witness: np.ndarray
    witness_input: np.ndarray
    witness_law: np.ndarray


class Compliance(NamedTuple):
    """A stop that yields.

    Over the penetration d [m] and its rate d' [m/s], the contact opens the clearance by the acceleration

        max(0, stiffness d^exponent (1 + loss d') + damping d')

    which is the contact force per unit mass of the body that an impact turns round.

    Attributes
    ----------
    stiffness : [m^(1 - exponent)/s^2]
    exponent : 1 or more  [1]
    damping : [1/s]
    loss : [s/m], or [1] where it is divided by the closing speed of the impact at hand; 0 where there is damping
    by_speed : whether it is
    slowest : closing speed that a slower one counts as, where it is  [m/s]
    step, free_step : longest step in contact under the force, and without  [s]
    load : (n,) modal load, out of contact, per unit of the acceleration
    """

    stiffness: float
    exponent: float
    damping: float
    loss: float
    by_speed: bool
    slowest: float
    step: float
    free_step: float
    load: np.ndarray


class Loads(NamedTuple):
    """Loads that enter by polynomials over the step.

    Attributes
    ----------
    by_rate : whether the rate of the input loads the structure, or moves its coordinates
    """

    by_rate: bool


RIGID: Compliance = None  # type: ignore[assignment]  # kernels that need a compliance are compiled for one only
UNLOADED: Loads = None  # type: ignore[assignment]  # as above


class Problem(NamedTuple):
    """Everything that a run holds fixed.

    Attributes
    ----------
    regimes : the structure, free and in contact
    stop : whether there is a stop
    hit : (n,) change of the velocities per unit change of the clearance's rate at an impact
    restitution : Newton's coefficient before any law  [1]
    height : an impact that rebounds less than this sticks  [m]
    period, omega : of the drive  [s], [rad/s]; without a period, the duration of the run and 0
    amplitude, phase : of the drive, for the laws of the excitation
    exact : whether events are located; else an impact is taken at the end of the step that shows it
    onto_surface : whether an impact that was not located also puts the body back on the surface
    step : longest step  [s]; infinite where closed forms reach as far as they like
    resolution : to which event times are located  [s]
    lift : flight after a release over which no event is searched for  [s]
    extent : largest displacement that the gap, the drive, the loads and the scale of the motion let expect  [m]
    fastest : highest angular frequency or rate of decay in the motion  [rad/s]
    knots : (k + 1,) ends of the table's pieces  [s]; (0,) without a table
    table : (k, 4) coefficients of U = c0 + c1 s + c2 s^2 + c3 s^3, s the time since the piece's start  [s]
    force, excitation, restitution_laws : (m,) laws of each site (see `law_calls`)
    force_p, excitation_p, restitution_p : (m, numbers)
    counts : (5,) laws at the sites force, excitation, restitution; internal states of all force laws; force laws at the
        port
    acts : (m, n + 1) whether a force law acts on a coordinate, and last, at the port: there it sees the clearance,
        out of contact, and nothing in contact
    push : (n,) acceleration of the coordinates per unit of a law at the port
    loads : that enter by polynomials over the step, None where there are none
    compliance : of the stop, None where it is rigid; kernels are compiled for the one and for the other, and so they
        are with loads and without
    """

    regimes: Regimes
    stop: bool
    hit: np.ndarray
    restitution: float
    height: float
    period: float
    omega: float
    amplitude: float
    phase: float
    exact: bool
    onto_surface: bool
    step: float
    resolution: float
    lift: float
    extent: float
    fastest: float
    knots: np.ndarray
    table: np.ndarray
    force: np.ndarray
    excitation: np.ndarray
    restitution_laws: np.ndarray
    force_p: np.ndarray
    excitation_p: np.ndarray
    restitution_p: np.ndarray
    counts: np.ndarray
    acts: np.ndarray
    push: np.ndarray
    loads: Loads = UNLOADED
    compliance: Compliance = RIGID


class ImpactState(NamedTuple):
    """Where a run stands; the kernel writes it.

    Attributes
    ----------
    y, v : (n,) modal part of the motion in the present regime; in a compliant contact, that of the free regime
    z : (force laws, n + 1, STATES) their internal states
    clock : (3,) time since the last whole period [s]; time spent in contact [s]; closing speed at which the last
        compliant contact began [m/s]
    counters : (7,) whole periods done; regime (FREE, CONTACT of a rigid stop, COMPRESSION or PARTED of a compliant
        one); steps taken; piece of the table; whether the stop is being touched (HIT, RELEASED, else 0); impacts;
        sections taken
    limits : (2,) displacement [m] and velocity [m/s] beyond which the motion counts as diverged
    """

    y: np.ndarray
    v: np.ndarray
    z: np.ndarray
    clock: np.ndarray
    counters: np.ndarray
    limits: np.ndarray


# entry REGIME of the counters; PARTED: beyond the surface of a compliant stop, whose force has come down to zero
FREE, CONTACT, COMPRESSION, PARTED = range(4)
PORT = "interface"  # the body's name by which a force law acts between the two that meet
AT_PERIOD, REGIME, STEPS, PIECE, TOUCH, IMPACTS, SECTIONS = range(7)  # entries of `ImpactState.counters`
CLOSING = 2  # entry of `ImpactState.clock`
HIT, RELEASED = 1, 2  # entry TOUCH of the counters, 0 otherwise
FORCE_LAWS, EXCITATION_LAWS, RESTITUTION_LAWS, LAW_STATES, PORT_LAWS = range(5)  # entries of `Problem.counts`
