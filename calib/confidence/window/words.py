"""A window in the words of a structural dynamicist."""

from collections.abc import Mapping

from calib.confidence.window.document import WINDOW_END, ExactFaces, ParameterTolerance, WindowResult
from calib.records.cycles import WITHOUT_KIND
from calib.units import plain_number, shown

OPEN = "open"  # an end that the box of the study's windows bounds, and not the model


def percent(share: float) -> str:
    """Write a share in per cent with two significant digits, and all before the point."""
    return f"{plain_number(100.0 * share, 2)} %"


def share_in_words(result: WindowResult) -> str:
    """Say how large the window is; at most, where the interval reaches down to nothing."""
    if not result.share_low:
        return f"at most {percent(result.share_high)} of the box is admissible (with 97.5 % probability)"
    return (
        f"{percent(result.share)} of the box is admissible (95 % interval {percent(result.share_low)} to "
        f"{percent(result.share_high)})"
    )


def admissible_in_words(result: WindowResult) -> str:
    """Say what a point has to fulfil."""
    distances = ", ".join(f"{label} up to {value:.3g}" for label, value in result.tolerances.items())
    if all(kind in WITHOUT_KIND for kind in result.measured_kind.values()):
        return f"a distance of {distances}"
    return f"the measured kind of motion, and a distance of {distances}"


def alone(own: ParameterTolerance) -> str:
    """Interval of a parameter while all others stay."""
    low = OPEN if own.alone_low_cause == WINDOW_END else shown(own.alone_low, own.unit)
    high = OPEN if own.alone_high_cause == WINDOW_END else shown(own.alone_high, own.unit)
    return f"{low} .. {high}{_relative(own.value, own.alone_low, own.alone_high, OPEN in (low, high))}"


def together(own: ParameterTolerance) -> str:
    """Interval of a parameter in the largest box."""
    if own.together_low is None or own.together_high is None:
        return "none"
    relative = _relative(own.value, own.together_low, own.together_high)
    return f"{shown(own.together_low, own.unit)} .. {shown(own.together_high, own.unit)}{relative}"


def bounds(own: ParameterTolerance) -> str:
    """What bounds the window towards low and high values of a parameter."""
    sides = [
        f"{side}: {mechanisms_in_words(mechanisms)}"
        for side, mechanisms in (("below", own.low_mechanisms), ("above", own.high_mechanisms))
        if mechanisms
    ]
    return "; ".join(sides)


def exact_in_words(faces: ExactFaces) -> str:
    """Say what was followed over a slice, and how far the emulated boundary is from it."""
    where = f"over {faces.first} and {faces.second}"
    if not faces.kinds:
        return f"{where}: no curve ({faces.reason})"
    curves = " and ".join(faces.kinds)
    if faces.distance is None:
        return f"{where}: {curves} followed; the window ends at none of them in this slice"
    return (
        f"{where}: {curves} followed; the emulated boundary is at most {percent(faces.distance)} of the windows' width "
        "from them where the kind of motion changes"
    )


def mechanisms_in_words(mechanisms: Mapping[str, float], most: int = 2) -> str:
    """Name the most frequent mechanisms with their shares."""
    return ", ".join(f"{name} {percent(share)}" for name, share in list(mechanisms.items())[:most])


def _relative(value: float, low: float, high: float, open: bool = False) -> str:
    if open or not value:
        return ""
    return f" ({_signed(100.0 * (low - value) / abs(value))} / {_signed(100.0 * (high - value) / abs(value))} %)"


def _signed(change: float) -> str:
    return f"{'' if change < 0.0 else '+'}{plain_number(change, 2)}"
