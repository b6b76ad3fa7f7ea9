"""What all tests share: the fork server from which their child processes start."""

from functools import partial

import pytest


@pytest.fixture(scope="session", autouse=True)
def fork_server():
    """Start it with all imported that calibrations and sweeps need.

    A process has one fork server, and it preloads what the first pool needs. Where that is a pool of next to nothing,
    every child of every later pool imports numba, scipy and xarray by itself: two seconds of each `calib run`.
    """
    # here: the process that only hands tests out to others reads this file too
    from calib.execution.pool import LocalPool
    from calib.simulators.delaminated_beam import DelaminatedBeam
    from calib.simulators.four_dof import FourDof
    from calib.simulators.oscillator import Oscillator
    from calib.workflows.calibrate import calibrate

    with LocalPool(partial(calibrate, DelaminatedBeam, FourDof, Oscillator)) as pool:
        assert list(pool.map([])) == []  # the server starts, and no child
