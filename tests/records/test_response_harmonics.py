"""Higher harmonics of frequency responses: schema, what is compared of them, tables and files."""

import numpy as np
import pytest
import xarray as xr
from scipy.io import savemat

from calib.errors import CalibError
from calib.records import read, write
from calib.records.compared_response import compared_harmonics, compared_of, compared_tolerances
from calib.records.held_response import as_measured, at_one_level
from calib.records.response import (
    check_response,
    complex_amplitude,
    complex_harmonics,
    harmonic_orders,
    harmonic_tolerances,
    make_response,
    parts_of,
    tolerances,
)
from calib.records.response_columns import ResponseColumns, StatedLevel, UnitColumn
from calib.records.response_table import ResponseTable, read_response, read_response_columns

FREQUENCY = np.array([9.0, 10.0, 11.0, 9.5, 10.5, 11.5])  # Hz
OMEGA = 2.0 * np.pi * FREQUENCY
SWEEP = np.repeat([0, 1], 3)
LEVEL = np.array([2.0, 0.5, 1.5, 6.0, 2.0, 5.0])  # N
HELD = np.array([1e-3, 1e-3, 1e-3, 3e-3, 3e-3, 3e-3])  # m
MASS = HELD * np.exp(-1j * np.radians([10.0, 90.0, 170.0, 20.0, 120.0, 175.0]))
FIRST = np.array([MASS, 2.0 * MASS])
SECOND = 0.1 * FIRST * np.exp(-0.5j)
THIRD = np.array([0.02j * MASS, 0.05 * MASS])


def response(**further):
    own = {"higher": {2: SECOND, 3: THIRD}, "place": "mass", "quantity": "force", **further}
    return make_response(FREQUENCY, ["mass", "tip"], FIRST, LEVEL, "N", SWEEP, **own)


def test_a_response_has_the_parts_of_its_harmonics():
    record = check_response(response(higher={5: SECOND, 2: THIRD}), "it")
    assert harmonic_orders(record) == (1, 2, 5)
    assert parts_of(record) == ("in_phase", "quadrature", "in_phase_2", "quadrature_2", "in_phase_5", "quadrature_5")
    np.testing.assert_array_equal(complex_harmonics(record), [FIRST, THIRD, SECOND])
    np.testing.assert_array_equal(complex_amplitude(record), FIRST)


def test_a_harmonic_without_an_uncertainty_has_that_of_the_first():
    plain = response()
    np.testing.assert_array_equal(harmonic_tolerances(plain), 3 * [tolerances(plain)[1]])
    sigma = np.full(FIRST.shape, 1e-5)
    stated = response(sigma=sigma, higher_sigma={3: 0.1 * sigma})
    np.testing.assert_array_equal(harmonic_tolerances(stated), [sigma, sigma, 0.1 * sigma])


def test_a_response_with_harmonics_goes_through_a_file_unchanged(tmp_path):
    record = response(higher_sigma={2: np.full(FIRST.shape, 1e-5)})
    write(record, tmp_path / "it.nc")
    xr.testing.assert_identical(read(tmp_path / "it.nc"), check_response(record, "it"))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda r: r.rename(in_phase_2="in_phase_1"),
            r"in_phase_1: the order .* is 2 to 7, got '1'; the first .* with",
        ),
        (lambda r: r.rename(in_phase_2="in_phase_-2"), r"in_phase_-2: the order .* got '-2'"),
        (lambda r: r.rename(in_phase_2="in_phase_8"), r"in_phase_8: the order .* got '8'"),
        (lambda r: r.drop_vars("quadrature_2"), r"in_phase_2 is of harmonic 2, whose quadrature_2 is missing"),
        (lambda r: r.drop_vars("in_phase_3"), r"quadrature_3 is of harmonic 3, whose in_phase_3 is missing"),
        (lambda r: r.assign(response_4_sigma=r.in_phase_2), r"response_4_sigma is of harmonic 4, whose in_phase_4"),
        (lambda r: r.assign(in_phase_2=r.in_phase_2 * np.nan), r"in_phase_2 states no unit|in_phase_2 is not a number"),
        (
            lambda r: r.assign(in_phase_sigma=r.in_phase_2),
            r"in_phase_sigma is not known: .* response_2_sigma, and that",
        ),
        (lambda r: r.assign(in_phase_2=r.in_phase_2.T), r"expected in_phase_2 with dims \('body', 'point'\)"),
        (
            lambda r: r.assign(response_2_sigma=0.0 * r.in_phase),
            r"response_2_sigma states no unit|response_2_sigma is exp",
        ),
    ],
)
def test_a_mistake_in_a_harmonic_is_told(change, message):
    with pytest.raises(CalibError, match=message):
        check_response(change(response()), "it")


def test_a_unit_of_force_is_none_of_a_harmonic():
    record = response()
    record["in_phase_2"].attrs["units"] = "N"
    with pytest.raises(CalibError, match="in_phase_2: expected a quantity that can be given in m, got"):
        check_response(record, "it")
    record["in_phase_2"].attrs["units"] = "mm"
    np.testing.assert_allclose(check_response(record, "it").in_phase_2, 1e-3 * SECOND.real)


def test_of_a_held_amplitude_harmonics_are_counted_from_the_phase_of_the_body_that_was_held():
    record = at_one_level(response(), "mass")
    first, second, third = compared_harmonics(record)
    np.testing.assert_allclose(np.abs(second[0]), 0.1 * HELD)
    np.testing.assert_allclose(second, SECOND * np.exp(-2j * np.angle(MASS)), rtol=1e-12)
    np.testing.assert_allclose(third, THIRD * np.exp(-3j * np.angle(MASS)), rtol=1e-12)
    np.testing.assert_allclose(first[1], 2.0 * HELD)
    again = compared_of(compared_harmonics(record), record.sweep.values, record)
    np.testing.assert_allclose(again, complex_harmonics(record), rtol=1e-12)
    np.testing.assert_allclose(complex_harmonics(as_measured(record)), [FIRST, SECOND, THIRD], rtol=1e-12)


def test_their_uncertainties_are_in_proportion_those_of_the_motion():
    sigma, rng = np.full(FIRST.shape, 1e-5), np.random.default_rng(3)
    record = at_one_level(response(sigma=sigma, higher_sigma={2: 2.0 * sigma, 3: 0.01 * sigma}), "mass")
    drawn, size = [], harmonic_tolerances(record)
    for _ in range(2000):  # the third harmonic errs by what turns it, the phase of the first
        own = complex_harmonics(record) + size * (rng.standard_normal((3, *FIRST.shape, 2)) @ [1.0, 1.0j])
        drawn.append(compared_of(own, record.sweep.values, record))
    scatter = np.std(drawn, axis=0)[1:] / np.sqrt(2.0)  # of both parts; what turns shows in one alone
    stated = compared_tolerances(record)[1][1:]
    assert ((scatter > 0.6 * stated) & (scatter < 1.1 * stated)).all()
    assert (stated[1] > 3.0 * 1e-7).all()  # its own uncertainty is 1e-7 m


HEADER = (
    "frequency [Hz], mass amplitude [mm], mass phase [deg], mass sigma [um], "
    "mass harmonic 2 amplitude [m/s^2], mass harmonic 2 phase [deg], mass harmonic 2 sigma [m/s^2], "
    "mass harmonic 3 in-phase [um], mass harmonic 3 quadrature [um]"
)
ROWS = "9, 1, -10, 5, 0.5, -60, 0.1, 3, -4\n10, 2, -90, 5, 0.7, -170, 0.1, 6, -8\n"


def table(tmp_path, header=HEADER, rows=ROWS, level=1.0, unit="N"):
    (tmp_path / "it.csv").write_text(f"# place: mass\n# quantity: force\n{header}\n{rows}")
    return read_response(tmp_path / "it.csv", StatedLevel(level, unit))


def test_columns_of_harmonics_are_brought_to_displacement_at_their_frequency(tmp_path):
    record = table(tmp_path)
    assert harmonic_orders(record) == (1, 2, 3)
    twice = 2.0 * OMEGA[:2]
    second = -np.array([0.5, 0.7]) * np.exp(1j * np.radians([-60.0, -170.0])) / twice**2
    np.testing.assert_allclose(complex_harmonics(record)[1, 0], second, rtol=1e-12)
    np.testing.assert_allclose(complex_harmonics(record)[2, 0], [3e-6 - 4e-6j, 6e-6 - 8e-6j], rtol=1e-12)
    np.testing.assert_allclose(record.response_2_sigma[0], 0.1 / twice**2, rtol=1e-12)
    np.testing.assert_array_equal(harmonic_tolerances(record)[2], record.response_sigma)


def test_the_acceleration_of_a_base_turns_a_harmonic_by_so_many_times_its_phase(tmp_path):
    """Base displacement is opposite to its acceleration: half a period of the drive is a whole one of harmonic 2."""
    header = (
        "frequency [Hz], level [m/s^2], mass amplitude [mm/m], mass phase [deg], mass harmonic 2 amplitude [mm], "
        "mass harmonic 2 phase [deg], mass harmonic 3 amplitude [mm/m], mass harmonic 3 phase [deg]"
    )
    record = table(tmp_path, header, "9, 2, 1, 0, 1, 30, 1, 40\n10, 2, 1, 0, 1, 30, 1, 40\n")
    base = 2.0 / OMEGA[:2] ** 2
    second, third = complex_harmonics(record)[1:, 0]
    np.testing.assert_allclose(second, 1e-3 * np.exp(1j * np.radians(30.0)), rtol=1e-12)
    np.testing.assert_allclose(third, 1e-3 * base * np.exp(1j * np.radians(40.0)), rtol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("harmonic 2 phase", "harmonic 2 phse", "'mass harmonic 2 phse .*' is not known"),
        ("mass harmonic 3 quadrature [um]", "mass harmonic 4 quadrature [um]", "of harmonic 3 of body 'mass'"),
        ("harmonic 3", "harmonic 1", "order of a higher harmonic is 2 to 7, got '1'"),
        ("harmonic 3", "harmonic -3", "got '-3'"),
        ("harmonic 3", "harmonic 2.5", "got '2.5'"),
        ("mass harmonic 3", "base harmonic 3", "harmonic 3 is of 'base', which has no first harmonic"),
        ("[m/s^2]", "[N]", "expected a unit of displacement, velocity or acceleration"),
        ("mass harmonic 3 in-phase", "mass harmonic 2 amplitude", "second one of its kind"),
        ("mass harmonic 2 phase", "mass 2nd harmonic phase", "a harmonic is named by its order, as in 'BODY harmonic"),
    ],
)  # fmt: skip
def test_a_mistake_in_a_column_is_told(tmp_path, old, new, message):
    with pytest.raises(CalibError, match=message):
        table(tmp_path, HEADER.replace(old, new))


def test_the_noise_of_an_accelerometer_is_the_same_at_any_order(tmp_path):
    header = (
        "frequency [Hz], mass amplitude [m/s^2], mass phase [deg], mass sigma [m/s^2], "
        "mass harmonic 3 amplitude [m/s^2], mass harmonic 3 phase [deg]"
    )
    record = table(tmp_path, header, "9, 4, -10, 0.01, 0.5, -60\n10, 5, -90, 0.01, 0.7, -170\n")
    first, third = harmonic_tolerances(record)[:, 0]
    np.testing.assert_allclose(first, 0.01 / OMEGA[:2] ** 2, rtol=1e-12)
    np.testing.assert_allclose(third, first / 9.0, rtol=1e-12)


def test_a_harmonic_of_one_body_alone_is_refused(tmp_path):
    header = (
        "frequency [Hz], mass amplitude [mm], mass phase [deg], tip amplitude [mm], tip phase [deg], "
        "mass harmonic 2 amplitude [mm], mass harmonic 2 phase [deg]"
    )
    with pytest.raises(CalibError, match="harmonic 2 is given of mass, not of tip; give it of all bodies or of none"):
        table(tmp_path, header, "9, 2, -1, 1, -2, 1, -30\n10, 2, -1, 1, -2, 1, -30\n")


def test_a_ratio_of_accelerations_of_a_harmonic_is_refused(tmp_path):
    header = (
        "frequency [Hz], level [m/s^2], mass amplitude [g/g], mass phase [deg], mass harmonic 2 amplitude [g/g], "
        "mass harmonic 2 phase [deg]"
    )
    with pytest.raises(
        CalibError, match=r"'g/g' does not say whether harmonic 2 is a ratio of displacements or of acc"
    ):
        table(tmp_path, header, "9, 2, 1, 0, 1, 30\n10, 2, 1, 0, 1, 30\n")


def test_a_cell_that_is_no_number_is_told(tmp_path):
    with pytest.raises(CalibError, match="line 4.*nan|nan.*line 4"):
        table(tmp_path, rows=ROWS.replace("0.5, -60", "nan, -60"))


def test_harmonics_are_read_from_a_matrix(tmp_path):
    orders = np.array([[1.0 + 2.0j, 3.0 - 1.0j], [0.5j, 2.0]])
    savemat(tmp_path / "orders.mat", {"f": np.array([10.0, 20.0]), "H": orders})

    def columns(k):
        parts = (("in-phase", "real"), ("quadrature", "imag"))
        return {("mass", what): UnitColumn(f"{part}(H(:,{k}))", "mm") for what, part in parts}

    stated = ResponseColumns(
        UnitColumn("f", "Hz"),
        columns(1),
        StatedLevel(2.0, "N"),
        higher={2: columns(2)},
        higher_sigma={2: {"mass": "0.1 mm"}},
    )
    record = read_response_columns(ResponseTable(tmp_path / "orders.mat", stated))
    np.testing.assert_allclose(complex_harmonics(record)[:, 0], 1e-3 * orders.T, rtol=1e-12)
    np.testing.assert_allclose(record.response_2_sigma, 1e-4)
