"""PostgreSQL holds the views of many studies; the ledger is the truth, and the views are made good."""

import json
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from collections import Counter
from contextlib import ExitStack
from pathlib import Path

import optuna
import pytest
from child_environment import environment
from echo_study import write_study
from postgresql import ESCAPED, PASSWORD, Server, wait_until
from store_samples import HEADER, failed, filled, picture, trial

from calib.cli.dashboard import application
from calib.errors import CalibError
from calib.store import Store, database, mirror, read
from calib.store.database import connected
from calib.store.optuna_view import storage


@pytest.fixture(scope="module")
def server():
    # not in pytest's folder, which other accounts than that of the tests cannot enter
    with tempfile.TemporaryDirectory(prefix="calib-postgresql-") as folder:
        server = Server(Path(folder))
        yield server
        server.kill()


@pytest.fixture
def url(server, request):
    """Address of an empty database."""
    name = request.node.name[:60]
    server.execute(f'DROP DATABASE IF EXISTS "{name}"')
    return server.create(name)


@pytest.fixture(autouse=True)
def busy_machine(monkeypatch):
    """A server that shares its cores with many others is slow to answer."""
    monkeypatch.setattr(database, "CONNECT_TIMEOUT", 60)


@pytest.fixture
def impatient(monkeypatch):
    """A view that failed is tried again at once."""
    monkeypatch.setattr(mirror, "FIRST_PAUSE", 0.05)
    monkeypatch.setattr(mirror, "MAX_PAUSE", 0.2)


def view(url, name="demo"):
    """Trials of a study in the view, as Optuna reads them."""
    return optuna.load_study(study_name=name, storage=connected(url, skip_table_creation=True)).trials


def shown(url, name="demo"):
    """State and value of each trial of a study in the view, by number; each is there once."""
    trials = view(url, name)
    assert set(Counter(one.user_attrs["number"] for one in trials).values()) <= {1}
    assert [one.number for one in trials] == list(range(len(trials)))
    return {one.user_attrs["number"]: (one.state.name, one.value) for one in trials}


def is_begun(url, name="demo"):
    """Whether the view has a trial of a study."""
    try:
        return bool(shown(url, name))
    except (CalibError, KeyError):  # no tables yet, or no study
        return False


def expected(folder):
    """The same, as the ledger has it."""
    return {one.number: ("COMPLETE", one.cost) if one.scored else ("FAIL", None) for one in read(folder)[1]}


def names(url):
    return sorted(study.study_name for study in connected(url, skip_table_creation=True).get_all_studies())


def test_the_view_shows_every_trial_as_optuna_itself_would_write_it(tmp_path, url):
    filled(tmp_path, [trial(0), failed(1), trial(2, 1e-300)], view=url, picture=picture)
    assert shown(url) == expected(tmp_path)
    filled(tmp_path / "journal", [trial(0), failed(1), trial(2, 1e-300)], view="journal", picture=picture)
    journal = optuna.load_study(study_name="demo", storage=storage(tmp_path / "journal")).trials
    for one, other in zip(view(url), journal, strict=True):
        for kind in ("number", "state", "value", "params", "distributions", "user_attrs"):
            assert getattr(one, kind) == getattr(other, kind)
        assert abs(one.duration - other.duration).total_seconds() < 1e-3
        assert len(one.system_attrs) == len(other.system_attrs) == (one.value is not None)


def test_several_studies_fill_an_empty_database_at_once_and_the_dashboard_shows_all(tmp_path, url):
    with ExitStack() as stack:
        stores = [stack.enter_context(Store(tmp_path / str(index), url)) for index in range(3)]
        for store in stores:
            store.open(HEADER)
        for number in range(6):
            for index, store in enumerate(stores):
                store.append(trial(number, 1.0 + index + number))
    told = {}
    [body] = application(url)(
        {"PATH_INFO": "/api/studies", "REQUEST_METHOD": "GET", "HTTP_HOST": "localhost", "wsgi.input": None,
         "SERVER_NAME": "localhost", "SERVER_PORT": "80"},
        lambda status, headers, *_: told.update(status=status),
    )  # fmt: skip
    listed = sorted(study["study_name"] for study in json.loads(body)["study_summaries"])
    assert listed == names(url)
    assert len(listed) == 3
    assert listed[0] == "demo"
    assert all(name.startswith("demo ") for name in listed[1:])
    costs = sorted(min(value for _, value in shown(url, name).values()) for name in listed)
    assert costs == [1.0, 2.0, 3.0]
    assert all(len(shown(url, name)) == 6 for name in listed)


def test_a_database_without_a_view_is_said(url):
    with pytest.raises(CalibError, match="no view there yet; `calib run` makes it with the first trial"):
        application(url)


@pytest.mark.slow
@pytest.mark.usefixtures("impatient")
def test_a_server_killed_and_restarted_in_the_middle_has_all_trials_in_the_end(tmp_path, server, url):
    store = Store(tmp_path, url)
    store.open(HEADER)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        for number in range(30):
            if number in (5, 20):
                wait_until(lambda: is_begun(url))
                server.kill()
            store.append(trial(number) if number % 7 else failed(number))
            if number in (10, 25):
                server.start()
        store.close()
    assert [str(one.message) for one in told if "the Optuna view" in str(one.message)][1:] == []
    assert len(shown(url)) == 30
    assert shown(url) == expected(tmp_path)


@pytest.mark.usefixtures("impatient")
def test_a_server_that_is_absent_at_first_is_said_once_and_made_good_in_the_end(tmp_path, server, url):
    server.kill()

    def run():
        with Store(tmp_path, url) as store:
            store.open(HEADER)
            for number in range(5):
                store.append(trial(number))
                time.sleep(0.1)
            server.start()

    with pytest.warns(UserWarning, match="connection failed.*the ledger has all trials") as told:
        run()
    assert len(told) == 1
    assert shown(url) == expected(tmp_path)


@pytest.mark.usefixtures("impatient")
def test_a_server_that_stays_away_is_made_good_at_the_next_opening(tmp_path, server, url):
    server.kill()
    try:
        with pytest.warns(UserWarning, match="when the study is next opened"):
            filled(tmp_path, [trial(0), failed(1)], view=url)
    finally:
        server.start()
    filled(tmp_path, [trial(2)], view=url)
    assert shown(url) == expected(tmp_path)
    assert len(shown(url)) == 3


def test_a_server_that_hangs_holds_no_study_up(tmp_path, server, url, monkeypatch):
    monkeypatch.setattr(mirror, "MAX_SILENCE", 1.0)
    store = Store(tmp_path, url)
    store.open(HEADER)
    store.append(trial(0))
    wait_until(lambda: is_begun(url))
    server.signal(signal.SIGSTOP)
    try:
        begin = time.monotonic()
        for number in range(1, 100):
            store.append(trial(number))
        assert time.monotonic() - begin < 30.0  # s; a trial that waited for the server would wait for ever
        with pytest.warns(UserWarning, match="no answer within 1 s"):
            store.close()
    finally:
        server.signal(signal.SIGCONT)
    filled(tmp_path, [], view=url)
    assert shown(url) == expected(tmp_path)


def test_what_contradicts_the_ledger_is_made_anew(tmp_path, server, url):
    filled(tmp_path, [trial(0), trial(1)], view=url)
    server.execute("UPDATE trial_values SET value = 7.0 WHERE trial_id = 1", url.rpartition("/")[2])
    filled(tmp_path, [trial(2)], view=url)
    assert shown(url) == expected(tmp_path)
    assert len(shown(url)) == 3
    filled(tmp_path, [], view=url)
    assert names(url) == ["demo"]


def test_a_trial_that_a_killed_process_left_running_is_failed(tmp_path, url):
    filled(tmp_path, [trial(0)], view=url)
    optuna.load_study(study_name="demo", storage=connected(url)).ask()
    filled(tmp_path, [trial(1)], view=url)
    states = [one.state.name for one in view(url)]
    assert states == ["COMPLETE", "FAIL", "COMPLETE"]


def test_a_folder_that_was_copied_has_a_mirror_of_its_own(tmp_path, url):
    filled(tmp_path / "one", [trial(0)], view=url)
    shutil.copytree(tmp_path / "one", tmp_path / "two")
    filled(tmp_path / "two", [trial(1, 5.0)], view=url)
    filled(tmp_path / "one", [trial(1, 3.0)], view=url)
    assert shown(url) == expected(tmp_path / "one")
    [copy] = [name for name in names(url) if name != "demo"]
    assert shown(url, copy) == expected(tmp_path / "two")


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda url: url.replace(ESCAPED, "wr0ng/w0rd"), "password authentication failed"),
        (lambda url: url.replace(ESCAPED, PASSWORD), "failed to resolve host"),
        (lambda url: url.replace(ESCAPED, "wr0ng{w0rd}"), "password authentication failed"),
        (lambda url: url + "_of_nobody", "does not exist"),
        (lambda url: url.replace("+psycopg", "+asyncpg"), r'pip install "calib\[postgresql\]"'),
    ],
)
def test_a_mistake_in_the_address_is_said_without_the_password(tmp_path, url, change, said):
    address = change(url)
    with pytest.warns(UserWarning, match=said) as told:
        filled(tmp_path, [trial(0)], view=address)
    with pytest.raises(CalibError, match=said) as refused:
        application(address)
    for text in (str(told[0].message), str(refused.value)):
        assert ":***@" in text
        assert not any(piece in text for piece in ("s3cr3t", "p@ss", "p%40ss", "wr0ng", "w0rd"))
    assert len(read(tmp_path)[1]) == 1


def test_a_missing_driver_is_said_with_its_remedy(tmp_path, server, monkeypatch):
    monkeypatch.setitem(sys.modules, "psycopg", None)
    with pytest.warns(UserWarning, match=r'pip install "calib\[postgresql\]".*postgresql\+psycopg://'):
        filled(tmp_path, [trial(0)], view=server.url())


def test_nothing_of_a_view_outlives_its_store(tmp_path, server, url):
    before = set(threading.enumerate())
    filled(tmp_path, [trial(0)], view=url)
    assert set(threading.enumerate()) == before
    database = url.rpartition("/")[2]
    wait_until(lambda: server.execute(f"SELECT count(*) FROM pg_stat_activity WHERE datname = '{database}'") == [(0,)])
    for path in tmp_path.rglob("*"):
        assert path.is_dir() or not any(secret.encode() in path.read_bytes() for secret in (PASSWORD, ESCAPED))


@pytest.mark.slow
def test_two_runs_share_a_database_whose_server_is_killed_and_started_again(tmp_path, server, url):
    homes = []
    for name in ("one", "two"):
        folder = tmp_path / name
        folder.mkdir()
        stored = ("[optimiser]", f'[store]\nview = "{url}"\n\n[optimiser]')
        write_study(folder, ("budget = 24", "budget = 150"), stored)
        homes.append(folder)
    runs = [
        subprocess.Popen(
            [sys.executable, "-m", "calib", "run", str(home)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True, env=environment(),
        )
        for home in homes
    ]  # fmt: skip
    wait_until(lambda: is_begun(url, "echo") and len(names(url)) == 2, 400.0)
    server.kill()
    time.sleep(3.0)
    server.start()
    said = [run.communicate(timeout=600.0)[0] for run in runs]
    assert [run.returncode for run in runs] == [0, 0]
    for home in homes:  # a run that ended while the server was away is made good by the next
        subprocess.run([sys.executable, "-m", "calib", "run", "--quiet", str(home)], check=True, env=environment())
    mirrored = [shown(url, name) for name in names(url)]
    for home, text in zip(homes, said, strict=True):
        assert expected(home / "out") in mirrored
        assert text.count("the Optuna view (") <= 1
        subprocess.run([sys.executable, "-m", "calib", "status", str(home)], check=True, env=environment())
        told = [text.encode(), *(path.read_bytes() for path in (home / "out").rglob("*") if path.is_file())]
        assert not any(secret.encode() in content for content in told for secret in (PASSWORD, ESCAPED, "s3cr3t"))
