"""Conformance suites that third parties subclass; they need what `calib[testing]` installs, which is pytest."""

from calib.testing.effect_suite import EffectSuite
from calib.testing.optimiser_suite import OptimiserSuite
from calib.testing.simulator_suite import SimulatorSuite

__all__ = ["EffectSuite", "OptimiserSuite", "SimulatorSuite"]
