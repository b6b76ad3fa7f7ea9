"""The laws of a site as a kernel is handed them: as many rows as there are laws."""

import numpy as np
import pytest

from calib.modelling.laws import LAW_PARAMETERS, BoundLaw
from calib.modelling.laws import force as force_site
from calib.plugins import load
from calib.simulators.law_calls import acting, addresses

LONG = 78  # numbers of a free function of two arguments
SITES = {
    "gap": "gap_offset",
    "contact": "contact_compliance",
    "excitation": "drive_harmonic_2",
    "restitution": "rate_restitution",
}


@force_site
def half(t, x, v, p, z, dz):
    return -0.5 * v


@pytest.mark.parametrize("number", [0, 1, 6])
def test_each_force_law_has_an_address_a_row_of_numbers_and_the_places_where_it_acts(number):
    sizes = [LONG if i == 3 else LAW_PARAMETERS for i in range(number)]
    laws = [
        BoundLaw("force", half.function, np.arange(1.0, size + 1.0), ("a",) if i else None)
        for i, size in enumerate(sizes)
    ]
    at, numbers, count = addresses(laws, "force")
    assert (at.dtype, at.shape, count) == (np.int64, (number,), number)
    assert numbers.shape == (number, max(sizes, default=LAW_PARAMETERS))
    for row, law in zip(numbers, laws, strict=True):
        np.testing.assert_array_equal(row, np.concatenate([law.p, np.zeros(row.size - law.p.size)]))
    expected = [[True, True]] + [[True, False]] * (number - 1) if number else np.zeros((0, 2))
    np.testing.assert_array_equal(acting(laws, ["a", "b"]), expected)


@pytest.mark.parametrize("site", SITES)
def test_a_site_takes_its_own_laws_alone(site):
    effect = load("calib.effects", SITES[site])
    own = effect.bound({p.name: p.nominal for p in effect.parameters})
    at, numbers, count = addresses([BoundLaw("force", half.function, np.zeros(LAW_PARAMETERS)), own, own, own], site)
    assert count == len(at) == len(numbers) == 3
    assert len(set(at.tolist())) == 1
