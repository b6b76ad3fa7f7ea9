"""Claims about the chapter of a diagnosis: each verdict is told with what speaks for it and what to do next."""

import functools
import io
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from printed import cells
from report.diagnoses import GAIN, GATES, document, motion, motions
from rich.console import Console

from calib.cli.diagnose import show
from calib.diagnosis import artifacts, serialise
from calib.diagnosis.bench import SimulatedRows
from calib.diagnosis.diagnose import Diagnosis
from calib.diagnosis.document import DiagnosisResult
from calib.diagnosis.evidence import Evidence
from calib.diagnosis.noise import Noise
from calib.diagnosis.part import Part
from calib.diagnosis.suspect import Scored
from calib.errors import CalibError
from calib.records.excitation import Excitation
from calib.report.pages.diagnosis.chapter import chapter
from calib.report.pages.diagnosis.conclusion import headline, left_out, points, stale
from calib.report.pages.diagnosis.misfit import clocks
from calib.report.pages.diagnosis.next_measurement import separation_text
from calib.report.pages.diagnosis.sizes import disagreements
from calib.report.pages.diagnosis.suspects import outcome
from calib.report.pages.page import render
from calib.report.plots.diagnosed_cycles import compared_cycle, compared_rows
from calib.report.plots.diagnosed_residuals import residual_figure
from calib.report.plots.missing_force import is_significant, missing_accelerations
from calib.report.plots.separation import separation_lines, separation_map
from calib.report.plots.style import EXTENDED
from calib.study import CalibrationResult

VERDICTS = ("named", "one_of", "none", "unexplained", "not_diagnosable")
VALUES = {"restitution": 0.1, "gap": 1e-3}
CALIBRATED = CalibrationResult(values=VALUES)


def outcomes(said):
    """Conclusion of each suspect by its name."""
    return {suspect.effect: str(outcome(suspect, result(said))) for suspect in result(said).suspects}


def result(said):
    """Diagnosis that a document describes."""
    return DiagnosisResult.from_dict(said)


@pytest.fixture(scope="module")
def study(periodic):
    """A study without records, whose page is made quickly."""
    objective = SimpleNamespace(references={}, terms=[])
    return SimpleNamespace(**{**vars(periodic.study), "objective": objective})


@pytest.fixture(scope="module")
def page(study):
    said = document("one_of", VALUES)
    shown = {"clapping": motions("one_of")["clapping"]}
    return render(study, [], {}, CALIBRATED, diagnosis=result(said), motions=shown)


@pytest.fixture(scope="module")
def told(study):
    """Return the chapter of a verdict."""
    return functools.cache(lambda verdict: chapter(result(document(verdict, VALUES)), {}, CALIBRATED, study))


def words(text):
    text = re.sub(r"<svg.*?</svg>|<style.*?</style>", " ", text, flags=re.S)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", text)).replace("\u00a0", " ")


@pytest.mark.parametrize("verdict", VERDICTS)
def test_every_verdict_is_a_sentence_in_a_box_of_its_colour(verdict, told):
    found = told(verdict)
    tones = {"named": "good", "none": "good", "not_diagnosable": "bad"}
    assert found.tone == tones.get(verdict, "mind")
    assert found.headline.endswith(".")
    assert found.points


def test_a_cause_is_named_with_its_equation_its_size_and_its_unit():
    assert (
        headline(result(document("named", VALUES)))
        == "Missing in the model: quadratic_drag (-c2 f(x, v)), c2 = 2.40 ± 0.16 1/m."
    )


def test_the_sizes_of_several_causes_are_those_fitted_together():
    said = document("named", VALUES)
    unit = said["suspects"][0]["units"]
    said["joint_sizes"] = {"quadratic_drag": {"size": {"c2": 7.5}, "interval": {"c2": [7.0, 8.0]}, "units": unit}}
    assert headline(result(said)) == "Missing in the model: quadratic_drag (-c2 f(x, v)), c2 = 7.50 ± 0.50 1/m."


def test_a_form_that_was_fitted_is_told_with_its_interval_and_once(study):
    said = document("named", VALUES)
    [drag] = [one for one in said["suspects"] if one["effect"] == "quadratic_drag"]
    drag["held"] = {"exponent": 1.9, "slip": 0.01}  # the one fitted, the other as it was tried
    said["joint_sizes"] = {
        "quadratic_drag": {
            "size": {"c2": 2.4, "exponent": 1.9}, "interval": {"c2": [2.2, 2.6], "exponent": [1.7, 2.1]},
            "units": {"c2": "1/m", "exponent": "1"},
        }
    }  # fmt: skip
    assert headline(result(said)).endswith("c2 = 2.40 ± 0.20 1/m, exponent = 1.90 ± 0.20.")
    [row] = [s for s in chapter(result(said), {}, CALIBRATED, study).suspects.shown if s.effect == "quadratic_drag"]
    assert row.sizes == ("c2 = 2.40 ± 0.20 1/m", "exponent = 1.90 ± 0.20")
    assert row.held == ("slip = 0.01",)


def test_the_terminal_says_of_which_shares_there_was_no_fit(tmp_path):
    said = document("named", VALUES)
    for one in said["suspects"]:
        one["refitted"] = one["effect"] == "quadratic_drag"
    show(result(said), tmp_path, None, Console(file=(shown := io.StringIO()), width=200))
    shares = {one[0]: one[2] for one in cells(shown.getvalue()) if len(one) > 2}
    assert not shares["quadratic_drag"].endswith("*")
    assert shares["linear_drag"] == "50 %*"
    assert shares["coulomb_friction"] == "wrong sign"
    assert "*: estimate without a new fit" in shown.getvalue()


@pytest.mark.parametrize(("joint", "moved"), [(2.45, False), (7.5, True)])
def test_a_size_that_another_cause_moves_out_of_its_interval_is_told_with_both_values(joint, moved):
    said = document("named", VALUES)
    interval = {"c2": [joint - 0.5, joint + 0.5]}
    own = {**said["suspects"][0], "size": {"c2": joint}, "interval": interval}
    said["joint_sizes"] = {"quadratic_drag": own, "preload": {**own, "size": {}}}
    told = [point for point in points(result(said)) if "change each other's sizes" in point]
    assert bool(told) == moved
    assert all("c2 = 2.40 ± 0.16 1/m alone and 7.50 ± 0.50 1/m beside the others" in point for point in told)


def test_the_table_of_suspects_has_sizes_alone_and_says_apart_what_they_are_with_other_causes(study, tmp_path):
    """Z and share are of the effect alone: beside them a size fitted together would contradict them."""
    said = document("named", VALUES)
    own = {"size": {"c2": 0.01}, "interval": {"c2": [-0.49, 0.51]}, "units": {"c2": "1/m"}}
    other = {"size": {"lag": 2e-3}, "interval": {"lag": [1e-3, 3e-3]}, "units": {"lag": "s"}}
    for joint, alone, together in (
        ({"quadratic_drag": own}, "c2 = 0.01 ± 0.50 1/m", ()),
        ({"quadratic_drag": own, "channel_lag": other}, "c2 = 2.40 ± 0.16 1/m", ("c2 = 0.01 ± 0.50 1/m",)),
    ):
        found = result(said | {"joint_sizes": joint})
        [row] = [one for one in chapter(found, {}, CALIBRATED, study).suspects.shown if one.effect == "quadratic_drag"]
        assert (row.sizes, row.together) == ((alone,), together)
        show(found, tmp_path, None, Console(file=(shown := io.StringIO()), width=200))
        [printed] = [one for one in cells(shown.getvalue()) if one[0] == "quadratic_drag"]
        assert printed[3] == alone
        text = "sizes of causes fitted together: quadratic_drag, c2 = 0.01 ± 0.50 1/m; channel_lag, lag = 2.0 ± 1.0 ms"
        assert (text in shown.getvalue().splitlines()) == bool(together)
        assert "suspects, each alone in the model (threshold |z| = " in shown.getvalue()
        page = words(render(study, [], {}, CALIBRATED, diagnosis=found, motions={}))
        assert ("with the other causes: c2 = 0.01 ± 0.50 1/m" in page) == bool(together)


def test_causes_that_were_exchanged_after_the_rounds_are_in_their_table(study):
    exchange = {"before": ["gain"], "after": ["lag", "scale"], "reason": "of all pairs this one explains most"}
    said = document("named", VALUES) | {"exchanges": [exchange]}
    last = chapter(result(said), {}, CALIBRATED, study).rounds[-1]
    assert last.model == "calibrated + gain"
    assert last.chosen == "lag + scale instead: of all pairs this one explains most"


def test_what_could_not_be_looked_at_does_not_hold(study, undrawn):
    said = document("named", VALUES)
    gate = {"name": "time_step", "passed": True, "said": "it has none", "z": None, "tried": False}
    said["gates"] = [*said["gates"], gate]
    page = words(render(study, [], {}, CALIBRATED, diagnosis=result(said), motions={}))
    assert "time_step not tested it has none" in page
    assert page.count(" holds ") == len(GATES) == len(said["gates"]) - 1


def test_outliers_are_a_cause_of_the_records_and_not_of_the_model():
    said = document("named", VALUES) | {"causes": ["outliers"], "outliers": 0.012}
    assert headline(result(said)) == "In the records: outliers, 1.2\u00a0% of the samples."
    assert any("they were removed before every fit" in point for point in points(result(said)))


def test_an_outlier_does_not_take_part_in_the_mean_cycle():
    record = motion(np.random.default_rng(8))
    record.measured[2, 250] += 1.0
    assert abs(compared_cycle(record, 2).measured - compared_cycle(record, 2).calibrated).max() > 0.1
    record.weight[2, 250] = 0.0
    own = compared_cycle(record, 2)
    assert abs(own.measured - own.calibrated).max() < 1e-4
    assert own.weight[50] == pytest.approx(5 / 6)


def test_a_class_is_told_with_its_likeness_and_the_measurement_that_would_decide(page):
    text = words(page)
    assert "these records do not distinguish the candidates: one of quadratic_drag, linear_drag; they explain" in text
    assert "Cosine of the angle between the signature of quadratic_drag" in text
    assert "and the signatures of others: linear_drag 97 %." in text
    assert "a steady tone of 0.375 mm at 20 Hz, without impacts, would distinguish them (z = 8.4)" in text


def test_the_page_draws_the_separation_over_amplitude_and_frequency(page):
    [picture] = re.findall(r"<svg[^>]*>(?:(?!</svg>).)*Frequency of the tone.*?</svg>", page, flags=re.S)
    drawn = ["Amplitude [mm]", "Predicted separation z", "records", "clapping", "best steady tone (z = 8.4)"]
    drawn += ["irregular motion", "simulation failed", "limit of contact", "z = 3"]
    assert [text for text in drawn if text not in picture] == []
    text = words(page)
    assert "amplitude 0.15 mm to 2.25 mm (derived: 0.1 to 1.5 times that of the records)" in text
    assert "frequency 12.5 Hz to 50 Hz (stated in the study file)" in text
    assert "29 settings with 412 simulations (at most 1000)" in text
    assert "Not available: sweep: the simulator has no initial state" in text


def test_the_map_has_a_cell_for_each_tone_of_the_grid_and_a_star_at_the_best():
    said = document("one_of", VALUES)
    axes = separation_map(result(said).design, result(said).measurements).axes[0]
    cells = axes.collections[0].get_array()
    assert cells.shape == (4, 6)
    assert cells.mask.sum() == 2  # the irregular and the failed tone
    assert [0.375] in [line.get_ydata() for line in axes.lines if line.get_marker() == "*"]


def test_of_one_setting_a_line_is_drawn_and_no_map():
    said = document("one_of", VALUES)
    decays = [point for point in said["design"]["points"] if point["test"] == "free decay"]
    own = result(said | {"design": said["design"] | {"points": decays}})
    assert separation_map(own.design, own.measurements) is None
    assert separation_lines(own.design, own.measurements).axes[0].get_title(loc="left") == "free decay"


def test_a_separation_below_the_scale_is_marked_and_not_drawn_as_data():
    said = document("one_of", VALUES)
    low = [p | {"z": 0.008} for p in said["design"]["points"] if p["test"] == "free decay"]
    own = result(said | {"design": said["design"] | {"points": low}})
    [axes, *_] = separation_lines(own.design, []).axes
    line, below = [shown for shown in axes.lines if shown.get_marker() in ("o", "v")]
    assert np.isnan(line.get_ydata()).all()
    assert below.get_xdata().size == len(low)
    assert separation_text(0.03877) == "0.039"


def test_the_terminal_says_which_suspects_the_simulator_refused_and_why(tmp_path):
    said = document("one_of", VALUES)
    for suspect in said["suspects"][:2]:
        suspect["reason"] = "refused: simulator 'own' takes no force laws with internal states"
    show(result(said), tmp_path, None, Console(file=(shown := io.StringIO()), width=200))
    names = ", ".join(suspect["effect"] for suspect in said["suspects"][:2])
    assert f"not tested: {names}; simulator 'own' takes no force laws with internal states" in shown.getvalue()
    assert shown.getvalue().count("not tested: ") == 1


def test_the_terminal_says_what_to_do_where_a_condition_fails(tmp_path):
    said = document("one_of", VALUES)
    said["gates"] = [{"name": "noise", "passed": False, "said": "low: a noise level needs at least 32 points"}]
    show(result(said), tmp_path, None, Console(file=(shown := io.StringIO()), width=200))
    told = shown.getvalue().splitlines()
    place = told.index("gate noise: low: a noise level needs at least 32 points")
    assert told[place + 1].startswith("what to do: record more samples")
    assert "put the sweeps of all levels into one record" in told[place + 1]


def test_a_terminal_shows_the_best_measurement_and_the_best_z_of_each_kind(tmp_path):
    console = Console(file=io.StringIO(), width=200)
    show(result(document("one_of", VALUES)), tmp_path, None, console)
    text = console.file.getvalue()
    first, second = (text.index(line) for line in (
        "\nTo measure next: a steady tone of 0.375 mm at 20 Hz, without impacts, would distinguish them (z = 8.4)\n",
        "\nbest z of each kind of test: steady tone 8.4, free decay 2.1 (412 simulations)\n",
    ))  # fmt: skip
    assert first < second
    rows = [row[0] for row in cells(text)]
    assert rows == [suspect["effect"] for suspect in document("one_of", VALUES)["suspects"]]


def test_where_no_measurement_would_decide_it_says_so():
    said = document("one_of", {})
    tried = [found | {"z_max": most} for found, most in zip(said["measurements"], (2.0, 2.2), strict=True)]
    sentence = "To measure next: no measurement within the bounds would distinguish them (z = 2.2 at most)."
    assert sentence in points(result(said | {"measurements": tried}))
    tried[1]["z_max"] = 282.0  # of a measurement that ranks behind, for simulations do not confirm it
    text = " ".join(points(result(said | {"measurements": tried})))
    assert "(z = 2 at most); derivatives alone predict up to z = 2.8e+02, which simulations do not confirm." in text
    assert points(result(said | {"measurements": []}))[-1].startswith("To measure next: unknown, ")


def test_where_nothing_is_found_all_suspects_stand_with_the_sizes_that_would_have_been_seen(told):
    found = told("none")
    assert "smallest detectable size" in " ".join(found.points)
    assert not found.suspects.rest
    assert found.suspects.shown[0].detectable == ("0.28 1/m",)
    assert {s.share for s in found.suspects.shown} == {"-"}


def test_what_the_level_of_the_noise_is_known_from_is_said(study):
    found = chapter(result(document("named", VALUES)), motions("named"), CALIBRATED, study)
    [noise] = [gate for gate in found.gates if gate.name == "noise"]
    level, model = noise.summary.split("; ")
    assert level.endswith(" of the standard deviation of the channel, in 8 channels (cycle to cycle)")
    assert model == "taken as uncorrelated"


def test_the_order_of_correlated_noise_is_said(study):
    known = motions("named")
    known["clapping"] = known["clapping"].assign(memory=(("row", "lag"), np.array([[0.5, 0.0, 0.1]] * 4)))
    found = chapter(result(document("named", VALUES)), known, CALIBRATED, study)
    [noise] = [gate for gate in found.gates if gate.name == "noise"]
    assert noise.summary.endswith("; taken as autoregressive of order 0 to 3, 0 being uncorrelated")


def test_how_the_rate_of_each_clock_enters_is_said():
    tone = Excitation("end", "displacement", frequency=26.0, amplitude=1e-3)
    references = {"tone": SimpleNamespace(excitation=tone, is_swept=False)}
    references["decay"] = SimpleNamespace(excitation=Excitation("mass", "free decay"), is_swept=False)
    assert clocks(references) == (
        "Rate of the recorder's clock: it is a nuisance, solved for against the steady tone (tone); it is taken as "
        "uncertain by up to 50 ppm (rectangular distribution), which the standard errors include unless what the model "
        "leaves masks it (decay)."
    )
    assert clocks({}) == ""


@pytest.mark.parametrize(
    ("share", "cosine", "above_noise", "similar"),
    [(0.98, 0.99, True, True), (0.98, 0.99, False, False), (0.6, 0.99, True, False), (0.98, 0.6, True, False)],
)
def test_a_named_effect_that_others_resemble_is_told_with_them(share, cosine, above_noise, similar, study):
    """Of a ball that falls, linear and quadratic drag explain nearly the same: drag is certain, its form is not."""
    said = document("named", VALUES)
    said["remains"] = {"above_noise": above_noise, "rows": []}
    said["suspects"][1] |= {"share": share, "alike": cosine}
    told = [text for text in chapter(result(said), {}, CALIBRATED, study).points if "the form of the law" in text]
    assert bool(told) == similar
    if told:
        assert "each on its own: linear_drag 98 %." in told[0]
        assert "What would decide: a record over another range of displacement and velocity" in told[0]


def test_effects_that_resemble_the_closest_one_are_told_with_it(study):
    said = document("unexplained", VALUES)
    said |= {"closest": ["quadratic_drag"], "rounds": document("named", VALUES)["rounds"]}
    said["suspects"][1] |= {"share": 1.0, "alike": 0.99}
    told = chapter(result(said), {}, CALIBRATED, study).points
    assert any("As quadratic_drag alone is not the cause, the form of the law" in text for text in told)


def test_where_only_sizes_of_the_wrong_sign_would_explain_the_misfit_they_are_told(study):
    said = document("unexplained", VALUES) | {"closest": [], "stand_ins": []}
    said["suspects"] = [one | {"z": -abs(one["z"])} for one in said["suspects"] if one["effect"] == "linear_drag"]
    [told] = [text for text in chapter(result(said), {}, CALIBRATED, study).points if "of a sign" in text]
    assert "linear_drag would need c1 < 0" in told
    assert "the noise is larger than it is taken here" in told


def test_a_failed_gate_says_what_to_do(told):
    found = told("not_diagnosable")
    assert "kind of motion" in found.headline
    assert "period 2 instead of period 1. What to do: calibrate until" in found.points[0]
    assert found.suspects.shown == ()


def test_where_a_gate_fails_the_headline_says_what_would_explain_most_and_what_is_like_it():
    failed = {"verdict": "not_diagnosable", "closest": ["quadratic_drag"], "gates": [GATES[3] | {"passed": False}]}
    said = document("named", VALUES) | failed
    said["rounds"] = [said["rounds"][0] | {"chosen": "quadratic_drag", "rivals": ["quadratic_drag", "linear_drag"]}]
    assert headline(result(said)).endswith("; quadratic_drag or linear_drag would explain most.")


def test_by_how_much_a_size_may_be_off_on_which_the_records_disagree():
    said = document("named", VALUES)
    joint = {"size": {"c2": 0.3}, "units": {"c2": "1/m"}}
    said["joint_sizes"] = {"quadratic_drag": joint}
    said["gain"] = said["gain"] | {
        "agreements": [{"parameter": "c2", "chi2": 90.0, "degrees": 1, "z": 9.0, "agree": False}]
    }
    [text] = disagreements(result(said))
    assert text.endswith("does not allow for that.")
    joint["bias"] = {"c2": 1.0}
    [text] = disagreements(result(said))
    assert "does not allow for that; in 95\u00a0% of cases it biases c2 by no more than 2" in text


def test_a_solver_that_is_too_coarse_is_a_failed_gate_too():
    said = document("named", VALUES) | {"verdict": "not_diagnosable", "gates": [GATES[3] | {"passed": False}]}
    assert headline(result(said)) == "No diagnosis: a condition fails (time_step)."
    assert points(result(said))[0] == (
        "Time_step: made 2 times finer, it changes the records by z = 0.1. What to do: make the simulator's step or "
        "tolerance finer in [model] and calibrate again: as it is, an error of the solver would be mistaken for a "
        "physical effect."
    )


def test_what_became_of_each_suspect():
    said = document("named", VALUES)
    assert outcomes(said) == {
        "quadratic_drag": "named",
        "linear_drag": "explains less",
        "coulomb_friction": "wrong sign",
        "channel_lag": "explains less",
        "cubic_stiffness": "below",
        "clipping": "below",
    }
    said = document("unexplained", VALUES)
    assert outcomes(said)["quadratic_drag"] == "explains most"
    rivals = [found | {"rivals": [suspect["effect"] for suspect in said["suspects"][:2]]} for found in said["rounds"]]
    assert [*outcomes(said | {"rounds": rivals}).values()].count("explains most") == 2


def test_the_strongest_rival_is_told_also_where_it_was_left_out_later(study):
    said = document("named", VALUES)
    [rival] = [suspect for suspect in said["suspects"] if suspect["effect"] == "linear_drag"]
    rival |= {"share": 0.69, "alike": 0.52}
    said["left_out"] = [{"effect": "linear_drag", "share": 0.36, "beside": ["quadratic_drag"], "reason": ""}]
    found = chapter(result(said), {}, CALIBRATED, study)
    [told] = [text for text in found.why if text.startswith("Of the effects that are not named")]
    assert "linear_drag explains most on its own: 69 % of the excess" in told
    assert told.endswith("Beside quadratic_drag it is left out.")
    [row] = [one for one in found.suspects.shown if one.effect == "linear_drag"]
    assert row.reason == "explains 36\u00a0%, too little, of what remains beside the named effects"
    assert found.rounds[-1].model == "calibrated + quadratic_drag + linear_drag"


def test_a_likeness_to_a_choice_that_was_exchanged_is_said_to_be_that(study):
    said = document("named", VALUES)
    exchange = {"before": ["quadratic_drag"], "after": ["lag", "scale"], "reason": "it explains more"}
    said |= {"verdict": "one_of", "causes": [], "class": [["lag", "scale"], ["lag", "gain"]], "exchanges": [exchange]}
    found = chapter(result(said), {}, CALIBRATED, study)
    [row] = [row for row in found.suspects.shown if row.effect == "linear_drag"]
    assert row.reason == "explains less; cosine 90\u00a0% with quadratic_drag, the choice of round 1"
    last = found.rounds[-1]
    assert (last.share, last.predicts, last.rivals) == ("all", "not tested", "gain")
    assert found.explained == "lag and scale, refitted at the end, explain all"


def test_where_all_above_the_threshold_make_no_sense_none_is_not_said_to_be_above_it(study):
    said = document("unexplained", VALUES) | {"closest": [], "suspects": document("named", VALUES)["suspects"][2:3]}
    said["rounds"] = [{"threshold": 3.43, "chosen": None, "share": None, "rivals": [], "alike": {}}]
    found = chapter(result(said), {}, CALIBRATED, study)
    assert abs(said["suspects"][0]["z"]) > said["threshold"]
    assert found.rounds[0].chosen == "none is above the threshold with a size of the right sign"


def test_what_has_nothing_to_act_on_is_not_said_to_be_absorbed():
    none = Scored(None, None, np.zeros((5, 1)), None, np.array([np.inf]))
    assert serialise._without_effect(none).startswith("it changes nothing in these records")
    assert not serialise._without_effect(replace(none, derivatives=np.ones((5, 1))))


def test_what_calibration_absorbs_without_causes_may_come_in_a_later_round(study):
    said = document("named", VALUES)
    [suspect] = [suspect for suspect in said["suspects"] if suspect["effect"] == "channel_lag"]
    suspect |= {"absorbed": 1.0, "refitted": False}
    rejected = {"rejected": "channel_lag", "rejection": "it explains a negligible share"}
    said["rounds"] = [said["rounds"][0], said["rounds"][1] | rejected]
    rows = chapter(result(said), {}, CALIBRATED, study).suspects
    [row] = [row for row in rows.shown + rows.rest if row.effect == "channel_lag"]
    assert row.reason == "absorbed by calibration as long as no cause is in the model; see round 2"
    assert (row.share, row.absorbed) == ("-", "all")


def test_a_feature_is_shown_as_z_is_taken_of_it(study):
    """With the noise of the record laid over the simulation."""
    said = document("named", VALUES)
    said["misfit"] = said["misfit"] | {"features": [said["misfit"]["features"][0] | {"z": -5.0}]}
    [row] = chapter(result(said), {}, CALIBRATED, study).features.marked
    assert (row.measured, row.predicted, row.z) == ("2.4100 ± 0.0080", "2.3900", "−5.0")


@pytest.mark.parametrize("lack", [0.0, 0.3])
def test_where_the_acceleration_is_too_uncertain_nothing_is_said_to_be_noise(lack, study, undrawn):
    records = {"clapping": motion(np.random.default_rng(3), lack=lack)}
    said = document("unexplained", VALUES)
    text = words(render(study, [], {}, CALIBRATED, diagnosis=result(said), motions=records))
    assert ("per unit mass: not significant, given the uncertainty of accelerations" in text) == (
        not all(
            is_significant(force) for body in ("q2", "q3") for force in missing_accelerations(records, body).values()
        )
    )
    assert ("The figures of the missing acceleration" in text) == (lack > 0.0)


@pytest.mark.parametrize(("takes_laws", "advice"), [(True, "calib new effect"), (False, "takes no force laws")])
def test_a_simulator_without_force_laws_is_not_offered_one(takes_laws, advice):
    said = points(result(document("unexplained", VALUES)), takes_laws=takes_laws)
    assert any(advice in sentence for sentence in said)
    assert takes_laws == any("calib new effect" in sentence for sentence in said)
    assert takes_laws == any("calib discover" in sentence for sentence in said)


@pytest.mark.parametrize(("left", "offered"), [(1000.0, True), (10.0, False)])
def test_where_named_effects_leave_a_misfit_a_search_for_a_force_is_offered(left, offered):
    told = result(document("named", VALUES))
    misfit = replace(told.misfit, remaining_chi2=left, chi2_std=100.0)
    for takes_laws in (True, False):
        said = points(replace(told, misfit=misfit), takes_laws=takes_laws)
        assert any("calib discover" in sentence for sentence in said) == (offered and takes_laws)


@pytest.mark.parametrize("several", [False, True])
def test_of_records_with_one_channel_each_only_the_records_are_compared(several, study):
    said = document("named", VALUES)
    channels = [{"record": name, "body": "q3", "channel": "displacement"} for name in ("clapping", "quiet")]
    channels += [channels[0] | {"channel": "velocity"}] if several else []
    among = {"among": "the channels of the records", "effect": "quadratic_drag", "z": 3.6, "variation": 0.13}
    said["misfit"] = said["misfit"] | {"inconstancy": 3.6, "constancy": [among], "channels": channels}
    said["remains"] = {"above_noise": True, "rows": []}
    told = [text for text in chapter(result(said), {}, CALIBRATED, study).why if "The sizes of" in text]
    start = "The sizes of quadratic_drag differ by 13\u00a0% among the channels of the records ("
    end = "Unmodelled effects may make them differ by up to 33\u00a0%."
    assert [(text[: len(start)], text[-len(end) :]) for text in told] == [(start, end)] * several


@pytest.mark.parametrize(
    ("without", "named"), [((), "the common size"), (("quiet",), "the size that clapping alone has")]
)
def test_the_interval_that_a_disagreement_is_not_counted_in_is_that_of_the_record_fitted(without, named):
    said = document("unexplained", VALUES)
    said["joint_sizes"] = {"quadratic_drag": {"size": {"c2": 2.4}, "units": {"c2": "1/m"}}}
    apart = [{"parameter": "c2", "chi2": 90.0, "degrees": 1, "z": 9.0, "agree": False}]
    transfers = [t for t in GAIN["transfers"] if t["record"] not in without]
    said["gain"] = GAIN | {"transfers": transfers, "agreements": apart}
    [told] = disagreements(result(said))
    assert told.endswith(f"the interval of {named} does not allow for that.")


def test_calibrated_values_move_by_the_errors_that_the_table_gives(study):
    said = document("named", VALUES)
    [told] = [text for text in points(result(said)) if "calibrated values move" in text]
    assert "two standard errors" in told
    assert "restitution from 0.09170 ± 0.00084 to 0.10010 ± 0.00060" in told
    [moved, _] = chapter(result(said), {}, CALIBRATED, study).extension.moved
    assert (moved.before, moved.after) == ("0.09170 ± 0.00084", "0.10010 ± 0.00060")


def test_what_calibration_absorbs_has_no_score(study):
    """However large its z is: almost nothing of it shows in the records."""
    said = document("named", VALUES)
    channel_lag = next(suspect for suspect in said["suspects"] if suspect["effect"] == "channel_lag")
    channel_lag |= {"z": 51.0, "absorbed": 0.9999, "refitted": False}
    assert outcomes(said)["channel_lag"] == "absorbed"
    rows = chapter(result(said), {}, CALIBRATED, study).suspects
    [row] = [row for row in rows.shown + rows.rest if row.effect == "channel_lag"]
    assert (row.z, row.sizes) == ("-", ("-",))
    assert "absorbed by calibration" in row.reason
    channel_lag |= {"z": 0.0, "absorbed": 0.9, "detectable": dict.fromkeys(channel_lag["detectable"])}
    rows = chapter(result(said), {}, CALIBRATED, study).suspects
    [row] = [row for row in rows.shown + rows.rest if row.effect == "channel_lag"]
    assert (row.z, row.sizes) == ("-", ("-",))
    assert "error of its derivative" in row.reason


@pytest.mark.parametrize(("z", "differ"), [(0.7, False), (5.3, True)])
def test_whether_several_causes_have_one_size_everywhere_is_said(z, differ, study):
    said = document("unexplained", VALUES)
    said |= {"closest": ["quadratic_drag", "channel_lag"], "misfit": said["misfit"] | {"inconstancy": z}}
    said |= {"stand_ins": ["channel_lag"] if differ else [], "said": "both explain most, but why not"}
    assert headline(result(said)) == "No known effect can be named as the cause: both explain most, but why not."
    [told] = [text for text in chapter(result(said), {}, CALIBRATED, study).why if "threshold" in text]
    how = "differ" if differ else "do not differ"
    assert told.startswith(f"The sizes of quadratic_drag and channel_lag {how} among the channels of the records")


def test_by_how_much_what_remains_may_bias_a_size_is_told():
    said = document("named", VALUES)
    row = {"channel": "velocity", "body": "q2", "record": "clapping", "beyond_noise": 3.0}
    said["remains"] = {"above_noise": True, "rows": [row]}
    joint = {"size": {"c2": 6.0}, "interval": {"c2": [5.0, 7.0]}, "units": {"c2": "1/m"}}
    said["joint_sizes"] = {"quadratic_drag": joint}
    [told] = [point for point in points(result(said)) if point.startswith("The remaining misfit is more than noise")]
    assert told.endswith("can bias sizes by more.")
    joint["bias"] = {"c2": 0.5}
    [told] = [point for point in points(result(said)) if point.startswith("The remaining misfit is more than noise")]
    assert told.endswith("can bias sizes by more, in 95\u00a0% of cases by no more than this: c2 by 0.98 1/m.")


def test_what_explains_too_little_of_a_remainder_is_told_and_not_named(study):
    said = document("named", VALUES)
    assert not left_out(result(said))
    said["left_out"] = [{"effect": "preload", "share": 0.637, "beside": ["quadratic_drag"]}]
    [sentence] = left_out(result(said))
    start = "Of the excess chi-square that may remain beside quadratic_drag, preload explains 64\u00a0%. It is not "
    assert sentence.startswith(start)
    assert sentence in points(result(said))
    beside = ["quadratic_drag", "preload"]
    said["left_out"].insert(0, {"effect": "coulomb_friction", "share": 0.4, "beside": beside})
    assert "beside quadratic_drag and preload, coulomb_friction explains 40\u00a0%" in left_out(result(said))[0]
    last = chapter(result(said), {}, CALIBRATED, study).rounds[-1]
    assert (
        last.chosen == "without preload: it explains 64 % of the excess that may remain beside the others: too little"
    )
    assert last.share == "-"


def test_a_misfit_that_rises_on_what_was_held_out_is_said_to_rise(capsys):
    said = document("unexplained", VALUES) | {"closest": ["quadratic_drag"]}
    said["gain"] = GAIN | {"before": 0.34, "after": 0.36, "interval": [-0.03, -0.01], "proven": False}
    [told] = [text for text in points(result(said)) if text.startswith("On ")]
    assert told.startswith(
        "On records held out (louder, slower) the misfit changes from 34\u00a0% to 36\u00a0%: "
        "more by 1 to 3 percentage points (95\u00a0% interval). Misfit: "
    )
    show(result(said), "out", None, Console(file=(shown := io.StringIO()), width=200))
    assert (
        "gain on records held out (louder, slower): misfit 0.34 -> 0.36, more by 0.01 to 0.03 - "
        "what was held out refutes it"
    ) in shown.getvalue().splitlines()


@pytest.mark.parametrize("inconstancy", [0.13, 5.3])
@pytest.mark.parametrize("agree", [True, False])
def test_a_page_never_says_that_sizes_differ_and_that_they_do_not(inconstancy, agree, study):
    said = document("unexplained", VALUES)
    said |= {"closest": ["quadratic_drag", "channel_lag"], "misfit": said["misfit"] | {"inconstancy": inconstancy}}
    said |= {"stand_ins": ["channel_lag"] if inconstancy > 3.43 else []}
    alone = {"parameter": "c2", "chi2": 1.6, "degrees": 2, "z": 0.7 if agree else 11.5, "agree": agree}
    said["gain"] = GAIN | {"agreements": [alone]}
    told = chapter(result(said), {}, CALIBRATED, study)
    text = " ".join([*told.why, *told.extension.agreement])
    assert ("do not agree" in text) == (not agree)
    assert not ("do not agree" in text and "do not differ" in text)
    assert ("The records, each alone, agree on c2 (chi" in text) == agree
    biased = [transfer | {"bias": 0.3} for transfer in GAIN["transfers"]]
    said["gain"] |= {"transfers": biased}
    [sentence] = chapter(result(said), {}, CALIBRATED, study).extension.agreement
    assert "± 0.60 in louder (95\u00a0% intervals by Student's t, with the bias that what the model leaves" in sentence
    assert "± 0.12 in louder (95\u00a0% intervals by Student's t)" in text
    assert ("the channels within them differ" in text) == (agree and inconstancy > 3.43)


def test_where_a_gate_fails_after_several_causes_were_found_nothing_is_said_of_their_sizes(study):
    said = document("named", VALUES) | {"verdict": "not_diagnosable", "causes": [], "class": []}
    said |= {"gates": [GATES[3] | {"passed": False}], "misfit": said["misfit"] | {"inconstancy": 5.3}}
    assert not [text for text in chapter(result(said), {}, CALIBRATED, study).why if "The sizes of" in text]
    assert "sizes differ" not in headline(result(said))


def test_a_suspect_that_could_not_be_tested_has_no_size(told):
    [clipping] = [s for s in told("named").suspects.rest if s.effect == "clipping"]
    assert (clipping.z, clipping.sizes, clipping.detectable) == ("-", ("-",), ())
    assert clipping.reason.startswith("it has no derivative where it is absent, so no score test")


def test_features_stand_worst_first_in_the_units_of_a_reader(told):
    first, *_ = told("named").features.marked
    assert (first.measured, first.predicted, first.unit) == ("2.4100 ± 0.0080", "2.4700", "mm")
    assert first.z == "+15.0"


def test_a_gain_that_may_be_none_is_said_to_be(study):
    said = document("named", VALUES)
    assert chapter(result(said), {}, CALIBRATED, study).tone == "good"
    said["gain"] = said["gain"] | {"interval": [-0.001, 0.02], "proven": False}
    [told] = [point for point in points(result(said)) if point.startswith("On records held out (louder, slower) ")]
    assert (
        "3.1\u00a0% to 1.04\u00a0%: between 0.1 more and 2 less, in percentage points (95\u00a0% interval), which "
        in told
    )
    assert "which includes zero: the gain is not significant." in told
    assert chapter(result(said), {}, CALIBRATED, study).tone == "mind"


def test_a_diagnosis_of_other_values_is_out_of_date():
    said = document("named", VALUES)
    assert not stale(result(said), CALIBRATED)
    assert stale(result(said), CalibrationResult(values=VALUES | {"gap": 1.01e-3}))


def test_a_page_without_a_diagnosis_has_no_such_chapter(page, study, undrawn):
    assert page.count('<h2 id="diagnosis">') == 1
    without = render(study, [], {}, CALIBRATED)
    assert "diagnosis" not in words(without)
    assert re.findall("<h2", page)[1:] == re.findall("<h2", without)  # one chapter more


def test_the_page_says_that_a_diagnosis_is_out_of_date(study, undrawn):
    remark = (
        "Out of date: the study was calibrated again after this diagnosis, which is of the earlier values. "
        "Run calib diagnose again."
    )
    for values, is_stale in (({**VALUES, "gap": 2e-3}, True), (VALUES, False)):
        said = document("not_diagnosable", values)
        assert (remark in words(render(study, [], {}, CALIBRATED, diagnosis=result(said)))) == is_stale


def test_the_chapter_closes_its_elements_and_has_its_pictures(page):
    part = page[page.index('<h2 id="diagnosis">') : page.index("<h2>The search")]
    tags = ("table", "details", "figure", "div", "svg", "ul")
    opened = {tag: len(re.findall(rf"<{tag}[\s>]", part)) for tag in tags}
    assert opened == {tag: part.count(f"</{tag}>") for tag in tags}
    assert min(opened.values()) > 0
    # loops, residual, two forces, suspects, magnified, separation (map and lines), gain, transfers, shifts
    assert part.count("<figure>") == 11


def test_noise_alone_stands_nowhere_clear_and_a_missing_force_does():
    rng = np.random.default_rng(3)
    quiet, lacking = motion(rng), motion(rng, lack=0.03)
    assert not any(
        is_significant(force) for body in ("q2", "q3") for force in missing_accelerations({"a": quiet}, body).values()
    )
    assert is_significant(missing_accelerations({"a": lacking}, "q3")["a"])


def test_a_record_without_a_period_is_drawn_over_time():
    record = motion(np.random.default_rng(4))
    record.attrs = {"cycle": 1}
    figure = residual_figure(record)
    assert figure.axes[-1].get_xlabel() == "Time [s]"
    assert compared_cycle(record, 0).cycles == 1


@pytest.mark.parametrize("period", [True, False])
@pytest.mark.parametrize("label", ["with drag", ""])
def test_the_residual_of_the_extended_model_is_drawn_beside_that_of_the_calibrated(period, label):
    record = motion(np.random.default_rng(9), lack=0.03)
    record["extended"] = record.measured.copy()
    record.attrs = record.attrs if period else {"cycle": 1}
    figure = residual_figure(record, label)
    named = [text.get_text() for text in figure.legends[0].get_texts()]
    assert ("with drag" in named) == bool(label)
    green = [line for line in figure.axes[0].lines if line.get_color() == EXTENDED]
    assert len(green) == 1
    assert np.nanmax(np.abs(green[0].get_ydata())) == 0.0


def test_the_mean_cycle_of_a_motion_is_less_noisy_than_its_samples():
    own = compared_cycle(motion(np.random.default_rng(5)), 1)
    assert own.cycles == 6
    assert np.std((own.measured - own.calibrated)[own.weight > 0.5]) == pytest.approx(own.sigma, rel=0.2)


def test_what_a_diagnosis_leaves_in_its_folder_can_be_read_again(tmp_path):
    record = motion(np.random.default_rng(6))
    pairs = tuple((body, channel) for _, body, channel, _ in compared_rows(record))
    noise = (Noise(1e-5, np.zeros(0), ""), Noise(1e-3, np.array([0.5]), "")) * 2
    shape = np.ones(record.measured.shape)
    part = Part(
        "clapping", pairs, record.time.values, record.measured.values, 0.04, 1, (), noise, shape > 0.0, shape
    )  # fmt: skip
    point = SimpleNamespace(simulated={"clapping": SimulatedRows(record.calibrated.values, shape[0])})
    selection = SimpleNamespace(null=SimpleNamespace(point=point), causes=())
    found = Diagnosis("not_diagnosable", "", (), evidence=Evidence((part,)))
    reference = SimpleNamespace(
        compared={c: SimpleNamespace(attrs={"units": "m"}) for c in ("displacement", "velocity")}
    )
    assert artifacts.read(tmp_path) is None
    assert artifacts.write(found, tmp_path, VALUES, {}) == artifacts.read(tmp_path)
    assert artifacts.read(tmp_path).values == VALUES
    assert artifacts.read_motions(tmp_path) == {}
    views = artifacts.motions(SimpleNamespace(selection=selection, evidence=found.evidence), {"clapping": reference})
    assert set(views) == {"clapping"}
    assert views["clapping"].memory.values[1] == pytest.approx(0.5)
    assert views["clapping"].innovation.values[1] == pytest.approx(1e-3 * np.sqrt(0.75))
    artifacts.write_motions({**views, "one more": motion(np.random.default_rng(7))}, tmp_path)
    again = artifacts.read_motions(tmp_path)
    assert list(again) == ["clapping", "one more"]
    assert again["clapping"].identical(views["clapping"])
    assert residual_figure(again["clapping"]) is not None


def test_a_class_of_one_is_not_said_to_have_others(study):
    said = document("one_of", VALUES)
    said |= {"class": [["quadratic_drag"]], "said": "quadratic_drag: explains all; or what acts alike"}
    told = chapter(result(said), {}, CALIBRATED, study)
    [row] = [row for row in told.suspects.shown if row.effect == "quadratic_drag"]
    assert row.reason == "one steady tone alone does not confirm it"
    assert "one record does not confirm it: quadratic_drag" in told.headline
    assert any("cross-validation over its cycles tests no prediction" in text for text in told.why)
    assert not any("the best of them" in point for point in told.points)


@pytest.mark.parametrize("extended", [True, False])
def test_a_caption_tells_of_green_where_it_is_drawn(extended, study):
    record = motion(np.random.default_rng(9), lack=0.03)
    record = record.drop_vars("extended", errors="ignore")
    record = record.assign(extended=record.measured.copy()) if extended else record
    told = chapter(result(document("named", VALUES)), {"clapping": record}, CALIBRATED, study)
    assert all(("green by the extended one" in picture.picture.caption) == extended for picture in told.residuals)
    assert told.residuals


@pytest.mark.parametrize(
    "text", ["{", "[]", "{}", '{"verdict": "none", "gates": [1]}', '{"verdict": "none", "gates": [{"name": "noise"}]}']
)
def test_a_file_that_is_no_diagnosis_is_refused(text, tmp_path):
    (tmp_path / "diagnosis.json").write_text(text)
    with pytest.raises(CalibError, match="holds no diagnosis"):
        artifacts.read(tmp_path)


@pytest.mark.parametrize("verdict", ["named", "one_of", "unexplained", "not_diagnosable"])
def test_that_the_budget_ended_a_search_is_said_once_and_what_was_left_out(verdict, study):
    said = document(verdict, VALUES)
    whole, left_out = headline(result(said)), ["fits of softening were left out or broken off", "not all was tried"]
    begun = result({**said, "cut_short": True, "omitted": left_out})
    assert "budget was spent" not in " ".join([whole, *points(result(said))])
    assert headline(begun) == f"{whole} The budget was spent before all was tried."
    page = chapter(begun, {}, CALIBRATED, study)
    assert " ".join([page.headline, *page.points]).count("budget was spent") == 1
    assert any(point.startswith(f"Left out for the budget: {'; '.join(left_out)}. A larger") for point in page.points)
    assert begun.full_summary == f"{said['said']} (the budget was spent: {'; '.join(left_out)})"


def test_the_effect_that_explains_most_and_is_none_is_in_the_headline():
    said = {**document("unexplained", VALUES), "closest": []}
    said["rounds"] = [{"threshold": 3.0, "rejected": "coulomb_friction", "rejection": "it does not predict other data"}]
    text = (
        "No known effect can be named as its cause: coulomb_friction explains most, but it does not predict other data."
    )
    assert headline(result(said)) == f"The misfit is more than noise. {text}"
