"""Constants, state and results of a run of the full kernel.

Rows of elements and nodes are contiguous and padded, one array an operand: loops over them become vector instructions.
"""

from typing import NamedTuple

import numpy as np

ROW_LENGTH = 1032  # numbers from one row of a strip's coefficients or forces to the next
VECTOR_LANES = 8  # numbers of a vector, to whole ones of which rows are padded
COEFFICIENT_ROWS = 11  # rows of coefficients of a strip
FORCE_ROWS = 8  # rows of nodal forces of a strip
STEPS_DONE, NEXT_SEARCH, LAST_CONTACT, LAST_CENTRAL_CONTACT = range(4)  # places in `counters`


class ExplicitPlan(NamedTuple):
    """Constants of a run.

    Nodes are numbered line by line, padded, all x first, then all y: `size` to each.

    Attributes
    ----------
    size : of a component
    strips : (k, 3) first node of the lower and of the upper line, elements (padded)
    turned : (k,) whether a strip's stress-free elements are not rectangles along x
    factors : (k * COEFFICIENT_ROWS * ROW_LENGTH,) coefficients of the elements, see `elements.forces_of_strip`
    across : (k,) 0.5 / height of the elements  [1/m]
    shear, mean : G, K2, see `elements`  [Pa]
    lines : (l, 4) first node, nodes (padded), strip below, strip above (-1: none)
    shared : (j, 3) first node on the layer's lowest line and on the interface, and how many they have in common
    joint : (3,) strip below the interface, strip above the layer's lowest line, and that line
    inverse_mass : (2 * size,) 0 where a node is held, driven, or a second name of one on the layer's line  [1/kg]
    alpha, beta : [1/s], [s]
    step : [s]
    slave, master, following : (m,) y-nodes of the contact pairs
    weight, clearance, stiffness, damping : (m,) [1], [m], [N/m], [N s/m]
    acting : (m,) whether the two sides are two nodes
    area : (m,) of the pair  [m^2]
    place : (m,) along the delamination  [1]
    lagged, clipped : whether damping sees the velocity before a step, and whether the force cannot pull
    centre : number of the pair in the middle
    driven : y-node
    limit : velocity beyond which the run counts as unstable  [m/s]
    merged : steps without contact that separate two impacts
    force, force_p : of m laws (see `calib.simulators.law_calls`), (m,), (m, numbers)
    acts : (m, 2) whether a force law acts on beam and layer
    bodies : (b, 3) first y-node, nodes and body (0 beam, 1 layer) of ranges on which force laws act
    contact, contact_p : laws of the contact
    counts : (2,) laws at force and contact
    """

    size: int
    strips: np.ndarray
    turned: np.ndarray
    factors: np.ndarray
    across: np.ndarray
    shear: float
    mean: float
    lines: np.ndarray
    shared: np.ndarray
    joint: np.ndarray
    inverse_mass: np.ndarray
    alpha: float
    beta: float
    step: float
    slave: np.ndarray
    master: np.ndarray
    following: np.ndarray
    weight: np.ndarray
    clearance: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    acting: np.ndarray
    area: np.ndarray
    place: np.ndarray
    lagged: bool
    clipped: bool
    centre: int
    driven: int
    limit: float
    merged: int
    force: np.ndarray
    force_p: np.ndarray
    acts: np.ndarray
    bodies: np.ndarray
    contact: np.ndarray
    contact_p: np.ndarray
    counts: np.ndarray


class ExplicitState(NamedTuple):
    """State of a run, written by the kernel.

    Attributes
    ----------
    w, v : (2 * size,) displacement + beta velocity [m], velocity half a step back [m/s]
    elastic : (k * FORCE_ROWS * ROW_LENGTH,) nodal forces of each strip's elements, see `elements.spread`  [N]
    active : (m,) pairs that are closed
    gap, rate, push : (m,) clearance [m], its rate [m/s] half a step back, force [N] of the closed pairs
    mobility, pair_weights : (m,) of the closed pairs with all the others [1/kg]; (2 * size,) sum of
        the weights with which closed pairs push each node of the beam [1], zero between steps
    counters : (4,) steps done in all, next step at which contact is searched for, step of the last contact anywhere,
        and in the middle
    """

    w: np.ndarray
    v: np.ndarray
    elastic: np.ndarray
    active: np.ndarray
    gap: np.ndarray
    rate: np.ndarray
    push: np.ndarray
    mobility: np.ndarray
    pair_weights: np.ndarray
    counters: np.ndarray


class ExplicitTrace(NamedTuple):
    """What is recorded while stepping.

    Attributes
    ----------
    at, shift : (s,) step next to each sample, and the sample's distance from it  [1], [1, in steps]
    samples : (s, 5) displacement of beam and layer in the middle [m], their velocities [m/s], impulse of the contact
        forces on the layer since the sample before [N s]
    impacts, central : (k, 2) step and closing speed [m/s] at which contact begins, anywhere and in the middle
    closed : (m,) steps for which each pair was closed
    total : (5,) impacts, central impacts, steps with contact, largest force [N], deepest penetration [m]
    nearest : (k,) local minima of the clearance while nothing is closed; only where it is not empty
    passes : (3,) smallest clearance one and two steps back, number of minima
    """

    at: np.ndarray
    shift: np.ndarray
    samples: np.ndarray
    impacts: np.ndarray
    central: np.ndarray
    closed: np.ndarray
    total: np.ndarray
    nearest: np.ndarray
    passes: np.ndarray
