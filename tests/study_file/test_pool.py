"""Where the evaluations of a study run: [pool], its short form, and what takes its place."""

import pytest
from echo_study import write_study

import calib
from calib import records
from calib.cli.options import pool_table
from calib.errors import CalibError
from calib.study_file import load

DASK = '[pool]\nkind = "dask"\nscheduler = "tcp://host:8786"\n'


def stated(folder, pool, *changes):
    return load(write_study(folder, ("[model]", f"{pool}\n[model]"), *changes)).study


def test_without_a_table_it_is_the_jobs_of_the_study(tmp_path):
    study = load(write_study(tmp_path, ("jobs = 1", "jobs = 3"))).study
    assert (study.evaluated_by.kind, study.evaluated_by.jobs, study.jobs) == ("local", 3, 3)


def test_a_table_says_kind_jobs_and_memory(tmp_path):
    study = stated(tmp_path, '[pool]\njobs = 4\nmemory = "2 GB"', ("jobs = 1\n", ""))
    assert (study.evaluated_by.jobs, study.jobs, study.evaluated_by.memory) == (4, 4, 2e9)


def test_two_numbers_of_jobs_that_differ_are_refused(tmp_path):
    with pytest.raises(CalibError, match=r"study.toml:\d+: pool.jobs: expected 1, as .study. jobs says, got 4"):
        stated(tmp_path, "[pool]\njobs = 4")
    assert stated(tmp_path, "[pool]\njobs = 1").jobs == 1


def test_the_jobs_of_the_study_are_those_of_this_machine_beside_workers_elsewhere(tmp_path):
    study = stated(tmp_path, DASK, ("jobs = 1", "jobs = 2"))
    assert (study.evaluated_by.scheduler, study.evaluated_by.jobs, study.jobs) == ("tcp://host:8786", None, 2)


@pytest.mark.parametrize(
    ("pool", "message"),
    [
        ('[pool]\nkind = "dask"', r"study.toml:\d+: pool: kind = \"dask\" needs scheduler or cluster"),
        ('[pool]\nkind = "dusk"', r"pool.kind: expected .* got 'dusk' .did you mean 'dask'"),
        ('[pool]\nmemory = "2 m"', r"pool.memory: .*m"),
        ('[pool]\nmemory = "0 GB"', "pool.memory: expected a size above 0 bytes"),
        ('[pool]\nschedular = "tcp://a:1"', "unknown key .did you mean 'scheduler'"),
    ],
)
def test_a_mistake_is_told_at_its_key(pool, message, tmp_path):
    with pytest.raises(CalibError, match=message):
        stated(tmp_path, pool)


def test_the_pool_is_no_part_of_the_study(tmp_path):
    assert stated(tmp_path, DASK).header.definition == load(write_study(tmp_path)).study.header.definition


@pytest.mark.parametrize(
    ("text", "table"),
    [
        (None, None),
        ("local", {"kind": "local"}),
        ("local,memory=2 GB,jobs=3", {"kind": "local", "memory": "2 GB", "jobs": 3}),
        ("dask:tcp://host:8786", {"kind": "dask", "scheduler": "tcp://host:8786"}),
        (
            "dask:distributed:LocalCluster,n_workers=2",
            {"kind": "dask", "cluster": "distributed:LocalCluster", "options": {"n_workers": 2}},
        ),
        (
            "executor:executorlib:SingleNodeExecutor,block_allocation=true",
            {
                "kind": "executor",
                "executor": "executorlib:SingleNodeExecutor",
                "options": {"block_allocation": True},
            },
        ),
    ],
)
def test_an_option_of_the_command_line_is_a_table(text, table):
    assert pool_table(text) == table


def test_what_is_given_takes_the_place_of_the_file_s(tmp_path):
    path = write_study(tmp_path, ("[model]", f"{DASK}[model]"), ("jobs = 1", "jobs = 2"))
    assert load(path, pool={"kind": "local"}).study.evaluated_by.jobs == 2
    assert load(path, pool=pool_table("dask:tcp://other:1"), jobs=7).study.evaluated_by.jobs == 7
    with pytest.raises(CalibError, match="--pool: expected NAME=VALUE behind a comma, got '4'"):
        pool_table("local,4")
    with pytest.raises(CalibError, match="the pool:.*unknown key|the pool.*options"):
        load(path, pool=pool_table("local,max_workers=2"))


def test_a_study_from_python_states_its_pool(tmp_path):
    write_study(tmp_path)
    record = calib.Record(records.read(tmp_path / "bench.nc"), "bench")
    study = calib.Study("tiny_simulators:Echo", [record], {"gain": (0.5, 2.0)}, pool={"kind": "local", "jobs": 3})
    assert study.document["pool"] == {"kind": "local", "jobs": 3}
    assert load(study.save(tmp_path / "saved")).study.jobs == 3
