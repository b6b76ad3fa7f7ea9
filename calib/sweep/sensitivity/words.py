"""A sensitivity in the words of a structural dynamicist."""

from calib.sweep.sensitivity.design import MORRIS
from calib.sweep.sensitivity.document import (
    KIND,
    STATUS,
    Estimate,
    Influence,
    MotionShare,
    OutputSensitivity,
    SensitivityResult,
)
from calib.units import plain_number, reading

NEGLIGIBLE_STRENGTH = 0.05  # upper bound over the strongest parameter's, or of the variance, of one that hardly counts
MIN_MONOTONIC_SHARE = 0.9  # |mu| over mu_star, from which the output rises or falls with the parameter throughout
MIN_NONLINEAR_SHARE = 0.5  # sigma over mu_star, from which the change differs much from place to place


def title(output: OutputSensitivity, records: int) -> str:
    """Name an output; its record where there are several."""
    text = f"{output.label} of {output.body}" if output.body else output.label
    return f"{text} in {output.record}" if output.record and records > 1 else text


def moving(output: OutputSensitivity) -> list[Influence]:
    """Return the influences of the parameters that may count, the strongest first."""
    return [one for one in output.ranked() if not _negligible(one, output)]


def negligible(output: OutputSensitivity) -> list[str]:
    """Return the parameters that hardly count."""
    return [one.parameter for one in output.influences if one.strength is not None and _negligible(one, output)]


def _negligible(one: Influence, output: OutputSensitivity) -> bool:
    strongest = output.ranked()[0].strength
    if one.strength is None or strongest is None or (one.total is None and one.mu_star is None):
        return False  # without a total index interactions may count
    return one.strength.high < NEGLIGIBLE_STRENGTH * (strongest.value if one.mu_star is not None else 1.0)


def in_words(influence: Influence, output: OutputSensitivity) -> str:
    """Say how strongly a parameter moves an output, and how."""
    if influence.mu_star is not None:
        return f"{influence.parameter} {_size(influence.mu_star, output)}, {direction(influence)}"
    parts = [
        f"{name} {interval_in_percent(one)}"
        for name, one in (("alone", influence.first), ("in all", influence.total))
        if one
    ]
    return f"{influence.parameter} {', '.join(parts)}"


def direction(influence: Influence) -> str:
    """Say of Morris' effects whether they have one sign, or differ from place to place."""
    if influence.mu_star is None or influence.mu is None or influence.sigma is None:
        return ""
    size, mean = influence.mu_star.value, influence.mu.value
    if abs(mean) < MIN_MONOTONIC_SHARE * size:
        return "not monotonic"
    way = "rising" if mean > 0.0 else "falling"
    return f"{way}, nonlinear" if influence.sigma.value > MIN_NONLINEAR_SHARE * size else way


def shares_in_words(result: SensitivityResult) -> list[str]:
    """Return a line for each kind of motion and status: how much of the box it has."""
    lines = []
    for one in result.shares:
        lines.append(f"{share_name(one, result)}: {interval_in_percent(one.share)}")
    return lines


def share_name(one: MotionShare, result: SensitivityResult) -> str:
    """Name a kind of motion or a status, and say how it stands to the measured kind."""
    if one.failed:
        return f"failed: {one.motion}"
    if not one.measured:
        return one.motion or "no kind"
    kinds = result.measured_kind
    of_all = "; ".join(f"{name}: {kind}" for name, kind in kinds.items())
    as_measured = one.motion in (of_all, next(iter(kinds.values())) if len(set(kinds.values())) == 1 else "")
    return f"{one.motion or 'no kind'}, {'as measured' if as_measured else 'counted as measured'}"


def _size(estimate: Estimate, output: OutputSensitivity) -> str:
    if output.of in (KIND, STATUS):
        return f"{estimate.value:.2g} [{estimate.low:.2g}, {estimate.high:.2g}]"
    factor, unit = reading(output.unit, estimate.value)
    value, low, high = (plain_number(factor * x, 3) for x in (estimate.value, estimate.low, estimate.high))
    return f"{value} [{low}, {high}] {unit}".rstrip()


def percent(share: float) -> str:
    """Write a share in whole per cent, without a negative zero."""
    return f"{round(100.0 * share) + 0:d} %"


def interval_in_percent(estimate: Estimate) -> str:
    """Write a share with its interval."""
    return f"{percent(estimate.value)} [{percent(estimate.low)}, {percent(estimate.high)}]"


def measure(result: SensitivityResult) -> str:
    """Say what the numbers behind the parameters are."""
    if result.method == MORRIS:
        return (
            "mu*, mean size of the change per window, with its 95 % interval (of a kind: times 2/3 the share of steps "
            "that change it); nonlinear: the change differs from place to place, by itself or by the other parameters"
        )
    return "share of the variance: that of the parameter alone, and with its interactions (in all), with 95 % intervals"
