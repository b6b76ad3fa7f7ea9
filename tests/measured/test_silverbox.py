"""The linear oscillator on the Silverbox: as good as a linear model can be, and wrong for a known reason."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter

from calib.modelling.effect import Effect
from calib.modelling.laws import force
from calib.modelling.parameter import Parameter
from calib.study_file import load

STUDY = Path(__file__).parents[2] / "studies" / "silverbox" / "study.toml"


@pytest.fixture(scope="module")
def study(measured):
    measured("silverbox/SNLS80mV.csv")
    return load(STUDY)


@pytest.fixture(scope="module")
def best(study):
    """Return the values (SI) of the best fit of the study's model, its free-run output (n,) and its reference."""
    (reference,) = study.study.objective.references.values()
    measured_ = reference.record.displacement.values[0]
    names = study.study.space.names

    def simulated(x):
        values = dict(zip(names, [*np.exp(x[:3]), x[3]], strict=True))
        record = study.study.model.run(values, reference.excitation, reference.request)
        assert record.attrs["status"] == "ok", record.attrs["reason"]
        return record.displacement.values[0]

    assert names == ("mass", "damping", "stiffness", "load")
    begin = [np.log(5e-6), np.log(2e-4), 0.0, 0.0]
    fit = least_squares(lambda x: simulated(x) - measured_, begin, x_scale=[0.1, 0.1, 0.1, 0.01])
    return dict(zip(names, [*np.exp(fit.x[:3]), fit.x[3]], strict=True)), simulated(fit.x), reference


def relative(error, measured_):
    return np.linalg.norm(error) / np.linalg.norm(measured_ - measured_.mean())


def discrete_linear_model(u, y, margin):
    """Free-run error (n,) of the best y[k] = sum b_i u[k-i] - sum a_i y[k-i] + c, i to 2, after `margin` samples."""

    def output(theta):
        b, a, offset = theta[:3], np.r_[1.0, theta[3:5]], theta[5]
        stable = abs(a[2]) < 1.0 and abs(a[1]) < 1.0 + a[2]
        return lfilter(b, a, u) + offset if stable else np.full(u.size, 1e3)

    def error(theta):
        return (output(theta) - y)[margin:]

    rows = np.c_[u[2:], u[1:-1], u[:-2], -y[1:-1], -y[:-2], np.ones(y.size - 2)]
    begin = np.linalg.lstsq(rows, y[2:], rcond=None)[0]  # one-step prediction, biased, as a start
    return least_squares(error, begin, x_scale=np.maximum(np.abs(begin), 1e-3)).fun


def test_the_oscillator_simulates_as_well_as_the_best_linear_discrete_model(best):
    _, output, reference = best
    y = reference.record.displacement.values[0]
    u = reference.excitation.value
    margin = int(np.sum(reference.excitation.time < 0.0))
    known = np.concatenate([np.zeros(margin), y])  # not looked at before the record begins
    peer = relative(discrete_linear_model(u[: margin + y.size], known, margin), y)
    ours = relative(output - y, y)
    assert 0.10 < peer < 0.16
    assert ours < 1.1 * peer


def test_the_values_are_those_of_the_circuit(best):
    values, _, _ = best
    frequency = np.sqrt(values["stiffness"] / values["mass"]) / (2 * np.pi)
    assert frequency == pytest.approx(69.6, abs=0.5)  # Hz, of the best linear approximation at this level
    assert values["damping"] / (2 * np.sqrt(values["stiffness"] * values["mass"])) == pytest.approx(0.05, abs=0.005)


@force
def hardening(t, x, v, p, z, dz):
    """Return the force per unit mass [m/s^2] of a cubic spring: -p[0] x^3."""
    return -p[0] * x**3


CUBIC = Effect("cubic", "force", hardening, (Parameter("k3_m", "1/(m^2 s^2)", 0.0, "k3 / m", null=0.0),), "hardening")


def test_one_step_ahead_the_cube_of_the_output_is_what_a_linear_model_lacks(measured):
    file = measured("silverbox/SNLS80mV.csv")
    u, y = np.loadtxt(file, delimiter=",", skiprows=40586, max_rows=86915, usecols=(0, 1)).T
    linear = np.c_[u[2:], u[1:-1], u[:-2], y[1:-1], y[:-2], np.ones(y.size - 2)]
    cubic = np.c_[linear, y[1:-1] ** 3]
    left = [y[2:] - rows @ np.linalg.lstsq(rows, y[2:], rcond=None)[0] for rows in (linear, cubic)]
    assert left[0].std() / y.std() == pytest.approx(0.0119, abs=0.0002)
    assert left[0].var() / left[1].var() == pytest.approx(5.1, abs=0.1)


@pytest.mark.slow
def test_a_cubic_spring_is_what_was_missing(study, best):
    """The cause is known: m y'' + d y' + k1 y + k3 y^3 = u."""
    values, output, reference = best
    y = reference.record.displacement.values[0]
    model = study.study.model.extended(CUBIC)

    def error(x):
        names = ("mass", "damping", "stiffness", "load", "k3_m")
        cubic = dict(zip(names, [*np.exp(x[:3]), x[3], 1e5 * x[4]], strict=True))
        record = model.run(cubic, reference.excitation, reference.request)
        return record.displacement.values[0] - y

    begin = [*np.log([values[name] for name in ("mass", "damping", "stiffness")]), values["load"], 5.0]
    fit = least_squares(error, begin, x_scale=[0.1, 0.1, 0.1, 0.01, 1.0], ftol=1e-2)
    assert relative(fit.fun, y) < 0.2 * relative(output - y, y)
    assert 1e5 * fit.x[4] * np.exp(fit.x[0]) == pytest.approx(3.9, abs=0.5)  # k3 [N/m^3], at 1 N/V and 1 m/V
