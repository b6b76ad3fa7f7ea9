"""Laws of a compliant stop, by name: their parameters, what the kernel takes, and their limit of a rigid stop.

The force over the penetration d and its rate d', per unit mass of the body that an impact turns round, is

====================  ==============================================  ==============================================
kelvin_voigt          max(0, k d^n + c d')                            Kelvin and Voigt, without tension
hunt_crossley         max(0, k d^n (1 + hunt_crossley d'))            Hunt & Crossley, J. Appl. Mech. 42 (1975) 440
lankarani_nikravesh   max(0, k d^n (1 + 3 (1 - e^2) d' / (4 v0)))     Lankarani & Nikravesh, J. Mech. Des. 112 (1990)
                                                                      369; v0 the closing speed of this impact
gonthier              max(0, k d^n (1 + a d' / v0))                   Gonthier et al., Multibody System Dynamics 11
                                                                      (2004) 209; a(e) so that e is the restitution
====================  ==============================================  ==============================================

with n = contact_exponent (1 a flat contact, 1.5 Hertz's of a sphere) and e = restitution. The stiffness is stated by
contact_time, how long a loss-free impact at 1 m/s lasts: a record shows that time, the departure from a rigid stop is
proportional to it, and at 0 the stop is rigid. For n = 1 it is half a period of the mass on the contact's spring,
whatever the speed; for another n it falls with the speed to the power (n - 1) / (n + 1). For kelvin_voigt the damper
follows from the restitution e of a free mass for n = 1; for another n, the one that has it for n = 1 is taken. That of
gonthier follows from e whatever n and the speed: 1 + a = (1 - e a) exp(a (1 + e)).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import gamma

from calib.modelling.laws import LAW_PARAMETERS, BoundLaw, restitution
from calib.modelling.parameter import Parameter

ContactName = Literal["rigid", "kelvin_voigt", "hunt_crossley", "lankarani_nikravesh", "gonthier"]
CONTACTS: tuple[ContactName, ...] = ("rigid", "kelvin_voigt", "hunt_crossley", "lankarani_nikravesh", "gonthier")
COMPLIANT: frozenset[str] = frozenset(CONTACTS) - {"rigid"}
BY_SPEED = ("lankarani_nikravesh", "gonthier")  # whose loss is relative to the closing speed
REFERENCE_SPEED = 1.0  # m/s, of the impact that lasts `contact_time`
MAX_DAMPING_RATIO = 50.0  # of kelvin_voigt; its restitution of 1e-4 stands for all below
MAX_LOSS = 100.0  # of gonthier, over the closing speed; its restitution of 0.01 stands for all below  [1]
MAX_EXPONENT = 3.0  # of the penetration  [1]
MAX_SERIES_LOSS = 3e-3  # loss factor times speed below which the restitution is taken from its series  [1]
MAX_RESTITUTION_STEPS = 60  # for the restitution of a lossy contact

_TIME = Parameter("contact_time", "s", 5e-4, "duration of a loss-free impact at 1 m/s", null=0.0, low=0.0)
_LOSS = Parameter("hunt_crossley", "s/m", 0.3, "loss factor of the contact", null=0.0, low=0.0)


def _exponent(nominal: float) -> Parameter:
    return Parameter("contact_exponent", "1", nominal, "of the penetration in the force", null=1.0, low=1.0, high=1.5)


def with_contact(parameters: tuple[Parameter, ...], name: ContactName) -> tuple[Parameter, ...]:
    """Parameters of a simulator whose own are those of a rigid stop, with those of the law of its contact."""
    if name == "rigid":
        return parameters
    if name == "hunt_crossley":
        own = tuple(parameter for parameter in parameters if parameter.name != "restitution")
        return (*own, _TIME, _LOSS, _exponent(1.5))
    meaning = "coefficient of restitution from which the loss of the contact follows"
    own = tuple(replace(parameter, meaning=meaning) if parameter.name == "restitution" else parameter
                for parameter in parameters)  # fmt: skip
    return (*own, _TIME, _exponent(1.0 if name == "kelvin_voigt" else 1.5))


class ContactLaw(NamedTuple):
    """Numbers of a law; see `problem.Compliance`.

    Attributes
    ----------
    highest_frequency : angular frequency or rate of decay in a contact after an impact at 1 m/s  [rad/s]
    """

    stiffness: float
    exponent: float
    damping: float
    loss: float
    by_speed: bool
    highest_frequency: float


def stop_law(
    name: ContactName, values: Mapping[str, float], laws: Sequence[BoundLaw]
) -> tuple[ContactLaw | None, float, Sequence[BoundLaw]]:
    """Law of a compliant contact (None: the stop is rigid), Newton's coefficient of a rigid one, and all other laws.

    Raises
    ------
    ValueError : a contact time, an exponent, a restitution or a loss factor that no contact has
    """
    if name == "rigid":
        return None, values.get("restitution", 0.0), laws
    law = contact_law(name, values)
    if law is not None:
        return law, 0.0, laws
    e, changes = rigid_limit(name, values)
    return None, e, [*laws, *changes]


def contact_law(name: ContactName, values: Mapping[str, float]) -> ContactLaw | None:
    """Return the numbers of the law of a compliant contact; None at a contact time of 0, at which it is rigid."""
    time, n, e = values["contact_time"], values["contact_exponent"], values.get("restitution", 1.0)
    if not time >= 0.0:
        raise ValueError(f"a contact time of {time:g} s")
    if not 1.0 <= n <= MAX_EXPONENT:
        raise ValueError(f"a contact exponent of {n:g}, which lies outside 1 to {MAX_EXPONENT:g}")
    if not 0.0 <= e <= 1.0:
        raise ValueError(f"a restitution of {e:g}, which lies outside 0 to 1")
    if not values.get("hunt_crossley", 0.0) >= 0.0:
        raise ValueError(f"a loss factor of {values['hunt_crossley']:g} s/m")
    if time == 0.0:
        return None
    frequency = math.pi / time
    damping = loss = 0.0
    if name == "kelvin_voigt":
        damping = 2.0 * damping_ratio(e) * frequency
    elif name == "hunt_crossley":
        loss = values["hunt_crossley"]
    elif name == "gonthier":
        loss = loss_of(e)
    else:
        loss = lankarani_nikravesh_loss(e)
    return ContactLaw(
        stiffness=stiffness(time, n),
        exponent=n,
        damping=damping,
        loss=loss,
        by_speed=name in BY_SPEED,
        highest_frequency=max(frequency, damping),
    )


def rigid_limit(name: ContactName, values: Mapping[str, float]) -> tuple[float, list[BoundLaw]]:
    """Newton's coefficient of the rigid stop that a law becomes at a contact time of 0, and what changes that."""
    if name == "hunt_crossley":
        p = np.zeros(LAW_PARAMETERS)
        p[0] = values["hunt_crossley"]
        return 0.0, [BoundLaw("restitution", of_loss.function, p)]
    e = values["restitution"]
    if name == "lankarani_nikravesh":
        return float(of_loss.function(0.0, 1.0, np.array([lankarani_nikravesh_loss(e)]))), []
    return e, []


def lankarani_nikravesh_loss(e: float) -> float:
    """Loss factor times the closing speed [1] of Lankarani and Nikravesh (1990) for a restitution `e`."""
    return 0.75 * (1.0 - e * e)


def stiffness(time: float, exponent: float) -> float:
    """Stiffness per unit mass [m^(1 - n)/s^2] with which a loss-free impact at 1 m/s lasts `time` [s].

    The half of it is the integral of dx / sqrt(1 - x^(n + 1)) from 0 to 1, times the deepest penetration, over the
    speed; m v^2 / 2 = k d^(n + 1) / (n + 1) gives that penetration.
    """
    n = exponent
    integral = math.sqrt(math.pi) * gamma(1.0 / (n + 1.0)) / ((n + 1.0) * gamma(1.0 / (n + 1.0) + 0.5))
    return 0.5 * (n + 1.0) * (2.0 * integral / time) ** (n + 1.0) * REFERENCE_SPEED ** (1.0 - n)


def restitution_of(damping_ratio: float) -> float:
    """Restitution of a free mass after a tension-free contact with a linear spring and damper.

    It leaves where the force comes down to zero, before the spring has relaxed.
    """
    z = damping_ratio
    if z < 1.0:
        w = math.sqrt(1.0 - z * z)
        return math.exp(-(z / w) * (math.pi - math.atan2(2.0 * z * w, w * w - z * z)))
    if z == 1.0:
        return math.exp(-2.0)
    w = math.sqrt(z * z - 1.0)
    return math.exp(-(z / w) * math.log((z + w) ** 2))  # (z + w)^2 = (z + w) / (z - w), without cancellation


@lru_cache(maxsize=1024)
def damping_ratio(restitution: float) -> float:
    """Damping ratio [1] of a tension-free contact with a restitution [1]: the inverse of `restitution_of`."""
    if restitution >= 1.0:
        return 0.0
    if restitution <= restitution_of(MAX_DAMPING_RATIO):
        return MAX_DAMPING_RATIO
    return float(brentq(lambda z: restitution_of(z) - restitution, 0.0, MAX_DAMPING_RATIO, xtol=1e-15, rtol=1e-14))


@lru_cache(maxsize=1024)
def loss_of(restitution: float) -> float:
    """Loss factor times closing speed [1] of a contact with a restitution [1]: the inverse of `of_loss`."""

    def excess(loss: float) -> float:
        return float(of_loss.function(0.0, 1.0, np.array([loss]))) - restitution

    if restitution >= 1.0:
        return 0.0
    if excess(MAX_LOSS) >= 0.0:
        return MAX_LOSS
    return float(brentq(excess, 0.0, MAX_LOSS, xtol=1e-15, rtol=1e-14))


@restitution
def of_loss(e: float, speed: float, p: np.ndarray) -> float:
    """Return the change of the coefficient e [1], at a closing speed [m/s], to that of k d^n (1 + p[0] d').

    Whatever n, the speeds v before and u after it obey x - ln(1 + x) = -y - ln(1 - y), with x = p v and y = p u.
    """
    x = p[0] * speed
    if x < MAX_SERIES_LOSS:
        return 1.0 - x * (2.0 / 3.0 - x * (4.0 / 9.0 - x * (44.0 / 135.0 - x * 104.0 / 405.0))) - e
    target = x - math.log1p(x)
    s = -1.0 - target  # ln(1 - y), from the side from which Newton's steps come near without passing
    for _ in range(MAX_RESTITUTION_STEPS):
        step = (math.expm1(s) - s - target) / math.expm1(s)
        s -= step
        if abs(step) < 1e-15 * abs(s):
            break
    return -math.expm1(s) / x - e
