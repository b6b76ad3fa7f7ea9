"""Parameters of the simulator `delaminated_beam`."""

from calib.modelling.parameter import Parameter

PARAMETERS = (
    Parameter("alpha", "1/s", 500.0, "mass-proportional Rayleigh damping", null=0.0, low=0.0),
    Parameter("beta", "1", 0.02, "stiffness damping, as a share of critical at the elements' highest frequency "
              "(the unitless coefficient of LS-DYNA): beta = 1 is critical_step seconds", null=0.0, low=0.0),
    Parameter("beta_seconds", "s", 0.0, "classical stiffness-proportional damping, added", null=0.0, low=0.0),
    Parameter("f", "1", 0.01, "factor on the contact stiffness", low=0.0),
    Parameter("c_con", "1", 5.0, "contact damping over C_crit = 2 m w of each pair, with m the smaller of its masses: "
              "up to half the true damping ratio", null=0.0, low=0.0),
    Parameter("dt", "s", 9.38e-8, "time step; the longest below it that divides the period is taken. In reduced "
              "fidelity it decides only whether a run is stable, and its effect shows in full", low=0.0),
    Parameter("f_dt", "1", 0.0, "time step over the computed critical one (eq. 4), in the place of dt; 0: dt holds",
              null=0.0, low=0.0),
    Parameter("g_max", "m", 0.2e-3, "height of the gap's cubics in the middle (Fig. 8)", low=0.0),
    Parameter("s", "m", 0.8e-3, "shift of the gap", null=0.0),
    Parameter("gap", "m", 1.0e-3, "gap in the middle, where the shift is tied: s = gap - g_max"),
    Parameter("amplitude", "1", 1.0, "scale on the excitation's amplitude", null=1.0),
    Parameter("length", "m", 1.386, "length of the beam", low=0.0),
    Parameter("delamination", "m", 0.56, "length of the delamination", low=0.0),
    Parameter("beam_thickness", "m", 7.5e-3, "thickness of the remaining beam", low=0.0),
    Parameter("layer_thickness", "m", 2.5e-3, "thickness of the layer", low=0.0),
    Parameter("width", "m", 0.040, "width of the beam", low=0.0),
    Parameter("support", "m", 0.373, "distance of the supports from the middle; the mesh node nearest to it is taken",
              low=0.0),
    Parameter("young_modulus", "Pa", 70.0e9, "Young's modulus", low=0.0),
    Parameter("poisson_ratio", "1", 0.3, "Poisson's ratio", low=0.0, high=0.5),
    Parameter("density", "kg/m^3", 2700.0, "density", low=0.0),
)  # fmt: skip
GEOMETRY = ("length", "delamination", "beam_thickness", "layer_thickness", "support")  # of the undeformed shape
NOT_OF_STRUCTURE = ("alpha", "beta", "beta_seconds", "f", "c_con", "dt", "f_dt", "s", "gap", "amplitude")
