"""Which parameter moves which feature of the motion, inside the windows of a study."""

from calib.sweep.sensitivity.analyse import analyse
from calib.sweep.sensitivity.design import MORRIS, SOBOL, SensitivityDesign
from calib.sweep.sensitivity.document import SensitivityResult
from calib.sweep.sensitivity.run import evaluated

__all__ = ["MORRIS", "SOBOL", "SensitivityDesign", "SensitivityResult", "analyse", "evaluated"]
