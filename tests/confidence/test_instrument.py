"""Claims about nuisances as parameters, against those that are solved for."""

import json
import math

import numpy as np
import pytest
from echo_study import TRUTH, bench, write_study

from calib import records
from calib.confidence.instrument import instrument, nuisances_of, unused_uncertainties, with_sampled_nuisances
from calib.confidence.prior import Prior
from calib.errors import CalibError
from calib.objective import Reference
from calib.study import evaluate
from calib.study_file import load

NUISANCE = ('nuisance = ["trigger"]', 'nuisance = ["trigger", "offset", "scale"]')


def square(study, values):
    return float(np.sum(evaluate(study, {**TRUTH, **values}).score.residuals ** 2))


def values_of(row, names):
    return dict(zip(names, row, strict=True))


@pytest.mark.parametrize("gain", [1.15, 1.2, 1.27])
def test_the_marginal_likelihood_is_the_profile_up_to_the_determinant(tmp_path, gain):
    """Linear in a scale and an offset; the integral over them is that of a normal density about the solved ones."""
    path = write_study(tmp_path, ('nuisance = ["trigger"]', 'nuisance = ["trigger", "offset"]'))
    solved = load(path).study
    sampled, _, null = with_sampled_nuisances(solved, {})
    [offset] = null
    size, points = 2e-4, np.array([-1.0, 0.0, 1.0])
    squares = [square(sampled, {"gain": gain, offset: size * x}) for x in points]
    curvature = (squares[0] - 2.0 * squares[1] + squares[2]) / size**2  # the sum of squares is a parabola
    slope = (squares[2] - squares[0]) / (2.0 * size)
    least = squares[1] - 0.5 * slope**2 / curvature
    profile = square(solved, {"gain": gain})
    assert least == pytest.approx(profile, rel=1e-6)
    variance = 1e-6
    wide = np.linspace(-3e-3, 3e-3, 4001)
    integrand = np.exp(-0.5 * (squares[1] + slope * wide + 0.5 * curvature * wide**2 - profile) / variance)
    marginal = float(np.sum(integrand) * (wide[1] - wide[0]))
    assert marginal == pytest.approx(math.sqrt(4.0 * math.pi * variance / curvature), rel=1e-3)
    determinant = 4.0 / np.sum((bench().displacement - bench().displacement.mean()) ** 2)  # per channel and sample
    assert curvature == pytest.approx(float(determinant) * 400.0 / 4.0, rel=0.01)  # whatever the gain


def test_an_instrument_shows_what_the_alignment_makes_of_solved_nuisances(tmp_path):
    study = load(
        write_study(tmp_path, ('nuisance = ["trigger"]', 'nuisance = ["trigger", "scale", "shear", "offset"]'))
    ).study
    values = {"gain": 1.1, "harmonic": 1e-4}
    score = evaluate(study, values).score
    solved = score.nuisances["bench"]
    sampled, _, null = with_sampled_nuisances(study, {})
    stated = {name: solved[name.partition("_")[2].partition("@")[0].replace("_", ".", 1)] for name in null}
    assert len(stated) == 4
    assert evaluate(sampled, {**values, **stated}).score.residuals == pytest.approx(score.residuals, abs=1e-5)


def test_at_null_the_record_is_that_of_the_model(tmp_path):
    study = load(write_study(tmp_path, NUISANCE)).study
    sampled, _, null = with_sampled_nuisances(study, {})
    own, other = evaluate(study, TRUTH).records["bench"], evaluate(sampled, {**TRUTH, **null}).records["bench"]
    assert np.array_equal(own.displacement, other.displacement)


def test_uncertainties_of_a_figure_are_priors_whether_a_nuisance_is_named_or_not():
    sigmas = {"scale.displacement": 0.02, "shear": 1e-5, "offset.other": 1e-6}
    record = bench().assign_attrs(nuisance_sigma=json.dumps(sigmas))
    found = {one.name: one for one in nuisances_of(Reference("fig", record, nuisance=("trigger", "offset")))}
    [body] = record.body.values
    assert list(found) == ["instrument_scale_displacement@fig", "instrument_shear@fig", f"instrument_offset_{body}@fig"]
    assert found["instrument_scale_displacement@fig"].prior == Prior("normal", 1.0, 0.02)
    assert found["instrument_scale_displacement@fig"].window.high == pytest.approx(1.1)
    assert found["instrument_shear@fig"].prior == Prior("normal", 0.0, 1e-5)
    assert found[f"instrument_offset_{body}@fig"].prior is None
    assert nuisances_of(Reference("plain", bench(), nuisance=("trigger",))) == []


def test_a_study_without_nuisances_is_refused(tmp_path):
    with pytest.raises(CalibError, match=r"no nuisance to sample: .*nuisance_sigma"):
        with_sampled_nuisances(load(write_study(tmp_path)).study, {})


def test_other_nuisances_are_another_study(tmp_path):
    path = write_study(tmp_path, NUISANCE)
    study = load(path).study
    sampled, priors, _ = with_sampled_nuisances(study, {"gain": Prior("normal", 1.0, 0.1)})
    assert sampled.header.definition != study.header.definition
    assert sampled.objective.references["bench"].nuisance == ("trigger",)
    assert list(priors) == ["gain"]
    record = bench().assign_attrs(nuisance_sigma=json.dumps({"scale.velocity": 0.03}))
    records.write(record, tmp_path / "bench.nc")
    _, priors, _ = with_sampled_nuisances(load(path).study, {})
    assert priors == {"instrument_scale_velocity@bench": Prior("normal", 1.0, 0.03)}


def test_uncertainties_that_are_not_used_are_told(tmp_path):
    path = write_study(tmp_path, NUISANCE)
    assert unused_uncertainties(load(path).study) == []
    record = bench().assign_attrs(nuisance_sigma=json.dumps({"scale.velocity": 0.03}))
    records.write(record, tmp_path / "bench.nc")
    [remark] = unused_uncertainties(load(path).study)
    assert remark.startswith("bench: the record states how uncertain its scale")
    assert "--sample-nuisances" in remark


def test_an_instrument_has_an_offset_of_each_body():
    assert [p.name for p in instrument(["a", "b"]).parameters][-2:] == ["instrument_offset_a", "instrument_offset_b"]
