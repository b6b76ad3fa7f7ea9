"""Numbers as they are written for a reader."""

import numpy as np
import pytest

from calib.report.formatting import (
    distinguishing_digits,
    measured_number,
    number,
    number_and_half,
    quantity,
    raised,
    rounded,
    signed,
    with_error,
)


@pytest.mark.parametrize(
    ("value", "half", "written"),
    [
        (2.4, 0.16, "2.40 ± 0.16"),
        (3.0, 1e-5, "3.000000 ± 0.000010"),
        (-94649.3, 90279.0, "−95000 ± 90000"),
        (1234567.0, 34567.0, "(1.235 ± 0.035)·10⁶"),
        (0.1234567e-9, 0.034567e-9, "(1.23 ± 0.35)·10⁻¹⁰"),
        (2.4, None, "2.4"),
        (-0.00001, 0.0017, "0.0000 ± 0.0017"),
        (9.999, 0.0996, "10.00 ± 0.10"),
        (1.0, 1e-20, "1 ± 1·10⁻²⁰"),
        (float("nan"), 1.0, "-"),
    ],
)
def test_a_value_and_its_interval_have_the_places_of_the_intervals_second_digit(value, half, written):
    assert with_error(value, half) == written


def test_a_value_alone_is_rounded_by_twice_its_error():
    assert rounded(0.12345, 0.01) == "0.123"
    assert rounded(94649.0, 4000.0) == "94600"
    assert rounded(12345678.0, 1.0) == "1.23456780·10⁷"
    assert rounded(1.0, 5e-324) == "1"
    assert rounded(np.nan, 1.0) == "-"
    assert rounded(-np.inf, 1.0) == "-∞"


@pytest.mark.parametrize(
    ("value", "half", "written"),
    [
        (3.188e6, 315980.0, ("3.19·10⁶", "0.32·10⁶")),
        (2.1e11, 1e6, ("2.100000·10¹¹", "0.000010·10¹¹")),
        (-3.3e6, 10.0, ("-3.300000·10⁶", "0.000010·10⁶")),
        (1.01, 0.0604, ("1.010", "0.060")),
        (0.0, 123.0, ("0", "120")),
        (1.0, np.inf, ("1", "∞")),
        (1.5, None, ("1.5", "")),
        (1.5, 0.0, ("1.5", "0")),
    ],
)
def test_a_value_and_its_half_interval_apart_end_at_one_place_and_have_one_power_of_ten(value, half, written):
    assert number_and_half(value, half) == written


@pytest.mark.parametrize("value", [5e-324, 1e-310, 0.0, -0.0, 9.99996e-5, 999999.6, 1.7e308, np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("error", [5e-324, 1e-12, 1.0, 1e308, np.inf, np.nan, 0.0, None])
def test_every_number_is_written_with_a_readable_number_of_digits(value, error):
    texts = [f(value, error) for f in (measured_number, with_error, rounded)] + [*number_and_half(value, error)]
    assert max(map(len, [number(value), *texts])) <= 60


def test_a_number_that_is_rounded_up_to_a_power_of_ten_is_written_with_that_power():
    assert number(9.99996e-5) == "0.0001"
    assert number(999999.6) == "1·10⁶"
    assert number(9.9999e7) == "1·10⁸"


def test_a_quantity_has_the_unit_of_its_size():
    assert quantity(-1.2e-3, "m", half=3.4e-4) == "−1.20 ± 0.34 mm"
    assert quantity(4.8e-6, "m") == "4.8 µm"
    assert quantity(0.99996, "m") == "1 m"


def test_a_quantity_has_no_more_digits_than_asked_for_before_its_point_either():
    assert quantity(314667.0, "m/s^2") == "315000 m/s²"
    assert quantity(21664.0, "1/(m^2 s^2)", 2) == "22000 1/(m² s²)"


@pytest.mark.parametrize(
    ("z", "written"), [(0.04, "0.0"), (-3.14, "−3.1"), (99.9, "+99.9"), (312.6, "> 100"), (-14646.0, "< −100")]
)
def test_no_one_counts_hundreds_of_standard_errors(z, written):
    assert signed(z, "+") == written


@pytest.mark.parametrize(
    ("unit", "written"),
    [("m/s^2", "m/s²"), ("m^-10 s", "m⁻¹⁰ s"), ("m^-0.5 s^-0.5", "m^-0.5 s^-0.5"), ("N/m^1.5", "N/m^1.5")],
)
def test_whole_powers_of_a_unit_are_raised_and_others_stay(unit, written):
    assert raised(unit) == written


def test_the_ends_of_an_interval_get_digits_until_they_differ():
    assert distinguishing_digits(0.1, 0.2) == 2
    assert distinguishing_digits(0.1402, 0.1441) == 3
    assert distinguishing_digits(0.14, 0.14) == 6


@pytest.mark.parametrize("negative", [-0.00012, -440000.0])
def test_a_negative_size_without_an_interval_has_the_minus_of_one_with_it(negative):
    assert quantity(negative, "1/(m^2 s^2)").startswith("−")
    assert quantity(negative, "1/(m^2 s^2)", half=0.1 * abs(negative)).lstrip("(").startswith("−")
