"""A function as it is sent to another process."""

import pickle
from collections.abc import Callable
from dataclasses import dataclass
from types import FunctionType
from typing import Any

from calib.errors import CalibError

SCRIPT = "__main__"  # module of what a script, a notebook or a session defines


@dataclass(frozen=True)
class SentFunction:
    """A pickled function of one argument.

    Attributes
    ----------
    code : the function and what it holds, pickled
    modules : that a process needs to call it
    """

    code: bytes
    modules: frozenset[str]

    @property
    def in_script(self) -> bool:
        """Whether the script that runs, or the session, defines a part of it."""
        return SCRIPT in self.modules

    @property
    def importable(self) -> list[str]:
        """Modules that any process can import, sorted."""
        return sorted(self.modules - {SCRIPT})


def pickled(function: Callable[[Any], Any]) -> SentFunction:
    """Pickle `function`, and note the modules that a process needs to call it.

    Raises
    ------
    CalibError : it cannot be pickled
    """
    file = _Buffer()
    pickler = _Modules(file)
    try:
        pickler.dump(function)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise CalibError(
            f"the function cannot be sent to a child process ({error}); define it and what it holds at module level"
        ) from error
    return SentFunction(bytes(file), frozenset(pickler.names))


class _Modules(pickle.Pickler):
    """Pickler that notes the modules its classes and functions come from."""

    def __init__(self, file: "_Buffer"):
        super().__init__(file)
        self.names: set[str] = set()

    def reducer_override(self, obj: Any) -> Any:
        """Note the module of `obj` and leave its pickling as it is."""
        if isinstance(obj, type | FunctionType):
            self.names.add(obj.__module__)
        elif isinstance(module := getattr(obj, "module", None), str):  # pickled by reference to it, as laws are
            self.names.add(module)
        return NotImplemented


class _Buffer(bytearray):
    def write(self, data: bytes) -> None:
        self.extend(data)
