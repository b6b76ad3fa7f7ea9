"""The options of the simulator: flat outside, in groups inside."""

import inspect
import math
from dataclasses import FrozenInstanceError, fields

import pytest
from short_beam import beam

from calib.errors import CalibError
from calib.simulators.delaminated_beam import DelaminatedBeam
from calib.simulators.delaminated_beam.options import GROUPS, BeamOptions, MeshOptions


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"fidelity": "ful"}, "did you mean 'full'"),
        ({"contact_stiffness": "mass"}, "bulk, mass_dt"),
        ({"damper": "implicit"}, "semi_implicit"),
        ({"layer": "bent"}, "straight, arched"),
        ({"shift": "fixed"}, "free, tied"),
        ({"masters": 7}, "even"),
        ({"masters": 0}, "from 1 on"),
        ({"slaves": 2.0}, "whole number"),
        ({"outer": True}, "whole number"),
        ({"refinement": -1}, "from 1 on"),
        ({"modes": 0}, "from 1 on"),
        ({"steps": 1.5}, "whole number"),
        ({"parts": "8"}, "whole number"),
        ({"every": 5}, "divides the 112 elements"),
        ({"settle_limit": 0}, "from 1 on"),
        ({"beam_rows": []}, "positive heights"),
        ({"beam_rows": 5.0}, "positive heights"),
        ({"layer_rows": [1.0, -1.0]}, "positive heights"),
        ({"layer_rows": ["a"]}, "positive heights"),
        ({"tolerance": 0.0}, "such as 0.01"),
        ({"tolerance": math.nan}, "such as 0.01"),
        ({"tolerance": "small"}, "such as 0.01"),
        ({"damper": "lagged"}, "needs fidelity 'full'"),
        ({"damper": "lagged", "fidelity": "auto"}, "needs fidelity 'full'"),
        ({"gap_table": 1e-3}, "at least two pairs"),
        ({"gap_table": [[0.0, 1e-3]]}, "at least two pairs"),
        ({"gap_table": [[0.0, "wide"], [1.0, 0.0]]}, "at least two pairs"),
        ({"gap_table": [[0.0, math.nan], [1.0, 0.0]]}, "at least two pairs"),
        ({"gap_table": [[1.0, 0.0], [0.0, 1e-3]]}, "must increase"),
        ({"gap_table": [[0.0, 1e-3], [0.5, 0.0]]}, "from 0 .or -1. to 1"),
        ({"gap_table": [[-0.5, 1e-3], [1.0, 0.0]]}, "from 0 .or -1. to 1"),
        ({"gap_table": [[-1.0, 0.0], [1.0, 0.0]]}, "symmetric = false"),
        ({"fidelity": "full", "refinement": 7}, "lower refinement"),
        ({"symmetric": "no"}, "symmetric is true or false, got 'no'"),
        ({"clipped": 0}, "clipped is true or false"),
        ({"fidelity": "full", "balance": "yes"}, "balance is true or false"),
        ({"modes": 945}, "945 modes of a mesh with 945 freedoms; take fewer"),
    ],
)
def test_an_option_that_cannot_be_is_refused_and_the_refusal_says_what_can(options, message):
    with pytest.raises(CalibError, match=message):
        DelaminatedBeam(**options)


def test_more_modes_than_the_mesh_has_freedoms_are_refused():
    tiny = {"masters": 2, "outer": 1, "slaves": 1}
    with pytest.raises(CalibError, match="fewer modes or a finer mesh"):
        beam(**tiny)
    beam(**tiny, fidelity="full")  # has no use for modes


def test_an_unknown_option_is_answered_with_the_nearest_and_with_all():
    with pytest.raises(CalibError, match=r"'mastres' .*did you mean 'masters'.*it takes fidelity, contact_stiffness, "):
        DelaminatedBeam(mastres=8)


def test_the_signature_has_every_option_with_its_default():
    known = inspect.signature(DelaminatedBeam).parameters
    assert list(known) == ["fidelity", *(option.name for group in GROUPS for option in fields(group))]
    for group in GROUPS:
        for option in fields(group):
            assert known[option.name].default == option.default


def test_every_option_is_described():
    text = inspect.getdoc(DelaminatedBeam)
    listed = text.partition("Parameters")[2].partition("Notes")[0]
    names = {name for line in listed.splitlines() if " : " in line for name in line.partition(" : ")[0].split(", ")}
    assert set(inspect.signature(DelaminatedBeam).parameters) <= names


def test_flat_options_are_sorted_into_their_groups_and_do_not_change():
    options = BeamOptions.of("full", {"masters": 8, "damper": "lagged"})
    assert (options.fidelity, options.mesh, options.contact.damper) == ("full", MeshOptions(masters=8), "lagged")
    with pytest.raises(FrozenInstanceError):
        options.mesh.masters = 10
