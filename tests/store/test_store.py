"""The folder of a study: the ledger is the truth, records and the Optuna view follow it."""

import errno
import gc
import json
import math
import os
import pickle
import resource
import signal
import subprocess
import sys
import time
import tracemalloc
import zlib
from contextlib import closing
from dataclasses import replace

import numpy as np
import optuna
import pytest
from child_environment import environment
from store_samples import HEADER, SPACE, TIME, WINDOWS, failed, filled, picture, records, trial

from calib.errors import CalibError
from calib.records import read as read_record
from calib.store import Store, mirror, read
from calib.store.checksum import sealed
from calib.store.ledger import differences
from calib.store.lock import is_locked
from calib.store.optuna_view import storage

# ---- the ledger


def test_trials_are_read_as_they_were_logged(tmp_path):
    written = [trial(0), failed(1), trial(2, features=[{"label": "amplitude", "simulated": 0.3, "measured": 0.4}])]
    filled(tmp_path, written)
    header, got = read(tmp_path)
    assert header.name == "demo"
    assert got == written
    assert [None if t.residuals is None else t.residuals.tolist() for t in got] == [
        None if t.residuals is None else t.residuals.tolist() for t in written
    ]


def test_every_line_is_json_without_infinity(tmp_path):
    filled(tmp_path, [failed(0), trial(1, terms={"curve": 0.5, "impacts": math.inf, "phase": math.nan})])

    def refuse(word):
        raise AssertionError(word)

    lines = [json.loads(text, parse_constant=refuse) for text in (tmp_path / "trials.jsonl").read_text().splitlines()]
    assert lines[1]["total"] is None
    assert lines[2]["terms"] == {"curve": 0.5, "impacts": None, "phase": None}


def test_the_header_says_what_the_numbers_came_from(tmp_path):
    header, _ = read(filled(tmp_path, []))
    assert {"calib", "numpy", "numba", "python"} <= set(header.versions)
    assert header.processor
    assert header.cpu
    assert len(header.digest) == 64
    assert header.definition == HEADER.definition


def test_a_folder_without_a_study_is_said(tmp_path):
    with pytest.raises(CalibError, match="no study was run here"):
        read(tmp_path)


def test_a_running_study_can_be_read(tmp_path):
    with Store(tmp_path, view=None) as store:
        store.open(HEADER)
        store.append(trial(0))
        with open(tmp_path / "trials.jsonl", "ab") as file:
            file.write(b'{"number": 1, "u": [0.1')
        assert [t.number for t in read(tmp_path)[1]] == [0]


def test_a_second_writer_is_refused_and_told_who_is_first(tmp_path):
    with Store(tmp_path, view=None) as store:
        store.open(HEADER)
        with pytest.raises(CalibError, match=f"process {os.getpid()} on "):
            Store(tmp_path, view=None).open(HEADER)
    Store(tmp_path, view=None).open(HEADER)


def test_a_killed_writer_leaves_the_folder_free(tmp_path):
    script = (
        "import os, sys, store.test_store as t; s = t.Store(sys.argv[1], view=None); s.open(t.HEADER); "
        "s.append(t.trial(0)); os.kill(os.getpid(), 9)"
    )
    done = subprocess.run([sys.executable, "-c", script, str(tmp_path)], env=environment())
    assert done.returncode == -signal.SIGKILL
    with Store(tmp_path, view=None) as store:
        assert store.open(HEADER) == [trial(0)]


def test_a_changed_study_is_refused_and_every_change_is_named(tmp_path):
    filled(tmp_path, [trial(0)])
    windows = {"x": {**WINDOWS["x"], "high": 3.0}, "z": WINDOWS["y"]}
    changed = replace(HEADER, definition={"seed": 2, "windows": windows})
    with pytest.raises(CalibError) as caught:
        Store(tmp_path, view=None).open(changed)
    message = str(caught.value)
    for text in ("seed: 1 -> 2", "windows.x.high: 2.0 -> 3.0", "windows.y: {", "-> (absent)", "windows.z: (absent) ->"):
        assert text in message
    assert "--fresh" in message
    with Store(tmp_path, view=None) as store:
        assert len(store.open(HEADER)) == 1, "nothing was touched"


def test_the_order_of_windows_is_part_of_the_study():
    assert differences({"x": 1, "y": 2}, {"x": 1, "y": 2}) == []
    assert "order" in differences({"x": 1, "y": 2}, {"y": 2, "x": 1})[0]


def test_differences_go_into_lists():
    assert differences({"term": [{"weight": 1.0}]}, {"term": [{"weight": 2.0}]}) == ["term[0].weight: 1.0 -> 2.0"]


def test_fresh_sets_everything_aside_and_deletes_nothing(tmp_path):
    filled(tmp_path, [trial(0), trial(1)], view="journal", picture=picture)
    ledger = (tmp_path / "trials.jsonl").read_bytes()
    for said in ("result.json", "report.html"):
        (tmp_path / said).write_text("of the trials before")
    changed = replace(HEADER, definition={**HEADER.definition, "seed": 2})
    with Store(tmp_path) as store:
        assert store.open(changed, fresh=True) == []
        assert store.best is None
    (aside,) = tmp_path.glob("before-*")
    assert (aside / "trials.jsonl").read_bytes() == ledger
    assert {p.name for p in aside.iterdir()} == {
        "trials.jsonl", "residuals.f64", "optuna.log", "artifacts", "records", "best.nc", "result.json", "report.html",
    }  # fmt: skip


def test_a_larger_budget_is_noted_and_the_hint_stays(tmp_path):
    filled(tmp_path, [trial(0)])
    filled(tmp_path, [], header=replace(HEADER, budget=50))
    header, trials = read(tmp_path)
    assert (header.budget, header.hint, header.segment) == (50, 20, 0)
    assert len(trials) == 1


def test_a_damaged_line_in_the_middle_is_an_error_with_its_number(tmp_path):
    filled(tmp_path, [trial(0), trial(1), trial(2)])
    path = tmp_path / "trials.jsonl"
    text = path.read_text().splitlines(keepends=True)
    path.write_text("".join([*text[:2], text[2][:40] + "\n", text[3]]))
    with pytest.raises(CalibError, match="line 3: not readable"):
        Store(tmp_path, view=None).open(HEADER)


def damaged(folder, count, number, change):
    """A folder with a ledger of `count` trials of which line `number` was changed; return its path."""
    filled(folder, [trial(n) for n in range(count)])
    path = folder / "trials.jsonl"
    lines = path.read_text().splitlines()
    assert (changed := change(lines[number - 1])) != lines[number - 1]
    path.write_text("".join(line + "\n" for line in [*lines[: number - 1], changed, *lines[number:]]))
    return path


def without_checksum(line):
    """A line as version 0.1 wrote it."""
    return line.partition(',"crc32":')[0] + "}"


def flipped(line, place):
    """The line with the lowest bit of one character changed."""
    return line[:place] + chr(ord(line[place]) ^ 1) + line[place + 1 :]


def test_a_line_ends_with_the_check_sum_of_its_text(tmp_path):
    path = filled(tmp_path, [trial(0)]) / "trials.jsonl"
    line = path.read_text().splitlines()[1]
    assert list(json.loads(line))[-1] == "crc32"
    assert json.loads(line)["crc32"] == zlib.crc32(without_checksum(line).encode())


def test_any_flipped_bit_in_a_line_is_refused(tmp_path):
    path = filled(tmp_path, [trial(0), trial(1), trial(2)]) / "trials.jsonl"
    lines = path.read_text().splitlines()
    for place in range(len(lines[2])):
        path.write_text("".join(line + "\n" for line in [*lines[:2], flipped(lines[2], place), lines[3]]))
        with pytest.raises(CalibError, match=r"trials.jsonl, line 3: (its check sum does not fit|not readable)"):
            read(tmp_path)


@pytest.mark.parametrize("number", [3, 4])
def test_a_flipped_digit_is_refused_with_its_line_and_the_remedy(tmp_path, number):
    path = damaged(tmp_path, 3, number, lambda line: line.replace('"seconds":0.25', '"seconds":0.35'))
    before = path.read_bytes()
    with pytest.raises(
        CalibError, match=f"{path}, line {number}: its check sum does not fit its content; .*restore it"
    ):
        Store(tmp_path, view=None).open(HEADER)
    assert path.read_bytes() == before


def test_lines_without_a_check_sum_are_read_and_continued(tmp_path):
    path = damaged(tmp_path, 2, 2, without_checksum)
    filled(tmp_path, [trial(2)])
    assert read(tmp_path)[1] == [trial(0), trial(1), trial(2)]
    assert ["crc32" in line for line in path.read_text().splitlines()] == [True, False, True, True]


def test_a_flipped_bit_in_a_header_is_refused_and_nothing_is_lost(tmp_path):
    path = filled(tmp_path, [trial(0)]) / "trials.jsonl"
    filled(tmp_path, [trial(1)], header=replace(HEADER, budget=50))
    lines = path.read_text().splitlines()
    assert "format" in json.loads(lines[2])
    for number in (0, 2):
        for place in range(0, len(lines[number]), 3):
            path.write_text(
                "".join(line + "\n" for line in [*lines[:number], flipped(lines[number], place), *lines[number + 1 :]])
            )
            with pytest.raises(
                CalibError, match=rf"line {number + 1}: (the check sum|its check sum|not readable)|no header"
            ):
                read(tmp_path)
    before = path.read_bytes()
    with pytest.raises(CalibError, match="."):
        Store(tmp_path, view=None).open(HEADER)
    assert path.read_bytes() == before


def test_a_header_that_was_put_right_by_hand_is_read_without_its_check_sum(tmp_path):
    path = filled(tmp_path, [trial(0)]) / "trials.jsonl"
    text = path.read_text()
    path.write_text(text.replace('"budget":20', '"budget":29'))
    with pytest.raises(
        CalibError, match=f'{path}, line 1: the check sum of this header .* the trials after it are safe: .* "crc32"'
    ):
        read(tmp_path)
    first, second = text.splitlines(keepends=True)
    path.write_text(without_checksum(first) + "\n" + second)
    assert read(tmp_path)[1] == [trial(0)]


def test_values_that_contradict_the_point_are_refused_with_their_line(tmp_path):
    def moved(line):
        content = json.loads(without_checksum(line))
        return json.dumps({**content, "values": {**content["values"], "x": content["values"]["x"] * (1.0 + 1e-6)}})

    damaged(tmp_path, 3, 3, moved)
    with pytest.raises(CalibError, match=r"line 3: the values of trial 1 contradict its point: x is .*, but .* at its"):
        Store(tmp_path, view=None).open(HEADER)


def test_a_point_outside_the_unit_cube_is_refused(tmp_path):
    filled(tmp_path, [trial(0, u=[0.5, 1.5], values={**SPACE.values([0.5, 1.5]), "gap": 1e-3})])
    with pytest.raises(CalibError, match=r"line 2: .* the coordinate of y in the unit cube is 1.5"):
        read(tmp_path)


def test_values_that_another_processor_would_round_otherwise_are_no_contradiction():
    one = trial(0)
    rounded = {name: value * (1.0 + 1e-14) for name, value in one.values.items()}
    assert replace(one, values=rounded).contradiction(SPACE.windows) is None


@pytest.mark.parametrize("number", [2, 3, 4])
def test_deeply_nested_brackets_are_damage(tmp_path, number):
    damaged(tmp_path, 3, number, lambda line: line[:-1] + ',"more":' + 100000 * "[" + 100000 * "]" + "}")
    with pytest.raises(CalibError, match=f"line {number}: its brackets are nested too deeply; .* restore it"):
        read(tmp_path)


def test_nested_brackets_within_a_value_are_damage(tmp_path):
    nested = 400 * "[" + 400 * "]"
    damaged(tmp_path, 3, 3, lambda line: without_checksum(line).replace('"reason":""', f'"reason":{nested}'))
    with pytest.raises(CalibError, match="line 3: not readable"):
        read(tmp_path)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("number", None), ("number", -1), ("number", 1.5), ("u", ["0.5", 0.5]), ("total", "1,5"), ("total", 10**400),
        ("terms", {"a": []}), ("kind", 3), ("seconds", "1"), ("simulations", {}), ("residuals", [0.5, 1]),
        ("features", [{"label": 1}]), ("features", [{"simulated": "1,5"}]), ("features", [{"body": 2.0}]),
    ],
)  # fmt: skip
def test_a_value_of_another_type_is_damage_though_its_check_sum_fits(tmp_path, key, value):
    def other(line):
        content = {**json.loads(line), key: value}
        del content["crc32"]
        return sealed(json.dumps(content, separators=(",", ":"))).decode().rstrip("\n")

    damaged(tmp_path, 3, 3, other)
    with pytest.raises(CalibError, match="line 3: "):
        read(tmp_path)


def test_files_of_a_study_follow_the_umask(tmp_path):
    before = os.umask(0o027)
    try:
        filled(tmp_path, [trial(0)], view="journal")
    finally:
        os.umask(before)
    modes = {path.name: path.stat().st_mode & 0o777 for path in tmp_path.rglob("*") if path.is_file()}
    assert modes == dict.fromkeys(modes, 0o640)
    assert {"trials.jsonl", "residuals.f64", "trials.lock", "optuna.log", "best.nc", "000000.nc"} <= set(modes)


def test_keys_of_a_later_version_stay_in_the_header(tmp_path):
    filled(tmp_path, [trial(0)])
    path = tmp_path / "trials.jsonl"
    first, *rest = path.read_text().splitlines(keepends=True)
    later = json.dumps({**json.loads(without_checksum(first)), "machine": [1, None]})
    path.write_text("".join([sealed(later).decode(), *rest]))
    filled(tmp_path, [], header=replace(HEADER, budget=50))
    header, trials = read(tmp_path)
    assert (header.budget, header.further, trials) == (50, {"machine": [1, None]}, [trial(0)])
    assert json.loads(path.read_text().splitlines()[-1])["machine"] == [1, None]


def test_a_header_without_a_definition_is_damage(tmp_path):
    filled(tmp_path, [])
    path = tmp_path / "trials.jsonl"
    header = json.loads(without_checksum(path.read_text()))
    path.write_text(json.dumps({key: value for key, value in header.items() if key != "definition"}) + "\n")
    with pytest.raises(CalibError, match="line 1: not readable"):
        read(tmp_path)


@pytest.mark.parametrize("line", ['{"number": 3}', '{"number": 3, "residuals": 7}'])
def test_a_line_that_is_json_but_no_trial_is_damage_too(tmp_path, line):
    filled(tmp_path, [trial(0), trial(1)])
    path = tmp_path / "trials.jsonl"
    text = path.read_text().splitlines(keepends=True)
    path.write_text("".join([*text[:2], line + "\n", text[2]]))
    with pytest.raises(CalibError, match="line 3: not readable"):
        Store(tmp_path, view=None).open(HEADER)


def test_a_foreign_file_is_not_taken_for_a_ledger(tmp_path):
    (tmp_path / "trials.jsonl").write_text('{"number": 1}\n')
    with pytest.raises(CalibError, match="not a ledger of calib"):
        Store(tmp_path, view=None).open(HEADER)


def test_a_ledger_of_a_later_calib_is_not_guessed_at(tmp_path):
    filled(tmp_path, [])
    path = tmp_path / "trials.jsonl"
    path.write_bytes(sealed(without_checksum(path.read_text()).replace('"format":1', '"format":2')))
    with pytest.raises(CalibError, match="format 2, this calib reads 1"):
        read(tmp_path)


def test_a_full_disk_is_said_and_the_ledger_stays_whole(tmp_path):
    """The limit on file size stands for the disk: the kernel writes a part, then refuses."""
    store = Store(tmp_path, view=None)
    store.open(HEADER)
    store.append(trial(0))
    whole = {name: (tmp_path / name).read_bytes() for name in ("trials.jsonl", "residuals.f64")}
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    for name in whole:
        resource.setrlimit(resource.RLIMIT_FSIZE, (len(whole[name]) + 7, limits[1]))
        try:
            with pytest.raises(CalibError, match=f"cannot write .*{name}: File too large; mend that and run again"):
                store.append(trial(1))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        assert (tmp_path / "trials.jsonl").read_bytes() == whole["trials.jsonl"]
    store.append(trial(1))
    store.close()
    assert read(tmp_path)[1] == [trial(0), trial(1)]


def test_a_full_disk_while_a_record_is_kept_loses_nothing_logged(tmp_path, monkeypatch):
    store = Store(tmp_path, view=None)
    store.open(HEADER)
    store.append(trial(0), records())

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("calib.store.record_files.write", full)
    with pytest.raises(CalibError, match="No space left on device"):
        store.append(trial(1), records())
    store.close()
    assert read(tmp_path)[1] == [trial(0)]


def test_a_folder_that_cannot_be_written_is_said(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    with pytest.raises(CalibError, match="cannot write .*file/out"):
        Store(tmp_path / "file" / "out", view=None).open(HEADER)

    def read_only(*_):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(os, "open", read_only)
    with pytest.raises(CalibError, match="Permission denied"):
        Store(tmp_path, view=None).open(HEADER)


# ---- records


def kept(folder):
    return sorted(path.stem for path in (folder / "records").iterdir())


@pytest.mark.parametrize(
    ("keep", "expected"),
    [("best", ["000003"]), ("improving", ["000000", "000003"]), ("all", ["000000", "000002", "000003", "000004"])],
)
def test_records_are_kept_as_told(tmp_path, keep, expected):
    trials = [trial(0, 0.5), failed(1), trial(2, 0.7), trial(3, 0.2), trial(4, 0.3)]
    filled(tmp_path, trials, keep=keep)
    assert kept(tmp_path) == expected
    assert read_record(tmp_path / "best.nc").attrs["trial"] == 3


def test_the_best_record_says_where_it_comes_from(tmp_path):
    filled(tmp_path, [trial(0)])
    best = read_record(tmp_path / "best.nc")
    provenance = json.loads(best.attrs["provenance"])
    assert provenance["values"] == trial(0).values
    assert provenance["score"]["total"] == 1.0
    assert provenance["study"]["name"] == "demo"
    assert "numpy" in provenance["study"]["versions"]
    assert best.displacement.values.tolist() == [TIME.tolist()]


def test_confirmed_records_are_the_best_ones_until_the_folder_is_opened_again(tmp_path):
    filled(tmp_path, [trial(0), trial(1)])
    store = Store(tmp_path, view=None)
    store.open(HEADER)
    store.close()
    with store.locked():
        assert is_locked(tmp_path)
        store.keep_confirmed(trial(0, 0.9), records(7, ("sweep", "a b")))
    assert not is_locked(tmp_path)
    best = read_record(tmp_path / "best.nc")
    assert best.attrs["trial"] == 0
    assert json.loads(best.attrs["provenance"])["score"]["total"] == 0.9
    assert read_record(tmp_path / "best-a%20b.nc").attrs["record"] == "a b"
    filled(tmp_path, [])
    assert read_record(tmp_path / "best.nc").attrs["trial"] == 1


def test_of_several_records_each_is_a_file(tmp_path):
    with Store(tmp_path, view=None) as store:
        store.open(HEADER)
        store.append(trial(0), records(0, ("sweep", "decay", "a b", "a/b", "a_b")))
    assert kept(tmp_path) == ["000000", "000000-a%20b", "000000-a%2Fb", "000000-a_b", "000000-decay"]
    assert {p.name for p in tmp_path.glob("best-a*")} == {"best-a%20b.nc", "best-a%2Fb.nc", "best-a_b.nc"}
    assert read_record(tmp_path / "best.nc").attrs["record"] == "sweep"


def test_a_best_record_that_lags_is_brought_up_on_opening(tmp_path):
    filled(tmp_path, [trial(0), trial(1)])
    (tmp_path / "best.nc").unlink()
    (tmp_path / "records" / ".000009.nc.x7z").write_text("torn")
    filled(tmp_path, [])
    assert read_record(tmp_path / "best.nc").attrs["trial"] == 1
    assert kept(tmp_path) == ["000000", "000001"]


def test_of_equal_costs_the_earlier_number_is_best_whichever_ended_first(tmp_path):
    filled(tmp_path, [trial(4, 0.5), trial(3, 0.5), trial(5, 0.5)])
    with Store(tmp_path, view=None) as store:
        store.open(HEADER)
        assert store.best.number == 3
    assert read_record(tmp_path / "best.nc").attrs["trial"] == 3


def test_an_unknown_rule_for_records_is_refused(tmp_path):
    with pytest.raises(CalibError, match="'best', 'improving', 'all'"):
        Store(tmp_path, keep="some")


# ---- memory


@pytest.mark.slow
def test_a_trial_that_is_logged_holds_neither_its_residuals_nor_what_others_share(tmp_path):
    feature = {"label": "amplitude", "record": "bench", "body": "mass", "unit": "m", "measured": 0.1, "tolerance": None}
    made = [
        trial(n, features=[{**feature, "simulated": 0.5 + n}] * 8, residuals=np.arange(1000.0) + n) for n in range(40)
    ]

    def held_memory(number, attempt):
        tracemalloc.start()
        with Store(tmp_path / f"{number} {attempt}", view=None) as store:
            store.open(HEADER)
            held = [store.append(one) for one in made[:number]]
            assert [list(one.features) for one in held] == [one.features for one in made[:number]]
            assert all(np.array_equal(a.residuals, b.residuals) for a, b in zip(held, made, strict=False))
            gc.collect()
            return tracemalloc.get_traced_memory()[0]

    held_memory(1, 0)
    differences = [held_memory(40, attempt) - held_memory(20, attempt) for attempt in range(3)]
    tracemalloc.stop()
    # the least: threads of other tests in this process allocate too
    assert min(differences) / 20 < 0.4 * made[0].residuals.nbytes


def test_stored_residuals_outlive_their_store_and_are_pickled_as_numbers(tmp_path):
    with Store(tmp_path, view=None) as store:
        store.open(HEADER)
        logged = store.append(trial(3))
    assert np.array_equal(logged.residuals, trial(3).residuals)
    assert np.array_equal(pickle.loads(pickle.dumps(logged)).residuals, trial(3).residuals)
    assert replace(logged, cost=1.0).residuals.tolist() == trial(3).residuals.tolist()


# ---- the Optuna view


def viewed(folder, view="journal", name="demo"):
    return optuna.load_study(study_name=name, storage=storage(folder, view)).trials


def test_the_view_shows_every_trial_with_its_parameters_and_outcome(tmp_path):
    written = [trial(0), failed(1), trial(2)]
    filled(tmp_path, written, view="journal")
    shown = viewed(tmp_path)
    assert [t.state.name for t in shown] == ["COMPLETE", "FAIL", "COMPLETE"]
    assert [t.value for t in shown] == [1.0, None, trial(2).cost]
    assert shown[0].params == {name: trial(0).values[name] for name in WINDOWS}
    assert shown[0].distributions["x"] == optuna.distributions.FloatDistribution(0.1, 2.0, log=True)
    assert shown[0].user_attrs["terms"] == {"curve": 1.0}
    assert {k: shown[1].user_attrs[k] for k in ("number", "status", "reason", "kind", "seconds")} == {
        "number": 1, "status": "diverged", "reason": "x is above 1.5", "kind": None, "seconds": 0.25,
    }  # fmt: skip


def test_a_view_that_lags_or_is_lost_is_rebuilt_from_the_ledger(tmp_path):
    filled(tmp_path, [trial(0), trial(1)], view=None)
    filled(tmp_path, [trial(2)], view="journal")
    assert [t.user_attrs["number"] for t in viewed(tmp_path)] == [0, 1, 2]
    (tmp_path / "optuna.log").unlink()
    filled(tmp_path, [], view="journal")
    assert [t.user_attrs["number"] for t in viewed(tmp_path)] == [0, 1, 2]


def test_a_torn_journal_is_mended_before_it_is_written_to(tmp_path):
    filled(tmp_path, [trial(n) for n in range(4)], view="journal")
    raw = (tmp_path / "optuna.log").read_bytes()
    last = raw[:-1].rfind(b"\n") + 1
    for size in range(last - 1, len(raw), 23):
        (tmp_path / "optuna.log").write_bytes(raw[:size])
        filled(tmp_path, [], view="journal")
        assert [t.user_attrs["number"] for t in viewed(tmp_path)] == [0, 1, 2, 3]


def test_a_damaged_journal_is_set_aside_and_made_anew(tmp_path):
    filled(tmp_path, [trial(0), trial(1)], view="journal")
    raw = (tmp_path / "optuna.log").read_bytes()
    (tmp_path / "optuna.log").write_bytes(raw.replace(b'"op_code"', b'"op_c', 1))
    with pytest.warns(UserWarning, match="damaged"):
        filled(tmp_path, [trial(2)], view="journal")
    assert len(viewed(tmp_path)) == 3
    assert (tmp_path / "optuna.log.damaged").exists()


@pytest.mark.parametrize("age", [0.0, 3600.0, -3600.0])
def test_the_lock_of_a_killed_writer_does_not_hold_the_study_up_wherever_the_clock_is_set(tmp_path, age):
    filled(tmp_path, [trial(0)], view="journal")
    lock = tmp_path / "optuna.log.lock"
    os.symlink(tmp_path / "optuna.log", lock)
    os.utime(lock, 2 * (time.time() - age,), follow_symlinks=False)
    start = os.times().elapsed
    filled(tmp_path, [trial(1)], view="journal")
    assert os.times().elapsed - start < 20.0  # s; optuna itself waits 30
    assert len(viewed(tmp_path)) == 2


def test_a_trial_left_running_is_failed_on_start(tmp_path):
    filled(tmp_path, [trial(0)], view="journal")
    optuna.load_study(study_name="demo", storage=storage(tmp_path)).ask()
    filled(tmp_path, [], view="journal")
    assert [t.state.name for t in viewed(tmp_path)] == ["COMPLETE", "FAIL"]


def test_a_database_may_hold_the_view_of_several_studies_of_one_name(tmp_path):
    url = f"sqlite:///{tmp_path}/all.db"
    filled(tmp_path / "one", [trial(0)], view=url)
    filled(tmp_path / "two", [trial(0), trial(1)], view=url)
    names = sorted(optuna.get_all_study_names(storage(tmp_path, url)))
    assert names[0] == "demo"
    assert names[1].startswith("demo ")
    assert len(viewed(tmp_path, url)) == 1
    assert len(viewed(tmp_path, url, names[1])) == 2


def test_a_study_goes_on_without_its_view(tmp_path):
    with pytest.warns(UserWarning, match="the study goes on without it, the ledger has all trials"):
        filled(tmp_path, [trial(0)], view=f"sqlite:///{tmp_path}/no/such/folder/all.db")
    assert len(read(tmp_path)[1]) == 1


def test_a_password_in_the_address_of_a_view_is_not_told(tmp_path):
    with pytest.warns(UserWarning, match="the Optuna view") as told:
        filled(tmp_path, [trial(0)], view="nonsense://me:secret@nowhere/all")
    assert "secret" not in str(told[0].message)


def test_a_view_that_fails_to_the_end_is_said_once_and_mended_at_the_next_opening(tmp_path, monkeypatch):
    def locked(*_):
        raise TimeoutError("database is locked")

    with monkeypatch.context() as patch:
        patch.setattr(optuna.storages.JournalStorage, "create_new_trial", locked)
        with pytest.warns(UserWarning, match="TimeoutError: database is locked") as told:
            filled(tmp_path, [trial(0), trial(1)], view="journal")
    assert len(told) == 1
    filled(tmp_path, [], view="journal")
    assert [t.user_attrs["number"] for t in viewed(tmp_path)] == [0, 1]


def test_a_view_is_mended_while_the_study_goes_on(tmp_path, monkeypatch):
    monkeypatch.setattr(mirror, "FIRST_PAUSE", 0.01)
    create, failures = optuna.storages.JournalStorage.create_new_trial, iter(["locked", "gone"])

    def troubled(*arguments):
        if (why := next(failures, None)) is not None:
            raise OSError(why)
        return create(*arguments)

    monkeypatch.setattr(optuna.storages.JournalStorage, "create_new_trial", troubled)
    with pytest.warns(UserWarning, match="OSError: locked") as told:
        filled(tmp_path, [trial(n) for n in range(5)], view="journal")
    assert len(told) == 1
    assert [t.user_attrs["number"] for t in viewed(tmp_path)] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("damage", ["another value", "a trial twice"])
def test_a_view_that_contradicts_the_ledger_is_made_anew(tmp_path, damage):
    filled(tmp_path, [trial(0), trial(1)], view="journal")
    lines = (tmp_path / "optuna.log").read_text().splitlines(keepends=True)
    lines[-1] = lines[-1].replace('"value":0.5', '"value":0.25') if damage == "another value" else lines[-2]
    (tmp_path / "optuna.log").write_text("".join(lines))
    for number in (2, 3):
        filled(tmp_path, [trial(number)], view="journal")
        assert [t.value for t in viewed(tmp_path)] == [trial(n).cost for n in range(number + 1)]


def test_the_picture_of_a_kept_trial_is_an_artifact_that_optuna_finds(tmp_path):
    filled(tmp_path, [trial(0), trial(1, 2.0), failed(2)], view="journal", picture=picture)
    shown = viewed(tmp_path)
    metas = [optuna.artifacts.get_all_artifact_meta(t, storage=storage(tmp_path)) for t in shown]
    assert [len(m) for m in metas] == [1, 0, 0]
    assert (metas[0][0].mimetype, metas[0][0].filename) == ("image/png", "000000.png")
    optuna.artifacts.download_artifact(
        artifact_store=optuna.artifacts.FileSystemArtifactStore(tmp_path / "artifacts"),
        file_path=str(tmp_path / "got.png"),
        artifact_id=metas[0][0].artifact_id,
    )
    assert (tmp_path / "got.png").read_bytes() == picture(None, None)


def test_the_dashboard_serves_the_picture(tmp_path):
    from optuna_dashboard import wsgi

    filled(tmp_path, [trial(0)], view="journal", picture=picture)
    artifacts = optuna.artifacts.FileSystemArtifactStore(tmp_path / "artifacts")
    app = wsgi(storage(tmp_path), artifact_store=artifacts)
    (meta,) = optuna.artifacts.get_all_artifact_meta(viewed(tmp_path)[0], storage=storage(tmp_path))
    told = {}
    path = f"/artifacts/0/0/{meta.artifact_id}"
    environ = {"REQUEST_METHOD": "GET", "PATH_INFO": path, "SERVER_NAME": "x", "SERVER_PORT": "80", "wsgi.input": None}
    with closing(app(environ, lambda status, headers, *_: told.update(status=status, headers=dict(headers)))) as answer:
        body = b"".join(answer)
    assert told["status"].startswith("200")
    assert told["headers"]["Content-Type"] == "image/png"
    assert body == picture(None, None)


def test_pictures_lost_with_the_view_are_drawn_again_from_the_kept_records(tmp_path):
    filled(tmp_path, [trial(0), trial(1)], view=None)
    drawn = []
    filled(tmp_path, [], view="journal", picture=lambda one, kept: drawn.append((one.number, list(kept))) or b"png")
    assert drawn == [(0, ["clapping"]), (1, ["clapping"])]


def test_a_picture_that_fails_costs_a_warning(tmp_path):
    def clumsy(trial, records):
        raise ValueError("no such axis")

    with pytest.warns(UserWarning, match="no picture of trial 0: ValueError: no such axis"):
        filled(tmp_path, [trial(0)], view="journal", picture=clumsy)
    assert len(viewed(tmp_path)) == 1
