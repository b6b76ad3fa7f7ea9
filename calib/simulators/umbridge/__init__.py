"""The simulator `umbridge`: a model of UM-Bridge, asked over HTTP."""

from calib.simulators.umbridge.um_bridge import UmBridge

__all__ = ["UmBridge"]
