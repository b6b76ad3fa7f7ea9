"""What the peers of `calib discover` are given: the records cut at their impacts, and more of the truth than calib."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import xarray as xr
from hidden.foreign_laws import Written, load
from hidden.system import System

LEAST_SAMPLES = 8  # of a piece between impacts  [count]


class Piece(NamedTuple):
    """What was measured between two impacts: instants (n,), displacement, velocity, and the load over the mass."""

    t: np.ndarray
    x: np.ndarray
    v: np.ndarray
    load: np.ndarray


class Data(NamedTuple):
    """All that the peers are given.

    Attributes
    ----------
    records : pieces of each, cut at the impacts
    whole : each record as one piece
    impacts : of each record  [s]
    sigma : (record, 2) standard deviations of the noise  [m], [m/s]
    linear : stiffness and damping over the mass  [1/s^2], [1/s]
    sizes : of x and v, by which columns are made dimensionless  [m], [m/s]
    """

    records: list[list[Piece]]
    whole: list[Piece]
    impacts: list[list[float]]
    sigma: np.ndarray
    linear: tuple[float, float]
    sizes: tuple[float, float]


Force = Callable[[np.ndarray, np.ndarray], np.ndarray]
Columns = Callable[[np.ndarray, np.ndarray], np.ndarray]


def data_of(at: Written, setup: System, sizes: tuple[float, float]) -> Data:
    """Read the records that are not held out."""
    records, whole, impacts, sigma, mass = [], [], [], [], setup.truth["mass"]
    for plan in setup.plans:
        if plan.use == "holdout":
            continue
        with xr.open_dataset(at.folder / f"{plan.name}.nc") as record:
            t = setup.times(plan)
            x, v = record["displacement"].values[0], record["velocity"].values[0]
        push = load(setup, plan) * setup.truth["amplitude"] / mass
        piece = Piece(t, x, v, push)
        instants = sorted(at.flights[plan.name].impacts)
        edges = np.concatenate([[0], np.searchsorted(t, instants), [t.size]]).astype(int)
        cut = [Piece(*(column[a:b] for column in piece)) for a, b in zip(edges[:-1], edges[1:], strict=True)]
        records.append([own for own in cut if own.t.size >= LEAST_SAMPLES])
        whole.append(piece)
        impacts.append(instants)
        sigma.append(at.sigma[plan.name].ravel())
    linear = setup.truth["stiffness"] / mass, setup.truth["damping"] / mass
    return Data(records, whole, impacts, np.array(sigma), linear, sizes)
