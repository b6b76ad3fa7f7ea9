"""Values of a study that its simulator does not take are found when the study is read."""

from collections.abc import Iterable, Mapping

from calib.dynamics.held_curve import held_system
from calib.dynamics.response import AMPLITUDE, FREQUENCY, sampled
from calib.dynamics.setting import Setting
from calib.errors import CalibError
from calib.modelling.model import Model
from calib.modelling.parameter import Space, values_for
from calib.objective import Reference
from calib.records.held_response import is_held
from calib.records.response import is_response
from calib.study_file.mistakes import Mistakes
from calib.units import shown


def start_values(model: Model, space: Space) -> dict[str, float]:
    """Values [SI] at which a search starts; where none are stated the nominal ones, or the nearest in their windows."""
    point = space.starting_point
    if point is not None:
        return space.values(point)
    nominal = {name: model.parameters[name.partition("@")[0]].nominal for name in space.names}
    inside = {name: min(max(nominal[name], window.low), window.high) for name, window in space.windows.items()}
    return {**space.fixed, **inside}


def check_values(model: Model, space: Space, references: Iterable[Reference], mistakes: Mistakes) -> None:
    """Note starting values, and ends of windows, at which the simulator can compute nothing."""
    reference = next(iter(references), None)
    if reference is None:
        return

    def check(values: Mapping[str, float]) -> None:
        model.check_values(values_for(values, reference.name), reference.excitation, reference.request)

    start = start_values(model, space)
    with mistakes.at("model", "options"):
        check(start)
    if mistakes.within("model", "options"):
        return
    for name, window in space.windows.items():
        unit = model.parameters[name.partition("@")[0]].unit
        for end, value in (("low", window.low), ("high", window.high)):
            with mistakes.at("windows", name, end):
                try:
                    check({**start, name: value})
                except CalibError as error:
                    raise CalibError(f"at {name} = {shown(value, unit)}: {error}") from error


def check_responses(model: Model, space: Space, references: Mapping[str, Reference], mistakes: Mistakes) -> None:
    """Note frequency responses that cannot be simulated: at the start, or at an end of a window.

    That is without a period map that samples the motion, and where the amplitude was held without a modal system and a
    harmonic drive.

    Parameters
    ----------
    references : of the records of the study, in their order
    """
    start = start_values(model, space)
    ends = [{name: value} for name, window in space.windows.items() for value in (window.low, window.high)]
    for index, reference in enumerate(references.values()):
        if not is_response(reference.record):
            continue
        held = is_held(reference.record)
        with mistakes.at("record", index, "excitation", *(("held",) if held else ())):
            for end in ({}, *ends):
                _check_simulated(
                    Setting(model, reference.excitation, values_for({**start, **end}, reference.name)), held
                )


def _check_simulated(setting: Setting, held: bool) -> None:
    try:
        if held:
            held_system(setting, setting.value(FREQUENCY), setting.value(AMPLITUDE))
        else:
            sampled(setting, setting.map())
    except ValueError:  # nothing could move: a trial that fails
        return
