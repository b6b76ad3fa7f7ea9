"""The chapter of the profiles: intervals, how they differ from the local ones, the picture."""

import re
from dataclasses import replace

import numpy as np
import pytest

from calib.confidence.bands import predicted_bands
from calib.confidence.document import (
    ComparedModelResult,
    ComparisonResult,
    ConfidenceResult,
    EndResult,
    MarginalResult,
    ModeResult,
    PairResult,
    PointResult,
    PosteriorResult,
    PredictedChannelResult,
    PredictedRecordResult,
    ProfileResult,
)
from calib.confidence.predictive import PredictedChannel
from calib.records import make
from calib.records.response import complex_amplitude, make_response
from calib.report.pages.confidence import confidence_chapter, sampling_remarks
from calib.report.pages.page import render
from calib.report.plots.predictive import predictive_figure
from calib.report.plots.profiles import profiles_figure
from calib.report.plots.style import png
from calib.study import CalibrationResult

VALUES = {"gap": 1e-3, "damping": 0.01}
CALIBRATED = CalibrationResult(values=VALUES)


def point(name, value, ratio, kind="period-1", reason=""):
    return PointResult(value, ratio, kind, reason, {**VALUES, name: value})


GAP = ProfileResult(
    "gap", "m", "linear", 1e-3, EndResult(0.9e-3, "crossed", "0.9 mm"),
    EndResult(1.2e-3, "no comparable motion", "1.2 mm: the simulation ends with status 'diverged' above"),
    (0.9e-3, 1.1e-3), 4.0, 1e-4, "above, it is 1.2 mm: the simulation ends with status 'diverged' above",
    (point("gap", 0.88e-3, 5.2), point("gap", 1.2e-3, 3.0, "period-2"), point("gap", 1.21e-3, None, None, "diverged")),
)  # fmt: skip
DAMPING = ProfileResult(
    "damping", "1", "log", 0.01, EndResult(1e-3, "window end", "open"), EndResult(0.02, "crossed", "0.02"), None, 4.0,
    None, "there is no local interval to compare with", (point("damping", 1e-3, 1.0), point("damping", 0.02, 4.0)),
)  # fmt: skip
PAIR = PairResult(
    ("gap", "damping"), ("m", "1"), ("linear", "log"), (0.9e-3, 1e-3, 1.1e-3), (5e-3, 0.01, 0.02),
    ((4.0, 2.0, None), (2.0, 0.0, 2.0), (8.0, 2.0, 4.0)), 6.2,
)  # fmt: skip
PROFILED = ConfidenceResult(
    "hidden", 0.954, "the likelihood is adjusted", VALUES, VALUES, "period-1", (GAP, DAMPING), (PAIR,),
    ("a profile met a better point than the calibrated one",), 321, 4.0,
)  # fmt: skip


def words(text):
    text = re.sub(r"<svg.*?</svg>|<style.*?</style>", " ", text, flags=re.S)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", text)).replace("\u00a0", " ")


def test_modes_and_a_limit_of_the_sampling_are_said():
    marginals = (MarginalResult("gap", "m", "linear", 1e-3, 1e-4, 0.0, 1.0, "flat"),)
    modes = ModeResult(0.7, {"gap": 1.1e-3}, {"gap": 2e-5}), ModeResult(0.3, {"gap": 0.9e-3}, {"gap": 1e-5})
    limit, several = sampling_remarks(PosteriorResult(marginals, -3.0, 0.5, 4.0, 900, modes=modes, status="limit"))
    assert limit.startswith(
        "the sampling ended at its limit, after 900 evaluations, with an effective sample size of 4:"
    )
    assert "has 2 separate modes" in several
    assert "70 % with gap 1.1 mm ± 0.02 mm; 30 % with gap 0.9 mm ± 0.01 mm" in several
    assert sampling_remarks(PosteriorResult(marginals, -3.0, 0.03, 1000.0, 900)) == []


def test_the_intervals_stand_in_the_page(periodic, undrawn):
    page = words(render(periodic.study, [], {}, CALIBRATED, confidence=PROFILED))
    assert "How sure the values are" in page
    assert "gap 1 mm 0.9 mm .. 1.2 mm 0.9 mm .. 1.1 mm above, it is 1.2 mm" in page
    assert "damping 0.01 open .. 0.02 there is no local interval" in page
    assert "95.4% intervals. The likelihood is adjusted." in page
    assert "Mind: A profile met a better point than the calibrated one." in page
    assert "321 evaluations of the calibrated records" in page
    assert "Posterior" not in page


def test_a_page_without_profiles_has_no_chapter(periodic, undrawn):
    assert "How sure the values are" not in words(render(periodic.study, [], {}, CALIBRATED))


def test_a_posterior_distribution_has_a_column(periodic, undrawn):
    own = [
        MarginalResult("gap", "m", "linear", 1e-3, 5e-5, 0.91e-3, 1.1e-3, "flat in the window"),
        MarginalResult("damping", "1", "log", 0.01, 0.003, 0.004, 0.018, "flat in the window"),
    ]
    sampled = replace(PROFILED, posterior=PosteriorResult(tuple(own), -9.0, 0.03, 1100.0, 4000))
    page = words(render(periodic.study, [], {}, CALIBRATED, confidence=sampled))
    assert "0.91 mm .. 1.1 mm" in page
    assert "0.004 .. 0.018" in page
    assert "gap 1 mm 0.05 mm 0.91 mm .. 1.1 mm flat in the window" in page
    assert "Effective sample size 1100, from 4000 evaluations." in page
    assert "What the posterior distribution predicts" not in page


def test_predictions_have_their_share_inside_the_band_and_a_picture(periodic, undrawn):
    own = [MarginalResult(name, "1", "linear", 1.0, 0.1, 0.8, 1.2, "flat in the window") for name in VALUES]
    channel = PredictedChannelResult("q3", "velocity", 0.613, 2000, 3e-3, "m/s", "stated in the record")
    records = (
        PredictedRecordResult("clapping", False, 100, 2, 0, (channel,)),
        PredictedRecordResult("louder", True, 0, 0, 0, (), "its motion is irregular"),
        PredictedRecordResult("long", False, 100, 0, 0, (channel,), "", 26_000, 2),
    )
    sampled = replace(PROFILED, posterior=PosteriorResult(tuple(own), -9.0, 0.03, 1100.0, 4000, records))
    time = np.linspace(0.0, 0.04, 50)
    measured = make(time, ["q3"], {c: np.sin(150.0 * time)[None] for c in ("displacement", "velocity")})
    curves = PredictedChannel(np.tile(np.sin(150.0 * time), (30, 1)), 0.1)
    bands = predicted_bands(measured, dict.fromkeys([("q3", "displacement"), ("q3", "velocity")], curves),
                            np.ones(50), 0.04)  # fmt: skip
    chapter = confidence_chapter(sampled, CALIBRATED, {"clapping": bands})
    [picture] = chapter.predictions
    assert [axes.get_title(loc="left") for axes in picture.figure.axes] == [
        "q3", "displacement - median [mm]", "velocity - median [m/s]"
    ]  # fmt: skip
    page = words(render(periodic.study, [], {}, CALIBRATED, confidence=sampled, predictions={"clapping": bands}))
    assert "clapping q3 velocity 61.3% 0.003 m/s stated in the record" in page
    assert "long: its last 26000 samples are not predicted" in page
    assert "long: bodies that are not predicted: 2" in page
    assert "Mind: clapping: 2 of 100 draws fail and are left out." in page
    assert "Mind: louder is not predicted: its motion is irregular." in page


def test_a_predicted_response_has_a_panel_for_each_body(periodic, undrawn):
    frequency, bodies = np.linspace(3.0, 4.0, 20), ["mass", "tip"]
    amplitude = np.vstack([1e-3 + 0.0 * frequency, 2e-3 * frequency])
    both = np.concatenate([frequency, frequency[::-1]])
    measured = make_response(
        both, bodies, np.hstack([amplitude, amplitude[:, ::-1]]), np.repeat([0.2, 0.4], 20), "N",
        np.repeat([0, 1], 20), np.repeat([1.0, -1.0], 20),
    )  # fmt: skip
    size = np.abs(complex_amplitude(measured))
    measured = measured.assign(amplitude=(("body", "point"), size, {"units": "m"}))
    curves = size + 1e-5 * np.linspace(-1.0, 1.0, 30)[:, None, None]
    curves[:, :, 19] = np.nan
    channels = {(body, "amplitude"): PredictedChannel(curves[:, k], 1e-5) for k, body in enumerate(bodies)}
    bands = predicted_bands(measured, channels, np.ones(40), None)
    told = PredictedChannelResult("mass", "amplitude", 0.9, 39, 1e-5, "m", "stated in the record")
    record = PredictedRecordResult("sweep", True, 100, 0, 0, (told,), unreached=0.025, points_without_band=1)
    marginal = MarginalResult("gap", "m", "linear", 1e-3, 5e-5, 0.91e-3, 1.1e-3, "flat in the window")
    own = [marginal, replace(marginal, name="damping")]
    sampled = replace(PROFILED, posterior=PosteriorResult(tuple(own), -9.0, 0.03, 1100.0, 4000, (record,)))
    [picture] = confidence_chapter(sampled, CALIBRATED, {"sweep": bands}).predictions
    assert [axes.get_title(loc="left") for axes in picture.figure.axes] == [
        "mass: amplitude [mm]", "amplitude - median [mm]", "tip: amplitude [mm]", "amplitude - median [mm]"
    ]  # fmt: skip
    assert [text.get_text() for text in picture.figure.legends[0].texts] == [
        "0.2 N, up", "0.4 N, down", "curve, 95 %", "with noise, 95 %"
    ]  # fmt: skip
    assert png(predictive_figure({"sweep": bands})).startswith(b"\x89PNG")
    page = words(render(periodic.study, [], {}, CALIBRATED, confidence=sampled, predictions={"sweep": bands}))
    assert "sweep held out mass amplitude 90.0% 0.01 mm stated in the record" in page
    assert "Mind: sweep: 2.50% of its points, over all draws, are reached by no stable motion" in page
    assert "Mind: sweep: 1 point that too few draws reach have no band and do not count." in page
    assert "sweep: amplitudes over frequency" in page


def test_models_are_compared_by_their_evidence(periodic, undrawn):
    models = (
        ComparedModelResult("hidden", (), (), -40.0, -52.1, 0.03, 0.0, 0.0, 5000, ""),
        ComparedModelResult("hidden extended", ("quadratic_drag",), ("c2",), 0.0, -14.0, 0.03, 38.1, 0.04, 6000,
                            "the evidence for this model is very strong"),
    )  # fmt: skip
    compared = replace(PROFILED, comparison=ComparisonResult(models, "hidden extended", "diagnosis: named"))
    assert ConfidenceResult.from_dict(compared.as_dict()) == compared
    page = words(render(periodic.study, [], {}, CALIBRATED, confidence=compared))
    assert "hidden - -40.00 -52.10 ± 0.03 - hidden extended quadratic_drag 0.00 -14.00 ± 0.03 +38.10 ± 0.04" in page
    assert "hidden extended: the evidence for this model is very strong" in page
    assert "diagnosis: named" in page


def test_what_cannot_be_shown_is_said(periodic, undrawn):
    page = words(render(periodic.study, [], {}, CALIBRATED, left_out=("confidence.json holds no profiles",)))
    assert "Left out: confidence.json holds no profiles." in page


def test_profiles_of_other_values_are_out_of_date():
    assert not confidence_chapter(PROFILED, CALIBRATED, {}).stale
    assert confidence_chapter(PROFILED, CalibrationResult(values={**VALUES, "gap": 1.1e-3}), {}).stale


@pytest.mark.parametrize("pairs", [(PAIR,), ()])
def test_profiles_are_drawn(pairs):
    figure = profiles_figure(replace(PROFILED, pairs=pairs))
    assert png(figure).startswith(b"\x89PNG")
    labels = [axes.get_xlabel() for axes in figure.axes if axes.get_xlabel()]
    assert labels == ["gap [mm]", "damping [1]", "gap [mm]"][: 2 + len(pairs)]
    assert figure.axes[0].get_ylabel() == "Likelihood-ratio statistic"
