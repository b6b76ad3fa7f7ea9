"""Checks of initial states that are nuisances of records against windows and values of a study."""

from collections.abc import Mapping

from calib.errors import CalibError
from calib.modelling.model import Model
from calib.objective import INITIAL_STATE, Reference
from calib.objective.initial_state import no_initial_state


def check_solvable(model: Model, reference: Reference) -> None:
    """Check that a model can solve for the initial state of a reference that frees it.

    Raises
    ------
    CalibError : its simulator declares no initial state
    """
    if not reference.frees_initial_state:
        return
    for one in (model, model.confirming):
        if one is not None and not one.initial:
            raise CalibError(f"{reference.name}: {no_initial_state(one)}")


def check_stated(name: str, model: Model, references: Mapping[str, Reference]) -> None:
    """Check that a window or a value "name@record" is not of an initial state that the record solves for itself.

    Raises
    ------
    CalibError : it is
    """
    parameter, _, record = name.partition("@")
    reference = references.get(record)
    if reference is not None and reference.frees_initial_state and parameter in model.initial:
        raise CalibError(
            f"{name!r} is stated, but record {record!r} has the nuisance {INITIAL_STATE!r}, which solves for "
            f"{parameter!r}; drop one of the two"
        )


def check_searched(name: str, model: Model, references: Mapping[str, Reference]) -> None:
    """Check that the window of an initial state has a calibrated record that does not solve for it itself.

    Raises
    ------
    CalibError : it has none
    """
    calibrated = [reference for reference in references.values() if reference.use == "calibrate"]
    if calibrated and all(r.frees_initial_state for r in calibrated) and name in model.initial:
        raise CalibError(
            f"nothing is left to search of {name!r}: every calibrated record has the nuisance {INITIAL_STATE!r}, which "
            "solves for it; drop this window"
        )
