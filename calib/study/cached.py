"""Trials that no run of the simulator was made for."""

from collections.abc import Sequence

from calib.store import Trial


def answered_from_cache(trials: Sequence[Trial]) -> list[str]:
    """Say how many trials a simulator has answered from its cache alone; nothing where none."""
    count = sum(trial.simulations == 0 for trial in trials)
    if not count:
        return []
    return [
        f"{count} of {len(trials)} trials were answered from the cache of earlier runs with the same inputs; the best "
        "point was run anew"
    ]
