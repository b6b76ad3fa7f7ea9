"""Values of a study that its simulator does not take are found when the study is read."""

from collections.abc import Iterable, Mapping

from calib.errors import CalibError
from calib.modelling.model import Model
from calib.modelling.parameter import Space, values_for
from calib.objective import Reference
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
