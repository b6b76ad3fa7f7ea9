"""Claims about the dashboard: it shows everything and changes nothing."""

import datetime
import io
import json
import re
import threading
import urllib.error
import urllib.request
from wsgiref.util import setup_testing_defaults

import optuna
import pytest
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend

from calib.cli.dashboard import application, plain_command, serve
from calib.errors import CalibError

optuna.logging.set_verbosity(optuna.logging.WARNING)


def ask(app, path, method="GET", host="127.0.0.1"):
    """Status, headers and body of one request."""
    environ = {"PATH_INFO": path, "REQUEST_METHOD": method, "HTTP_HOST": host, "wsgi.input": io.BytesIO(b"{}")}
    setup_testing_defaults(environ)
    answer = {}

    def start(status, headers, *_):
        answer.update(status=int(status.split()[0]), headers=dict(headers))

    body = app(environ, start)
    whole = b"".join(body)
    if hasattr(body, "close"):
        body.close()
    return answer["status"], answer["headers"], whole


def add(path, number):
    study = optuna.create_study(
        storage=JournalStorage(JournalFileBackend(str(path))), study_name="minimal", load_if_exists=True
    )
    study.optimize(lambda trial: trial.suggest_float("gap", 0.0, 1.0) ** 2, n_trials=number)


def trials(app, study_id=0):
    return json.loads(ask(app, f"/api/studies/{study_id}")[2])["trials"]


@pytest.fixture
def journal(tmp_path):
    path = tmp_path / "optuna.log"
    add(path, 3)
    return path


def test_a_study_and_its_trials_are_shown(journal):
    app = application(journal)
    assert ask(app, "/dashboard")[0] == 200
    (study,) = json.loads(ask(app, "/api/studies")[2])["study_summaries"]
    assert study["study_name"] == "minimal"
    assert len(trials(app)) == 3
    assert ask(app, "/dashboard", "HEAD")[0] == 200


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("POST", "/api/studies"),
        ("DELETE", "/api/studies/0"),
        ("PUT", "/api/studies/0/note"),
        ("POST", "/api/trials/0/tell"),
        ("PATCH", "/dashboard"),
    ],
)
def test_nothing_can_be_changed(journal, method, path):
    before = journal.read_bytes()
    status, headers, _ = ask(application(journal), path, method)
    assert status == 405
    assert headers["Allow"] == "GET, HEAD"
    assert journal.read_bytes() == before


@pytest.mark.parametrize("method", ["GET", "HEAD", "POST"])
@pytest.mark.parametrize(
    "host",
    ["evil.example", "evil.example:8080", "localhost.evil.example", "127.0.0.1.evil.example:80", "192.168.0.7:8080",
     "localhost:8080:80", "evil.example\xe9", "", "[::1", "0.0.0.0"],
)  # fmt: skip
def test_a_request_to_another_host_is_refused(journal, host, method):
    """So a page of the web that rebinds its own name to 127.0.0.1 reads nothing."""
    status, headers, text = ask(application(journal), "/api/studies", method, host)
    assert status == 403
    assert headers["Content-Type"] == "text/plain"
    assert b"answers only requests to localhost, 127.0.0.1, [::1]" in text
    assert b"minimal" not in text


@pytest.mark.parametrize("host", ["localhost", "LOCALHOST:9", "127.0.0.1:8080", "[::1]", "[::1]:8080"])
def test_a_request_to_this_machine_is_answered(journal, host):
    assert ask(application(journal), "/api/studies", host=host)[0] == 200


def test_showing_a_study_writes_no_file_and_takes_no_lock(journal):
    def times():
        return {p.name: p.stat().st_mtime_ns for p in (journal.parent, *journal.parent.iterdir())}

    before = times()  # a lock that came and went would have touched the folder
    trials(application(journal))
    assert times() == before


@pytest.fixture
def at_once(monkeypatch):
    """Let Optuna's dashboard look at the storage at every request."""
    monkeypatch.setattr("optuna_dashboard._storage.timedelta", lambda seconds: datetime.timedelta(0))


@pytest.mark.usefixtures("at_once")
def test_a_torn_last_line_is_left_for_later(journal):
    whole = journal.read_bytes()
    journal.write_bytes(whole[:-20])
    app = application(journal)
    assert len(trials(app)) == 3
    assert trials(app)[-1]["state"] == "Running"
    journal.write_bytes(whole)
    assert [trial["state"] for trial in trials(app)] == ["Complete"] * 3


def test_a_torn_line_that_a_later_writer_ended_is_skipped(journal):
    with open(journal, "ab") as file:
        file.write(b'{"op_code": 4, "worker\n')
    app = application(journal)
    assert len(trials(app)) == 3


@pytest.mark.usefixtures("at_once")
def test_a_running_study_is_followed(journal):
    app = application(journal)
    assert len(trials(app)) == 3
    add(journal, 2)
    assert len(trials(app)) == 5


def test_a_study_begun_afresh_takes_the_place_of_the_old_one(journal):
    app = application(journal)
    assert len(trials(app)) == 3
    journal.unlink()
    assert len(trials(app)) == 3
    add(journal, 1)
    assert len(trials(app)) == 1


def test_pictures_are_served(journal, tmp_path):
    folder = tmp_path / "artifacts"
    folder.mkdir()
    store = optuna.artifacts.FileSystemArtifactStore(folder)
    storage = JournalStorage(JournalFileBackend(str(journal)))
    (tmp_path / "a.png").write_bytes(b"\x89PNG picture")
    study = optuna.load_study(study_name="minimal", storage=storage)
    trial = study.ask()
    key = optuna.artifacts.upload_artifact(
        artifact_store=store, file_path=str(tmp_path / "a.png"), study_or_trial=trial
    )
    status, headers, body = ask(application(journal, folder), f"/artifacts/0/{trial._trial_id}/{key}")
    assert status == 200
    assert headers["Content-Type"] == "image/png"
    assert body == b"\x89PNG picture"


def test_a_database_is_shown_too(tmp_path):
    url = f"sqlite:///{tmp_path / 'view.db'}"
    study = optuna.create_study(storage=url, study_name="minimal")
    study.optimize(lambda trial: trial.suggest_float("gap", 0.0, 1.0), n_trials=2)
    assert len(trials(application(url), 1)) == 2


@pytest.mark.parametrize(
    ("prefix", "name", "missing"),
    [("", "optuna.log", "No such file or directory"), ("sqlite:///", "view.db", "no such file")],
)
def test_a_view_that_is_not_there_is_said(tmp_path, prefix, name, missing):
    path = str(tmp_path / name)
    with pytest.raises(CalibError, match=f"^{re.escape(path)}: {missing}; `calib run` makes it"):
        application(prefix + path)
    assert list(tmp_path.iterdir()) == []


def test_it_answers_on_loopback_and_says_where(journal):
    ready, address = threading.Event(), []

    def on_ready(url):
        address.append(url)
        ready.set()

    threading.Thread(target=serve, args=(journal,), kwargs={"port": 0, "on_ready": on_ready}, daemon=True).start()
    assert ready.wait(10.0)
    assert address[0].startswith("http://127.0.0.1:")
    with urllib.request.urlopen(address[0], timeout=10.0) as answer:
        assert b"Optuna Dashboard" in answer.read()
    with pytest.raises(urllib.error.HTTPError, match="405"):
        urllib.request.urlopen(address[0].replace("/dashboard", "/api/studies"), data=b"{}", timeout=10.0)
    port = int(address[0].split(":")[2].split("/")[0])
    with pytest.raises(CalibError, match="another with --port"):
        serve(journal, port=port)


def test_the_plain_command_names_file_and_pictures():
    assert plain_command("out/optuna.log", "out/arte facts") == (
        "optuna-dashboard out/optuna.log --artifact-dir 'out/arte facts'"
    )


def test_the_plain_command_tells_no_password():
    said = plain_command("postgresql+psycopg2://me:secret@server/lab")
    assert said == "optuna-dashboard 'postgresql+psycopg2://me:***@server/lab'"
