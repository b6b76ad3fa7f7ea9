"""The full kernel: central differences over corotational quadrilaterals with penalty contact.

Velocities live half a step before displacements. With w = u + beta v, the internal forces f(w) of all elements, the
contact forces F and the lumped masses M,

    v+ = [(1 - alpha dt/2) v - dt M^-1 (f(w) - F)] / (1 + alpha dt/2),    u+ = u + dt v+

so that alpha damps M v centrally and beta damps K v with the velocity half a step back; w is stored instead of u.
"""

from calib.simulators.delaminated_beam.explicit.elements import elastic
from calib.simulators.delaminated_beam.explicit.energy import audit
from calib.simulators.delaminated_beam.explicit.plan import ExplicitPlan, ExplicitState, ExplicitTrace
from calib.simulators.delaminated_beam.explicit.stepping import DONE, UNSTABLE, advance

__all__ = ["DONE", "UNSTABLE", "ExplicitPlan", "ExplicitState", "ExplicitTrace", "advance", "audit", "elastic"]
