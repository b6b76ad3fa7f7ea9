"""What becomes of logged trials where the code that a study uses has changed."""

from collections.abc import Mapping, Sequence

from calib.store.header import Header
from calib.store.trial import Trial
from calib.units import count


def code_change(old: Mapping[str, str], new: Mapping[str, str], trials: int) -> str:
    """Return a sentence on what has changed since `trials` trials were logged; empty where nothing has."""
    if old == new:
        return ""
    changed = sorted(name for name in {**old, **new} if old.get(name) != new.get(name))
    files = [name for name in changed if " " in name]  # "file deck.inp.j2", "program ccx"
    modules = [name for name in changed if " " not in name]
    named = ", ".join(
        [*([f"module{'' if len(modules) == 1 else 's'} {', '.join(modules)}"] if modules else []), *files]
    )
    if not old:
        return (
            f"the code of {named} was not recorded when this study was begun: it is from now on, what is logged "
            f"({count(trials, 'trial')}) stays valid, and a new segment continues it"
        )
    return (
        f"the code of {named} has changed since this study was last run: what is logged "
        f"({count(trials, 'trial')}) no longer counts, and a new segment begins, in which the best of it is "
        "evaluated again with the present code"
    )


def by_present_code(trials: Sequence[Trial], headers: Sequence[Header]) -> list[Trial]:
    """Return the trials, superseded where another code than that of the last header has evaluated them.

    Segments whose code was not recorded are taken to have that of the next one where it was.
    """
    present, known, former = headers[-1].code, headers[-1].code, set[int]()
    for header in reversed(headers):
        known = header.code or known
        if known != present:
            former.add(header.segment)
    return [trial.superseded() if trial.segment in former else trial for trial in trials]
