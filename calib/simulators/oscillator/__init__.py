"""One mass on a spring and a damper, with recorded, harmonic or no input: the simplest simulator for measured data."""

from calib.simulators.oscillator.oscillator import Oscillator

__all__ = ["Oscillator"]
