"""Claims about the page: it stands alone, says what was found, and can be shown to a customer."""

import os
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pytest

from calib.objective import MISFIT, Reference
from calib.records.excitation import Excitation
from calib.records.response import make_response
from calib.report.formatting import measured_number, number
from calib.report.pages.base_study import BaseStudy
from calib.report.pages.page import render
from calib.report.pages.sections import MAX_DRAWN_BODIES, excitation_text, noise_text, record_section
from calib.report.pages.tables import fixed
from calib.report.pages.verdict import starts_sentences, verdict
from calib.store import Header
from calib.store.environment import Environment
from calib.study import CalibrationResult, UndeterminedGroup
from calib.study.result import ConfirmationSummary, LeaderSummary, MotionSummary, ScoreSummary

LARGEST = 3_000_000  # bytes


class Structure(HTMLParser):
    """Addresses that a page wants, and whether its elements are closed."""

    VOID = frozenset({"meta", "br", "img", "link", "input", "hr"})

    def __init__(self, text):
        super().__init__()
        self.wanted, self.open = [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.wanted += [value for name, value in attrs if name in ("href", "src", "xlink:href") and value]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture(scope="session", params=["periodic", "recorded", "hopeless"])
def page(request):
    if request.param == "periodic":
        return request.getfixturevalue("found")
    return render(*request.getfixturevalue(request.param).arguments)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("simulated", [True, False])
def test_a_record_of_many_channels_has_panels_for_some_bodies(periodic, simulated):
    """500 channels; those whose motion the excitation prescribes come last."""
    bodies = [f"node{number}" for number in range(250)]
    given = {"prescribed": ",".join(f"{body}.displacement,{body}.velocity" for body in bodies[:200])}

    def repeated(record, **attrs):
        return record.isel(body=np.arange(250) % 2).assign_coords(body=bodies).assign_attrs(record.attrs | attrs)

    reference = periodic.study.objective.references["clapping"]
    reference = replace(reference, record=repeated(reference.record))
    objective = SimpleNamespace(**vars(periodic.study.objective) | {"references": {"clapping": reference}})
    study = SimpleNamespace(**vars(periodic.study) | {"objective": objective})
    record = repeated(periodic.records["clapping"], **given)
    drawn = record_section(study, "clapping", record if simulated else None, periodic.result)
    assert len(drawn.pictures) + len(drawn.residuals) == (3 if simulated else 2)
    for picture in (*drawn.pictures, *drawn.residuals):
        assert picture.caption.endswith("Panels are drawn for 12 of the 250 bodies.")
        assert len([axes for axes in picture.figure.axes if axes.get_visible()]) <= 2 * MAX_DRAWN_BODIES
    assert drawn.pictures[0].figure.axes[0].get_title(loc="left") == ("node200" if simulated else "node0")
    assert len(drawn.rms) == (100 if simulated else 0)


@pytest.fixture(scope="session")
def found(periodic):
    return render(*periodic.arguments, command="calib run studies/minimal/study.toml")


@pytest.mark.slow
def test_two_processes_draw_the_same_page(periodic, found):
    again = render(*periodic.arguments, command="calib run studies/minimal/study.toml", jobs=2)
    assert without_time(found) == without_time(again)


def without_time(page):
    """A page without the day and minute at which it was made."""
    text, count = re.subn(r"\d{4}-\d\d-\d\d \d\d:\d\d UTC", "", page)
    assert count == 1
    return text


def words(text):
    return re.sub(
        r"\s+", " ", re.sub(r"<[^>]+>", " ", re.sub(r"<svg.*?</svg>|<style.*?</style>", " ", text, flags=re.S))
    )


def test_the_page_wants_nothing_from_elsewhere(page):
    structure = Structure(page)
    assert structure.open == []
    assert structure.wanted
    assert all(address.startswith(("#", "data:")) for address in structure.wanted)
    assert "<script" not in page
    assert "@import" not in page
    assert not re.search(r"url\((?!#)", page)


def test_the_page_is_small(page):
    assert 10_000 < len(page.encode()) < LARGEST


def test_an_id_that_is_referred_to_never_means_two_things(found):
    drawings = re.findall(r"<svg.*?</svg>", found, flags=re.S)
    defined = [set(re.findall(r'\bid="([^"]+)"', drawing)) for drawing in drawings]
    wanted = set(re.findall(r'url\(#([^)]+)\)|href="#([^"]+)"', " ".join(drawings)))
    names = {one or other for one, other in wanted}
    assert names
    assert {sum(name in ids for ids in defined) for name in names} == {1}


def test_it_says_kind_distance_agreement_and_what_was_not_reached(found):
    text = words(found)
    assert "from the measurement; 1 measured feature out of reach of the windows." in text
    assert "period 1, as measured" in text
    assert "6 of 8 starts" in text
    assert "amplitude of q3 in clapping (measured 2.41 mm, nearest 3.02 mm, +25.3 %)" in text
    assert "louder 2.8 % (period 1)" in text
    assert MISFIT in text
    assert "slower failed (diverged)" in text


def test_it_says_what_is_at_an_edge_and_what_is_not_determined(found):
    text = words(found)
    assert "At the edge of its window: restitution (low end). A better value may lie outside." in text
    assert "over the one before at the lower edge of its window 0.000 0.020 1 0 to 0.02 0 to 0.6" in text
    assert "damping modal damping ratio not determined inside its window" in text
    assert "only in combination damping: not determined inside its window" in text
    assert (text.count("not determined inside its window"), text.count("at the lower edge")) == (3, 1)


def test_the_instant_at_which_a_record_starts_has_its_unit(found):
    assert "solved for with each record: in clapping trigger 12.3 ms. " in words(found)


def test_records_that_are_not_measured_are_said_to_be_so(found):
    text = words(found)
    assert "clapping, louder, slower: not measured: &lt;computed&gt; outside this project" in text
    assert text.count("not a measurement") == 3


def test_failed_trials_are_grouped_with_their_reason(found, periodic):
    failed = [t for t in periodic.trials if t.status != "ok"]
    assert re.search(rf"step budget {len(failed)} {failed[0].reason}", words(found))


def test_it_says_how_to_make_it_again(found, periodic):
    result, failed = periodic.result, sum(t.status != "ok" for t in periodic.trials)
    assert (
        "Command calib run studies/minimal/study.toml Model four_dof Seed 1 Budget 600 trials "
        f"Trials made {len(periodic.trials)}, of which {failed} failed Simulations {result.simulations} "
        "Wall-clock time 12.3 s Search ended all starts have ended"
    ) in words(found)


def test_lengths_are_shown_in_millimetres(found):
    assert re.search(r"gap distance of the surfaces at rest 0\.\d{3} 0\.060 mm", words(found))


def test_another_kind_of_motion_comes_before_any_distance(periodic):
    said = verdict(replace(periodic.result, motion=MotionSummary("period 2", wrong=("clapping",))))
    assert said.tone == "bad"
    assert "another kind of motion" in said.headline
    assert "period 2, which is not the measured kind in clapping" in said.points[0]


@pytest.mark.parametrize(
    ("agree", "starts", "said"),
    [
        (0, 0, "no start of the search has come to its end: a larger budget may find a better point"),
        (0, 1, "the one start of the search has not come to its end: a larger budget may find a better point"),
        (0, 3, "no start of the search has come to its end: a larger budget may find a better point"),
        (1, 1, "the search had one start only: another may end at another point"),
        (1, 3, "1 of 3 starts of the search ended at this point: it may not be the best of the windows"),
        (2, 3, "2 of 3 starts of the search ended at this point"),
    ],
)
def test_where_the_starts_of_a_search_ended_is_said_of_those_that_ended(agree, starts, said):
    result = CalibrationResult(score=ScoreSummary(0.02), agreement={"agree": agree, "starts": starts})
    assert starts_sentences(result) == [said]
    assert f"{said[:1].upper()}{said[1:]}." in verdict(result).points


def test_a_motion_without_a_period_is_not_said_to_have_an_excitation_without_one():
    """It may be driven with a period and simulated from rest, or not be driven at all."""
    said = verdict(CalibrationResult(score=ScoreSummary(0.02), motion=MotionSummary("not periodic")))
    assert said.points[0].startswith("Kinds of motion do not apply")
    assert "excitation has no period" not in said.points[0]


@pytest.mark.parametrize(("total", "another"), [(9.0, False), (10.37, True)])
def test_a_distance_that_is_a_penalty_is_said_to_be_that_of_another_kind_of_motion(total, another, periodic, undrawn):
    leaders = tuple(LeaderSummary(3, searched=0.43, confirmed=c, kind="period 1") for c in (total, 0.4336))
    confirmation = ConfirmationSummary(leaders, chosen=3, changed=True)
    scene = replace(periodic, result=replace(periodic.result, confirmation=confirmation))
    text = words(render(*scene.arguments))
    assert ("10.37, another kind of motion" in text) == another
    held = replace(periodic.result.holdout["louder"], score=total)
    scene = replace(periodic, result=replace(periodic.result, holdout={"louder": held}))
    text = words(render(*scene.arguments))
    assert ("Score of the study's terms on this record: 10.37, another kind of motion." in text) == another
    assert ("times that of the calibrated record" in text) != another


def test_an_interval_of_the_parameters_is_called_by_one_definition(found):
    text = words(found)
    assert "its interval (two standard errors" not in text
    assert "95 % interval: from the standard errors by Student's t" in text


def test_a_parameter_of_which_only_combinations_are_determined_is_said_to_be(periodic, undrawn):
    group = UndeterminedGroup(
        ("gap", "damping"), text="only gap / damping is determined", reason="wider than the window"
    )
    scene = replace(periodic, result=replace(periodic.result, undetermined=(group,)))
    assert "determined only in combination with damping" in words(render(*scene.arguments))


def test_a_parameter_that_is_nearly_collinear_with_another_is_not_said_to_be_undetermined(periodic, undrawn):
    group = UndeterminedGroup(("gap", "damping"), text="gap damping is determined better", reason="nearly collinear")
    scene = replace(periodic, result=replace(periodic.result, undetermined=(group,)))
    text = words(render(*scene.arguments))
    assert "nearly collinear with damping" in text
    assert "determined only in combination with" not in text


@pytest.mark.parametrize(("total", "tone"), [(0.02, "good"), (0.14, "mind")])
def test_a_large_distance_is_no_agreement(total, tone):
    said = verdict(CalibrationResult(score=ScoreSummary(total), motion=MotionSummary("period-1")))
    assert said.tone == tone
    assert ("more than 5 %" in " ".join(said.points)) == (tone == "mind")


def test_a_study_without_a_score_says_so(hopeless, undrawn):
    text = words(render(*hopeless.arguments))
    assert "No trial ended with a score: nothing was calibrated. The reasons why the trials failed are listed" in text
    assert "Parameters No values: no trial ended with a score." in text
    assert "Score by term No score." in text
    [first, *_] = hopeless.trials
    assert f"step budget {len(hopeless.trials)} {first.reason} {first.number}," in text


def test_a_study_without_trials_still_has_a_page(hopeless, undrawn):
    text = words(render(hopeless.study, [], {}, hopeless.result))
    assert "The search There is no trial yet." in text
    assert "Failed trials" not in text
    assert "louder held out of the calibration" in text
    assert "slower held out of the calibration" in text


def test_text_of_others_is_escaped(periodic, undrawn):
    trials = [replace(periodic.trials[3], reason="<script>alert(1)</script>")]
    study = SimpleNamespace(**{**vars(periodic.study), "name": "<b>bold</b>"})
    page = render(study, trials, {}, CalibrationResult())
    assert "<script>alert" not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in page
    assert "<b>bold" not in page
    assert "&lt;b&gt;bold&lt;/b&gt;" in page


def test_versions_and_processor_are_those_of_the_ledger(periodic, undrawn):
    environment = Environment({"python": "3.99"}, "Abacus 7", "", {})
    header = Header(1, "", 0, "demo", {}, "", 2, 2, 20, 20).within(environment)
    text = words(render(*periodic.arguments, header=header))
    assert "Versions python 3.99 Processor Abacus 7 Page written" in text


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (0.02, "0.02"), (1234.5678, "1235"), (6e-5, "6·10⁻⁵"), (1.5e7, "1.5·10⁷"), (None, "-"), (7, "7")],
)
def test_numbers_are_written_for_a_reader(value, text):
    assert number(value) == text


def test_a_value_keeps_the_digits_that_its_error_leaves_it():
    assert measured_number(1.234567, 1e-4) == "1.23457"
    assert measured_number(1.234567, None) == "1.235"


def test_it_opens_in_a_browser_without_a_complaint_and_prints(page, tmp_path):
    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    if browser is None:
        if os.environ.get("CALIB_BROWSER_REQUIRED"):
            pytest.fail("chromium is not installed")
        pytest.skip("chromium is not installed")
    (tmp_path / "report.html").write_text(page, encoding="utf-8")
    options = "--headless --no-sandbox --disable-gpu --no-first-run --disable-background-networking --disable-sync"
    quiet = f"--disable-component-update --enable-logging=stderr --user-data-dir={tmp_path / 'profile'}"
    command = [browser, *options.split(), *quiet.split(), f"--print-to-pdf={tmp_path / 'report.pdf'}"]
    run = subprocess.run([*command, f"file://{tmp_path / 'report.html'}"], capture_output=True, text=True, timeout=120)
    assert run.returncode == 0
    assert "CONSOLE" not in run.stderr
    assert (tmp_path / "report.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(("rate", "said"), [(48e-6, "48 ppm slow"), (-5e-5, "50 ppm fast"), (0.0, "")])
def test_the_page_says_how_far_the_clock_is_off(rate, said):
    text = excitation_text(Excitation("mass", "force", frequency=20.0, amplitude=1.0), rate)
    assert said in text
    assert ("clock" in text) == bool(rate)


@pytest.mark.parametrize(
    ("excitation", "said"),
    [
        (
            Excitation("end", "displacement", frequency=26.24, amplitude=1.5e-3),
            "displacement of the end, 1.5 mm at 26.24 Hz",
        ),
        (
            Excitation("mass", "force", time=np.arange(4.0), value=np.ones(4)),
            "excited by the recorded force of the mass",
        ),
        (Excitation("mass", "free decay"), "free motion of the mass, no excitation"),
    ],
)
def test_the_page_says_how_a_record_was_excited(excitation, said):
    assert said in excitation_text(excitation)


@pytest.mark.parametrize("of_record", [{}, {"place": "base", "quantity": "base motion"}])
def test_the_page_says_how_a_frequency_response_was_excited_as_the_study_has_it(of_record, periodic, undrawn):
    record = make_response(np.array([1.0, 2.0]), ["q2"], np.ones((1, 2)), 0.5, "N", **of_record)
    swept = Reference("swept", record, excitation=Excitation("end", "force", frequency=1.0, amplitude=0.5))
    study = SimpleNamespace(objective=SimpleNamespace(references={"swept": swept}))
    driven = record_section(study, "swept", None, periodic.result).driven
    assert driven == "swept by force at the end, 0.5 N, from 1 Hz to 2 Hz"


def test_the_page_states_the_uncertainty_of_a_record(periodic):
    record = periodic.study.objective.references["clapping"].record
    assert noise_text(record).startswith("stated standard uncertainty: displacement of q2 0.02 mm, velocity of q2 0.00")
    silent = record.drop_vars(["displacement_sigma", "velocity_sigma"])
    assert noise_text(silent) == "no uncertainty stated"


@pytest.mark.slow
def test_the_page_of_an_extended_study_says_how_near_the_model_without_it_comes(periodic, found):
    base = BaseStudy(replace(periodic.result, name="plain"), periodic.records)
    page = render(*periodic.arguments, base=base)
    assert "Without the extension (study plain): distance " in page
    assert "misfit of the records held out: louder " in page
    assert "without the extension" in page
    assert "ithout the extension" not in found


def test_a_parameter_that_is_solved_for_has_no_value_of_the_study(periodic):
    name = next(iter(row.name for row in fixed(periodic.study, periodic.result)))
    solved = replace(periodic.result, nuisances={"clapping": {name: 0.1}})
    [row] = [row for row in fixed(periodic.study, solved) if row.name == name]
    assert (row.value, row.how) == ("-", "nuisance, solved for in clapping")
