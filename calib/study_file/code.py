"""The code outside calib that a study uses: digests of files, or versions of installed distributions and programs."""

import sys
from collections.abc import Iterable
from pathlib import Path

from calib import plugins
from calib.execution.module_code import module_code
from calib.modelling.simulator import Simulator
from calib.study_file.schema import StudyToml
from calib.study_file.session_code import session_digest

SCRIPT = "__main__"  # module of what a script defines that is being run


def used_code(shape: StudyToml, folder: Path | None, simulator: Simulator | None = None) -> dict[str, str]:
    """Return module -> "sha256 ..." of its source, or name and version of the distribution that installed it.

    These are the modules of simulator, effects, features and optimiser outside calib, and the modules in the same
    folder, or in that of the study, which they import. The code of calib itself is known by its version. What a
    script, a notebook or an interactive session defines stands with its name and a digest of its compiled code. Files
    and programs stand with their name.

    Parameters
    ----------
    folder : in which modules of the study lie; None: all are on Python's path
    simulator : which may name further modules, files and programs in `code`; None names none
    """
    references = [
        ("calib.simulators", shape.model.simulator),
        *(("calib.effects", effect.name) for effect in shape.model.effects),
        *(("calib.features", term.feature) for term in shape.term),
        ("calib.optimisers", shape.optimiser.name),
    ]
    code = code_of(references, folder)
    return dict(sorted({**code, **getattr(simulator, "code", {})}.items()))


def code_of(references: Iterable[tuple[str, str]], folder: Path | None) -> dict[str, str]:
    """Return the same of what plugins refer to that are loaded, each a group and a name in it."""
    folders = [] if folder is None else [folder.resolve()]
    code: dict[str, str] = {}
    for group, name in references:
        module = plugins.module_name(group, name)
        if module.partition(".")[0] == "calib":
            continue
        file = getattr(sys.modules.get(module), "__file__", None)
        if file is None or module == SCRIPT:
            code[name] = session_digest(plugins.load(group, name, folder))
        if file is not None:
            code |= module_code(module, Path(file).resolve(), folders)
    code.pop(SCRIPT, None)  # its budget and its pictures are no part of the simulator
    return code
