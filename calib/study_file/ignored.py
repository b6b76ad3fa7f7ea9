"""Excitations that a simulator cannot tell apart, though the records of a study say that they differ."""

import math
from collections.abc import Mapping
from typing import Any

from calib.modelling.simulator import Simulator
from calib.objective import Reference
from calib.records.excitation import Excitation
from calib.study_file.mistakes import Mistakes


def check_ignored(known: Mapping[str, Reference | None], simulator: Simulator, mistakes: Mistakes) -> None:
    """Note records that differ in a part of their excitation which the simulator ignores, and a phase that it ignores.

    Parameters
    ----------
    known : name of a record, in the order of the study -> its reference, None where that is mistaken
    simulator : which may state in `ignored` what has no influence on its records
    """
    ignored: Mapping[str, str] = getattr(simulator, "ignored", {})
    first: dict[str, tuple[str, Any, str]] = {}
    for index, (name, reference) in enumerate(known.items()):
        if reference is None:
            continue
        for part, (value, text) in _parts(reference.excitation).items():
            if part not in ignored:
                continue
            key = ("record", index, "excitation", part)
            if part == "phase" and value != 0.0:
                mistakes.add(key, f"{text} has no influence on what is simulated: {ignored[part]}")
                continue
            other, known_value, known_text = first.setdefault(part, (name, value, text))
            if value != known_value:
                mistakes.add(
                    key,
                    f"{text} of this record and {known_text} of {other!r} are simulated alike: {ignored[part]}",
                )


def _parts(excitation: Excitation) -> dict[str, tuple[Any, str]]:
    """Parts by which excitations differ, each with its value, which can be compared, and as a message names it."""
    place = f"{excitation.quantity} at {excitation.place!r}"
    parts: dict[str, tuple[Any, str]] = {"place": (place, f"the excitation by {place}")}
    if excitation.harmonic:
        tone = excitation.as_harmonic
        parts["frequency"] = tone.frequency, f"the frequency of {tone.frequency:g} Hz"
        parts["amplitude"] = tone.amplitude, f"the amplitude of {tone.amplitude:g} {excitation.unit}"
        parts["phase"] = tone.phase, f"the phase of {math.degrees(tone.phase):g} deg"
    elif excitation.recorded:
        samples = excitation.as_samples
        parts["value"] = (samples.time.tobytes(), samples.value.tobytes()), "the recorded input"
    return parts
