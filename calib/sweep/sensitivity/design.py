"""The points at which a study is evaluated for its sensitivity."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from calib.errors import CalibError, nearest
from calib.sweep.sensitivity.package import salib

Method = Literal["morris", "sobol"]
METHODS: tuple[Method, ...] = get_args(Method)
MORRIS, SOBOL = METHODS
MORRIS_LEVELS = 4  # values of a parameter in a trajectory, from one end of its window to the other
DEFAULT_TRAJECTORIES = 20  # of Morris
DEFAULT_SAMPLES = 128  # base samples of Sobol
MIN_TRAJECTORIES = 4  # of Morris
MIN_SAMPLES = 64  # base samples of Sobol; of fewer, intervals hold some index of test functions in 70-90 % of designs


@dataclass(frozen=True)
class SensitivityDesign:
    """Points of the unit cube in groups of dim + 1 (Morris) or dim + 2 (Sobol); groups are independent of each other.

    A design of more groups begins with the points of one of fewer.

    Attributes
    ----------
    method : "morris": trajectories in which one parameter after the other takes a step of 2/3 of its window, on the
        levels 0, 1/3, 2/3 and 1; "sobol": two points A and B of a scrambled Sobol sequence, and A with each coordinate
        in turn taken from B, in the order A, A_B1 .. A_Bdim, B
    dim : number of parameters
    groups : trajectories, or base samples, of which there is a power of two
    seed : of everything random

    Raises
    ------
    CalibError : another method, or too few groups
    """

    method: Method
    dim: int
    groups: int
    seed: int

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise CalibError(
                f"method is one of {', '.join(METHODS)}, got {self.method!r}{nearest(self.method, METHODS)}"
            )
        least, what = (MIN_TRAJECTORIES, "trajectories") if self.method == MORRIS else (MIN_SAMPLES, "samples")
        if self.groups < least:
            raise CalibError(f"expected at least {least} {what}, got {self.groups}")
        if self.method == SOBOL and self.groups & (self.groups - 1):
            below = 1 << (self.groups.bit_length() - 1)
            raise CalibError(
                f"Sobol's sequence is balanced at powers of two: expected such a number of samples, got {self.groups}; "
                f"the nearest are {below} and {2 * below}"
            )

    @property
    def group_size(self) -> int:
        """Points of a group."""
        return self.dim + (1 if self.method == MORRIS else 2)

    @property
    def size(self) -> int:
        """Number of points."""
        return self.groups * self.group_size

    @cached_property
    def points(self) -> np.ndarray:
        """Points (size, dim) of the unit cube.

        Raises
        ------
        CalibError : SALib is not installed
        """
        problem = {
            "num_vars": self.dim,
            "names": [f"x{axis}" for axis in range(self.dim)],
            "bounds": [[0.0, 1.0]] * self.dim,
        }
        if self.method == MORRIS:
            sample = salib("sample.morris").sample(problem, self.groups, num_levels=MORRIS_LEVELS, seed=self.seed)
        else:
            sample = salib("sample.sobol").sample(problem, self.groups, calc_second_order=False, seed=self.seed)
        return np.clip(np.asarray(sample, dtype=float), 0.0, 1.0)

    def grouped(self, values: np.ndarray) -> np.ndarray:
        """Values (size, ...) of the points as (groups, group_size, ...)."""
        return values.reshape(self.groups, self.group_size, *values.shape[1:])
