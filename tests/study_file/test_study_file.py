"""A study file becomes a study, or a list of what is wrong in it."""

import hashlib
import json
import math
import pickle
from types import SimpleNamespace

import numpy as np
import pytest
from echo_study import TEXT, bench, write_study
from hypothesis import given, settings
from hypothesis import strategies as st

from calib import plugins, records
from calib.diagnosis.laboratory import Laboratory, mistakes_of
from calib.errors import CalibError
from calib.modelling.model import Model
from calib.modelling.parameter import Window
from calib.records.excitation import Excitation
from calib.simulators.oscillator import Oscillator
from calib.study_file import StudyToml, load
from calib.study_file.lines import dotted, line_of, lines


def line(text: str, start: str) -> int:
    return next(i for i, row in enumerate(text.splitlines(), 1) if row.startswith(start))


# --- lines


def test_every_key_is_found_on_its_line():
    text = '# a\n[a]\nb = 1\nc.d = 2\n\n[[e]]\nf = [\n  1,\n  { g = 2 },\n]\n[[e]]\nh = """\n[no]\n"""\n[a.k]\n'
    found = lines(text)
    assert found[("a",)] == 2
    assert found[("a", "b")] == 3
    assert found[("a", "c", "d")] == 4
    assert found[("e", 0)] == 6
    assert found[("e", 0, "f", 1, "g")] == 9
    assert found[("e", 1)] == 11
    assert found[("e", 1, "h")] == 12
    assert found[("a", "k")] == 15


def test_a_key_that_is_not_there_stands_where_its_table_does():
    found = lines("[a]\nb = 1\n")
    assert line_of(found, ("a", "c", "d")) == 1
    assert line_of(found, ("z",)) is None


def test_entries_are_counted_from_one():
    assert dotted(("record", 1, "bodies", "q2")) == "record[2].bodies.q2"


names = st.text("abcdefgh", min_size=1, max_size=4)


@settings(deadline=None)
@given(st.dictionaries(names, st.dictionaries(names, st.integers() | st.lists(st.integers())), max_size=5))
def test_lines_are_those_where_the_keys_were_written(tables):
    rows, expected = [], {}
    for table, entries in tables.items():
        rows.append(f"[{table}]")
        expected[(table,)] = len(rows)
        for key, value in entries.items():
            rows.append(f"{key} = {value}")
            expected[(table, key)] = len(rows)
    found = lines("\n".join(rows))
    assert {key: found[key] for key in expected} == expected


# --- a good file


def test_a_study_file_becomes_a_study(tmp_path):
    file = load(write_study(tmp_path))
    assert file.study.name == "echo"
    assert file.study.space.windows == {"gain": Window(0.5, 2.0, "log"), "harmonic": Window(-1e-3, 1e-3)}
    assert list(file.study.objective.references) == ["bench"]
    assert (file.view, file.keep, file.folder) == ("journal", "improving", tmp_path / "out")


def test_a_folder_stands_for_the_study_file_in_it(tmp_path):
    write_study(tmp_path)
    assert load(tmp_path).path == tmp_path / "study.toml"


def test_a_study_can_be_sent_to_a_child_process(tmp_path):
    study = load(write_study(tmp_path)).study
    assert pickle.loads(pickle.dumps(study)).definition == study.definition


def test_hold_out_records_are_not_calibrated_on(tmp_path):
    other = "[model]\n", '[[record]]\nname = "louder"\npath = "bench.nc"\nuse = "holdout"\n\n[model]\n'
    file = load(write_study(tmp_path, other))
    assert list(file.study.objective.references) == ["bench"]
    assert list(file.others) == ["louder"]


def test_bodies_are_renamed_to_the_simulators(tmp_path):
    path = write_study(tmp_path, ("nuisance = [", 'bodies = { cart = "mass" }\nnuisance = ['))
    records.write(bench().assign_coords(body=["cart"]), tmp_path / "bench.nc")
    assert list(load(path).study.objective.references["bench"].record.body.values) == ["mass"]


def test_a_record_may_have_its_own_request(tmp_path):
    file = load(write_study(tmp_path, ("nuisance = [", "periods = 3\nnuisance = [")))
    request = file.study.objective.references["bench"].request
    assert (request.periods, request.samples) == (3, 400)


def test_a_window_may_hold_for_one_record_only(tmp_path):
    file = load(write_study(tmp_path, ("gain = { low", '"gain@bench" = { low')))
    assert file.study.space.names == ("gain@bench", "harmonic")


def test_the_data_folder_comes_from_the_environment(tmp_path, monkeypatch):
    data = tmp_path / "data"
    data.mkdir()
    monkeypatch.setenv("CALIB_DATA", str(data))
    path = write_study(tmp_path, ('path = "bench.nc"', 'path = "${CALIB_DATA}/bench.nc"'))
    (tmp_path / "bench.nc").rename(data / "bench.nc")
    assert load(path).study.name == "echo"


def test_the_data_folder_is_else_beside_the_checkout(tmp_path, monkeypatch):
    monkeypatch.delenv("CALIB_DATA", raising=False)
    here, data = tmp_path / "checkout" / "studies" / "echo", tmp_path / "shared" / "data"
    here.mkdir(parents=True)
    data.mkdir(parents=True)
    path = write_study(here, ('path = "bench.nc"', 'path = "${CALIB_DATA}/bench.nc"'))
    (here / "bench.nc").rename(data / "bench.nc")
    assert load(path).study.name == "echo"


# --- what defines a study


def test_the_definition_is_json_with_the_sum_of_each_record(tmp_path):
    definition = load(write_study(tmp_path)).study.definition
    json.dumps(definition, allow_nan=False)
    digest = hashlib.sha256((tmp_path / "bench.nc").read_bytes()).hexdigest()
    assert definition["records"]["bench"]["sha256"] == digest


@pytest.mark.parametrize(
    "change",
    [
        ("jobs = 1", "jobs = 2"),
        ("budget = 24", "budget = 50"),
        ('timeout = "20 s"', "timeout = 10"),
        ("[optimiser]", '[store]\nkeep = "all"\n\n[optimiser]'),
        ('low = "-1 mm"', "low = -0.001"),
        ("seed = 1", "# the seed\nseed = 1"),
    ],
)
def test_what_does_not_change_the_trials_does_not_change_the_definition(tmp_path, change):
    before = load(write_study(tmp_path)).study.definition
    assert json.dumps(load(write_study(tmp_path, change)).study.definition) == json.dumps(before)


@pytest.mark.parametrize(
    "change",
    [
        ("seed = 1", "seed = 2"),
        ("high = 2.0", "high = 2.1"),
        ("gain = { low = 0.5, high = 2.0, scale = \"log\" }\nharmonic = { low = \"-1 mm\", high = \"1 mm\" }",
         "harmonic = { low = \"-1 mm\", high = \"1 mm\" }\ngain = { low = 0.5, high = 2.0, scale = \"log\" }"),
        ('feature = "phase_curve"', 'feature = "phase_curve"\nweight = 2.0'),
        ('nuisance = ["trigger"]', "nuisance = []"),
    ],
)  # fmt: skip
def test_what_changes_the_trials_changes_the_definition(tmp_path, change):
    before = load(write_study(tmp_path)).study.definition
    assert json.dumps(load(write_study(tmp_path, change)).study.definition) != json.dumps(before)


def test_the_schema_knows_every_table():
    assert set(StudyToml.model_json_schema()["properties"]) == {
        "study", "pool", "record", "model", "windows", "term", "optimiser", "store", "diagnosis",
        "confidence",
    }  # fmt: skip


def test_a_record_that_is_held_out_may_have_values_of_its_own(tmp_path):
    other = '[[record]]\nname = "other"\npath = "bench.nc"\nnuisance = ["trigger"]\nuse = "holdout"\n\n'
    fixed = '[model]\nfixed = { "gain@other" = 1.5 }\n'
    path = write_study(tmp_path, ("[model]\n", other + fixed))
    assert load(path).study.space.fixed == {"gain@other": 1.5}


def test_a_search_may_be_told_where_to_start(tmp_path):
    path = write_study(tmp_path, ("low = 0.5, high = 2.0", "low = 0.5, high = 2.0, start = 1.25"))
    study = load(path).study
    assert study.space.start == {"gain": 1.25}
    assert study.space.values(study.space.starting_point) == pytest.approx({"gain": 1.25, "harmonic": 0.0})
    plain = load(write_study(tmp_path)).study
    assert plain.space.starting_point is None
    assert "start" not in plain.definition
    assert study.definition["start"] == {"gain": 1.25}  # another search, which no log of the former replays


def test_a_starting_value_has_a_unit_as_its_window_has(tmp_path):
    path = write_study(tmp_path, ('low = "-1 mm"', 'start = "0.5 mm", low = "-1 mm"'))
    assert load(path).study.space.start == {"harmonic": pytest.approx(5e-4)}


def test_effects_are_known_by_the_reference_they_were_loaded_under(tmp_path):
    asked = '[diagnosis]\ncandidates = ["third_party.hardening:HARDENING", { name = "channel_lag" }]\n\n[windows]'
    known = load(write_study(tmp_path, ("[windows]", asked))).effect_references()
    assert known == {"stiffer_when_bent": "third_party.hardening:HARDENING", "channel_lag": "channel_lag"}
    assert load(write_study(tmp_path)).effect_references()["cubic_stiffness"] == "cubic_stiffness"


def test_all_among_the_candidates_is_every_effect_without_an_entry_of_its_own(tmp_path):
    listed = 'candidates = ["all", "third_party.hardening:HARDENING", { name = "channel_lag", bodies = ["mass"] }]'
    file = load(write_study(tmp_path, ("[windows]", f"[diagnosis]\n{listed}\n\n[windows]")))
    effects = {effect.name: effect for effect in file.suspects()}
    assert set(effects) == {*plugins.names("calib.effects"), "stiffer_when_bent"}
    assert effects["channel_lag"].bodies == ("mass",)
    assert len(file.candidates) == len(effects)


@pytest.mark.parametrize(
    ("listed", "there"), [('"all"', False), ('["all"]', False), ('["all", "delayed_feedback"]', True)]
)
def test_what_an_effect_requires_is_there_where_candidates_name_it(tmp_path, listed, there):
    file = load(write_study(tmp_path, ("[windows]", f"[diagnosis]\ncandidates = {listed}\n\n[windows]")))
    effects = {effect.name: effect for effect in file.suspects()}
    assert bool(effects["delayed_feedback"].requires) != there


# --- the bench of a laboratory


def bench_of(folder, text):
    return write_study(folder, ("[windows]", f"[diagnosis]\nbench = {{ {text} }}\n\n[windows]"))


def test_a_bench_is_read_in_si(tmp_path):
    text = 'frequency = ["5 Hz", "0.04 kHz"], amplitude = ["0.2 mm", "3 mm"]'
    laboratory = load(bench_of(tmp_path, text)).laboratory
    assert laboratory.frequency == pytest.approx((5.0, 40.0))
    assert laboratory.amplitude == pytest.approx((2e-4, 3e-3))
    assert (laboratory.tests, laboratory.channels, laboratory.release) == (None, None, None)
    text = 'tests = ["steady tone"], channels = ["mass.velocity"], simulations = 40'
    laboratory = load(bench_of(tmp_path, text)).laboratory
    assert laboratory == Laboratory(tests=("steady tone",), channels=(("mass", "velocity"),), simulations=40)


def test_without_a_bench_nothing_is_bounded(tmp_path):
    assert load(write_study(tmp_path)).laboratory == Laboratory()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("frequency = [5, 40]", "diagnosis.bench.frequency[1]: expected a text with a unit, such as '20 Hz'"),
        ('frequency = ["5", "40"]', "diagnosis.bench.frequency: '5' has no unit: write '5 Hz'"),
        ('frequency = ["5 mm", "40 mm"]', "diagnosis.bench.frequency"),
        ('frequency = ["40 Hz", "5 Hz"]', "expected [low, high] with 0 < low <= high, got ['40 Hz', '5 Hz']"),
        ('frequency = ["40 Hz"]', "diagnosis.bench.frequency"),
        ('amplitude = ["0 mm", "5 mm"]', "diagnosis.bench.amplitude: expected [low, high] with 0 < low <= high"),
        ('amplitude = ["1 N", "5 N"]', "diagnosis.bench.amplitude: expected a quantity that can be given in m"),
        ('frequncy = ["5 Hz", "40 Hz"]', "diagnosis.bench.frequncy: unknown key (did you mean 'frequency'?)"),
        ('tests = ["stedy tone"]', "bench.tests: unknown kind of test 'stedy tone' (did you mean 'steady tone'?)"),
        ('tests = ["free decay"]', "tests: 'free decay' cannot be made: simulator 'echo' takes no free decay"),
        ('tests = ["recorded input"]', "tests: 'recorded input' cannot be made: it needs records with a recorded"),
        ('release = ["1 mm", "2 mm"]', "diagnosis.bench.release: simulator 'echo' takes no free decay"),
        ('channels = ["velocity"]', "channels: expected 'body.channel', such as 'mass.velocity', got 'velocity'"),
        ('channels = ["mas.velocity"]', "channels: unknown body 'mas' (did you mean 'mass'?)"),
        ('channels = ["mass.speed"]', "channels: unknown channel 'speed'; expected displacement or velocity"),
        ("simulations = 0", "diagnosis.bench.simulations"),
    ],
)
def test_a_bench_that_cannot_be_is_refused_with_its_key(tmp_path, text, said):
    path = bench_of(tmp_path, text)
    with pytest.raises(CalibError) as refused:
        load(path)
    assert said in str(refused.value)
    assert f"{path}:{line(path.read_text(), 'bench')}: diagnosis.bench." in str(refused.value)


def test_a_bench_has_no_frequency_where_no_record_is_harmonic():
    record = Excitation("mass", "force", time=np.arange(9.0), value=np.ones(9))
    references = {"swept": SimpleNamespace(excitation=record, use="calibrate", is_swept=False)}
    found = dict(mistakes_of(Laboratory(frequency=(1.0, 2.0)), references, Model(Oscillator())))
    assert found == {"frequency": "no record has a harmonic excitation whose frequency could be changed; drop this key"}


# --- what is wrong is said


@pytest.mark.parametrize(
    ("old", "new", "at", "said"),
    [
        ("seed = 1", "sead = 1", "sead", "study.sead: unknown key (did you mean 'seed'?)"),
        ("seed = 1", 'seed = "one"', "seed", "study.seed: expected a whole number, got 'one'"),
        ("budget = 24", "budget = 0", "budget", "study.budget"),
        ('timeout = "20 s"', 'timeout = "20 m"', "timeout", "study.timeout"),
        ("screen = 8", "screen = 24", "screen", "study.screen"),
        ("nuisance", "use = 'callibrate'\nnuisance", "use", "(did you mean 'calibrate'?)"),
        ("nuisance = [\"trigger\"]", 'nuisance = ["triger"]', "", "did you mean 'trigger'?"),
        ("simulator = \"tiny_simulators:Echo\"", 'simulator = "four_doff"', "simulator", "did you mean 'four_dof'?"),
        ("[windows]", "options = { falt = 1 }\n[windows]", "options", "unknown option of"),
        ("[windows]", "effects = ['gap_ofset']\n[windows]", "effects", "did you mean 'gap_offset'?"),
        ("[windows]", "effects = ['gap_offset']\n[windows]", "effects", "takes no force laws"),
        ("[windows]", "fixed = { gain = 1 }\n[windows]", "gain", "keep one of them"),
        ("[windows]", "fixed = { gian = 1 }\n[windows]", "fixed", "did you mean 'gain'?"),
        ("gain = {", "gian = {", "gian", "unknown parameter 'gian' (did you mean 'gain'?); this model has gain,"),
        ("gain = {", "'gain@bensch' = {", "'gain@bensch'", "did you mean 'bench'?"),
        ("low = 0.5, high = 2.0", "low = 2, high = 0.5", "gain", "windows.gain: the window is the wrong way round"),
        ("low = 0.5, high = 2.0", "low = 2.0, high = 2.0", "gain", "windows.gain: the window has no width"),
        ("low = 0.5,", "low = 0.0,", "gain", "a log window needs low > 0"),
        ("low = 0.5,", "start = 2.5, low = 0.5,", "gain", "start: the starting value 2.5 lies outside"),
        ("low = 0.5,", 'start = "1 s", low = 0.5,', "gain", "windows.gain.start"),
        ('low = 0.5, high = 2.0, scale = "log"', "low = -1.0, high = 2.0", "gain", "of 'gain' in [0, inf)"),
        ('low = "-1 mm"', 'low = "-1 s"', "harmonic", "windows.harmonic"),
        ('low = "-1 mm"', 'low = "-1 mmm"', "harmonic", "windows.harmonic"),
        ('scale = "log"', 'scale = "logg"', "gain", "did you mean 'log'?"),
        ('feature = "phase_curve"', 'feature = "phase_kurve"', "feature", "did you mean 'phase_curve'?"),
        ('feature = "phase_curve"', 'feature = "phase_curve"\nwieght = 1', "wieght", "term[1].wieght: unknown option"),
        ('feature = "phase_curve"', 'feature = "phase_curve"\nbodies = ["mas"]', "[[term]]", "'mas'"),
        ('feature = "phase_curve"', 'feature = "phase_curve"\nrecords = ["bensch"]', "[[term]]", "'bensch'"),
        ('feature = "phase_curve"', 'feature = "force_balance"', "[[term]]", "force"),
        ('name = "multistart"', 'name = "multistrat"', "name = \"multistrat\"", "did you mean 'multistart'?"),
        ('name = "multistart"', 'name = "multistart"\nbuget = 3', "buget", "optimiser.buget: unknown option of"),
        ("[optimiser]", "[store]\nview = 3\n[optimiser]", "view", "store.view: expected a text, got 3"),
        ("[optimiser]", "[store]\nview = 'jurnal'\n[optimiser]", "view", "store.view: expected 'journal' or the URL"),
        ("[optimiser]", "[store]\nview = 'sql:/me:s3:c/t@lab/x'\n[optimiser]", "view", "got 'sql:***@lab/x'"),
        ('path = "bench.nc"', 'path = "bank.nc"\norigin = "the bench"', "path", "get it from the bench"),
        ('path = "bench.nc"', 'path = "${HOME}/bench.nc"', "path", "only ${CALIB_DATA}"),
        ('path = "bench.nc"', f'path = "bench.nc"\nsha256 = "{64 * "0"}"', "path", "expected sha256 0000"),
        ("[model]", '[[record]]\nname = "bench"\npath = "bench.nc"\n[model]', "", "a second record 'bench'"),
        ("nuisance", "use = 'holdout'\nnuisance", "[[record]]", "no record to calibrate on"),
        ("nuisance", "bodies = { cart = 'mass' }\nnuisance", "bodies", "no body 'cart'"),
        ("nuisance", "bodies = { mass = 'q3' }\nnuisance", "bodies", "'q3'"),
        ("[model]", '[record.excitation]\nquantity = "forze"\n[model]', "[record.excitation]", "did you mean 'force'?"),
        ("[model]", '[record.excitation]\nquantity = "free decay"\n[model]', "[record.", "takes base motion at 'base'"),
    ],
)  # fmt: skip
def test_a_mistake_is_told_with_file_line_and_key(tmp_path, old, new, at, said):
    path = write_study(tmp_path, (old, new))
    with pytest.raises(CalibError) as raised:
        load(path)
    message = str(raised.value)
    assert said in message
    assert f"{path}:{line(path.read_text(), at)}: " in message if at else f"{path}:" in message


def test_all_mistakes_are_told_at_once(tmp_path):
    path = write_study(tmp_path, ("gain = {", "gian = {"), ('"-1 mm"', '"-1 s"'), ("phase_curve", "phase_kurve"))
    with pytest.raises(CalibError, match="3 mistakes") as raised:
        load(path)
    assert len(str(raised.value).splitlines()) == 4


def test_mistakes_of_the_schema_hide_no_others(tmp_path):
    path = write_study(
        tmp_path,
        ("seed = 1\n", ""),
        ("budget = 24", "budget = 0"),
        ("gain = {", "gian = {"),
        ('low = "-1 mm"', 'lwo = "-1 mm"'),
        ("phase_curve", "phase_kurve"),
        ("multistart", "multistrat"),
        ("[model]", "[diagnosis]\ncandidates = ['gap_ofset']\n[model]"),
    )
    with pytest.raises(CalibError) as raised:
        load(path)
    heading, *told = str(raised.value).splitlines()
    keys = ["seed", "budget", "gian", "harmonic.low", "harmonic.lwo", "feature", "optimiser.name", "candidates[1]"]
    assert heading.endswith("8 mistakes:")
    assert all(sum(f"{key}: " in mistake for mistake in told) == 1 for key in keys)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ([("nuisance", "nuissance")], 1),
        ([('name = "bench"\n', ""), ("gain = {", "'gain@bench' = {")], 1),
        ([('simulator = "tiny', 'simulater = "tiny')], 2),  # the known key is missing too
        ([('feature = "phase_curve"', 'feature = "phase_curve"\nweight = 0.0')], 1),
        ([("budget = 24", 'budget = "24"')], 1),
    ],
)
def test_what_depends_on_a_mistake_is_not_told_as_another(tmp_path, changes, told):
    with pytest.raises(CalibError) as raised:
        load(write_study(tmp_path, *changes))
    assert len(str(raised.value).splitlines()) == (1 if told == 1 else told + 1)


def test_a_missing_table_is_named(tmp_path):
    path = write_study(tmp_path, text=TEXT.partition("[[term]]")[0])
    with pytest.raises(CalibError, match=r"the table \[term\] is missing"):
        load(path)


@pytest.mark.parametrize(("text", "at"), [("[study]\nname = \n", 2), ("[study]\n[study]\n", 2), ("a = [\n1,\n", 2)])
def test_a_text_that_is_not_toml_is_refused_with_its_line(tmp_path, text, at):
    path = write_study(tmp_path, text=text)
    with pytest.raises(CalibError, match=f"study.toml:{at}: this is not TOML"):
        load(path)


def test_a_study_that_is_not_there_is_named(tmp_path):
    with pytest.raises(CalibError, match="no such study file"):
        load(tmp_path / "nothing.toml")


def test_an_option_of_the_wrong_kind_is_told_by_the_thing_itself(tmp_path):
    options = 'simulator = "oscillator"\noptions = { hold = "often" }'
    path = write_study(tmp_path, ('simulator = "tiny_simulators:Echo"', options))
    with pytest.raises(CalibError, match=r"study.toml:16: model.options: hold is one of .*, got 'often'"):
        load(path)


TABLE = """path = "bench.csv"
[record.table]
time = { column = "t", unit = "s" }
channels = [{ column = "x", body = "mass", channel = "displacement", unit = "mm" }]
[record.excitation]
place = "base"
quantity = "base motion"
column = "u"
unit = "mm"
"""


def recorded(tmp_path, more):
    rows = [f"{0.01 * i},{math.sin(i)},{math.cos(i)}" for i in range(40)]
    (tmp_path / "bench.csv").write_text("\n".join(["t,x,u", *rows]))
    term = ('feature = "phase_curve"', 'feature = "time_history"')
    return write_study(tmp_path, ('path = "bench.nc"\nnuisance = ["trigger"]\n', TABLE + more), term)


def test_a_recorded_excitation_may_have_a_period(tmp_path):
    reference = load(recorded(tmp_path, 'frequency = "10 Hz"\n')).study.objective.references["bench"]
    assert reference.excitation.recorded
    assert reference.excitation.period == 0.1
    assert reference.request.times == pytest.approx(reference.record.time.values)


@pytest.mark.parametrize("more", ['amplitude = "1 mm"\n', "phase = 1.0\n"])
def test_what_a_column_says_is_not_said_twice(tmp_path, more):
    with pytest.raises(CalibError, match="has its own amplitude and phase"):
        load(recorded(tmp_path, more))


@pytest.mark.parametrize(
    ("old", "new", "key", "at"),
    [
        ('unit = "mm" }', 'unit = "mm/s" }', "record[1].table.channels[1].unit", "channels ="),
        ('unit = "mm" }', 'unit = "mm", sigma = "1 s" }', "record[1].table.channels[1].sigma", "channels ="),
        ('unit = "s" }', 'unit = "mm" }', "record[1].table.time.unit", "time ="),
        ('unit = "mm"\n', 'unit = "N"\n', "record[1].excitation.unit", 'unit = "N"'),
        ('place = "base"\n', "", "record[1].excitation", "[record.excitation]"),
    ],
)
def test_a_wrong_unit_of_a_column_is_told_at_its_own_line(tmp_path, old, new, key, at):
    path = recorded(tmp_path, "")
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(CalibError) as raised:
        load(path)
    assert str(raised.value).startswith(f"{path}:{line(path.read_text(), at)}: {key}: ")


@pytest.mark.parametrize("stated", ["amplitude = 1.0", "amplitude = '1 mm'", "amplitude = '0.001 m'"])
def test_the_unit_of_an_excitation_is_that_of_its_number(stated, tmp_path):
    table = (
        f"[record.excitation]\nplace = 'base'\nquantity = 'base motion'\nfrequency = '10 Hz'\n{stated}\nunit = 'mm'\n"
    )
    path = write_study(tmp_path, ("[model]\n", f"{table}\n[model]\n"))
    assert load(path).reference().excitation.amplitude == pytest.approx(1e-3, rel=1e-12)


@pytest.mark.parametrize(
    ("written", "left"),
    [("", True), ("[optimiser]\nbatch = 4", True), ('[optimiser]\nname = "multistart"', False)]
    + [('[optimiser]\nname = "cma"', False), ("[optimiser]\nscreen = 9", False)],
)
def test_only_a_file_that_chooses_no_optimiser_leaves_slow_simulations_to_emulators(tmp_path, written, left):
    study = load(write_study(tmp_path, ('[optimiser]\nname = "multistart"', written))).study
    assert (study.costly_optimiser is not None) is left
    if left:
        optimiser = pickle.loads(pickle.dumps(study.costly_optimiser))(dim=2, seed=1, budget=30, batch=1)
        assert type(optimiser).__name__ == "Surrogate"
