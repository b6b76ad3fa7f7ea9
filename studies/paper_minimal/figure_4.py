"""Figure 4: the bifurcation diagram over the coefficient of restitution, sections of periods 1000 to 1100.

    python studies/paper_minimal/figure_4.py

The sweep in three lines; the rest draws it, with the period-1 orbit followed to the end of its branch.
"""

from pathlib import Path

import numpy as np

from calib.dynamics.branch import follow
from calib.dynamics.motion import kind_of_orbit
from calib.report.continuation import branch_diagram
from calib.report.diagrams import bifurcation_diagram, impact_diagram
from calib.study_toml import load
from calib.sweep import Sweep, run

HERE = Path(__file__).parent
BODIES = ("q2", "q3")
VALUES = 401  # of the coefficient of restitution, from 0 to 0.8
