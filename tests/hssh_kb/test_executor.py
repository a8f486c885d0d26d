"""Tasks in processes and on a local Dask cluster: order, faults, deaths, determinism."""

import json
import os
import signal
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import pytest

from hssh_kb.build_many import BuildTask, build_many, build_one
from hssh_kb.errors import InputError, InternalError, UsageError
from hssh_kb.executor import open_executor, run_tasks
from hssh_kb.kb import KnowledgeBase

TRACES = sorted((Path(__file__).resolve().parents[1] / "traces").glob("*.json"))


def square(number):
    return number * number


def sleep_then_tell(seconds):
    time.sleep(seconds)
    return seconds


def fail_on_odd(number):
    if number % 4 == 1:
        raise InputError(f"{number}: is odd")
    if number % 4 == 3:
        raise ZeroDivisionError("by far")
    return number


def die_on_three(number):
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def test_answers_come_in_the_order_of_the_tasks():
    ended = []
    outcomes = run_tasks(
        sleep_then_tell, [0.6, 0.0], jobs=2, finished=lambda i, outcome: ended.append(i)
    )
    assert [outcome.answer for outcome in outcomes] == [0.6, 0.0]
    assert sorted(ended) == [0, 1]


def test_a_fault_stops_no_other_task():
    outcomes = run_tasks(fail_on_odd, range(4), jobs=2)
    assert [outcome.answer for outcome in outcomes] == [0, None, 2, None]
    assert str(outcomes[1].error) == "1: is odd"
    assert isinstance(outcomes[1].error, InputError)
    assert isinstance(outcomes[3].error, InternalError)
    assert "ZeroDivisionError: by far" in str(outcomes[3].error)


@pytest.mark.skipif(os.name != "posix", reason="kills a process the POSIX way")
def test_a_process_that_dies_takes_no_other_task_with_it():
    outcomes = run_tasks(die_on_three, range(5), jobs=2)
    assert [outcome.answer for outcome in outcomes] == [0, 1, 2, None, 4]
    assert "died" in str(outcomes[3].error)


def count_threads(_):
    import cv2

    return cv2.getNumThreads()


def test_processes_use_one_thread_each():
    assert [outcome.answer for outcome in run_tasks(count_threads, [0])] == [1]


def test_executors_that_are_none():
    with pytest.raises(UsageError, match="no executor 'threads'"), open_executor("threads"):
        pass
    with open_executor("processes", jobs=1) as executor:
        assert isinstance(executor, ProcessPoolExecutor)


def test_no_dask_is_told(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with (
        pytest.raises(UsageError, match=r"install 'hssh\[dask\]'"),
        open_executor("dask:tcp://127.0.0.1:1"),
    ):
        pass


def build_all(folder, **keywords):
    folder.mkdir()
    tasks = [BuildTask(path, folder / f"{path.stem}.hssh", {"best": 3}) for path in TRACES]
    return build_many(tasks, **keywords)


def gather(built):
    """What was built, without times."""
    documents = []
    for one in built:
        kb = KnowledgeBase.open(one.task.target)
        document = {k: v for k, v in one.document.items() if k not in {"seconds", "kb"}}
        documents.append((json.dumps(document), kb.hypotheses))
    return documents


def test_the_same_answers_whatever_the_number_of_processes(tmp_path):
    one = gather(build_all(tmp_path / "one", jobs=1))
    assert gather(build_all(tmp_path / "two", jobs=2)) == one
    here = [build_one(BuildTask(path, tmp_path / "x.hssh", {"best": 3})) for path in TRACES]
    assert [json.loads(text) for text, _ in one] == [
        {k: v for k, v in json.loads(json.dumps(document)).items() if k not in {"seconds", "kb"}}
        for document in here
    ]


def test_progress_is_reported_for_each_input(tmp_path):
    seen = []
    build_all(tmp_path / "kbs", jobs=1, report=lambda name, done, total: seen.append((name, done)))
    assert {name for name, done in seen if done == 100} == {path.name for path in TRACES}


def test_two_inputs_for_one_file_are_refused(tmp_path):
    tasks = [BuildTask(path, tmp_path / "x.hssh") for path in TRACES[:2]]
    with pytest.raises(UsageError, match="would both be written"):
        build_many(tasks)
    assert not (tmp_path / "x.hssh").exists()


@pytest.fixture(scope="module")
def cluster():
    """A Dask cluster of two processes on this machine."""
    distributed = pytest.importorskip(
        "distributed", reason="the extra 'dask' is not installed: no cluster to test against"
    )
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, processes=True
    ) as running:
        yield f"dask:{running.scheduler_address}"


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_a_dask_cluster_gives_the_same_answers(cluster, tmp_path):
    outcomes = run_tasks(json.dumps, [1, 2, 2], where=cluster)
    assert [outcome.answer for outcome in outcomes] == ["1", "2", "2"]
    for text, maps in gather(build_all(tmp_path / "far", where=cluster)):
        document = json.loads(text)
        kb = KnowledgeBase.build(document["source"], best=3)
        assert kb.hypotheses == maps
        assert len(kb.experience) == document["visits"]


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_faults_on_a_cluster_stop_no_other_task(cluster, tmp_path):
    tasks = [
        BuildTask(TRACES[0], tmp_path / "a.hssh"),
        BuildTask(tmp_path / "missing.json", tmp_path / "b.hssh"),
    ]
    good, bad = build_many(tasks, where=cluster)
    assert good.error is None
    assert (tmp_path / "a.hssh").is_file()
    assert "no such file" in str(bad.error)


def test_no_scheduler_at_the_address():
    pytest.importorskip("distributed", reason="the extra 'dask' is not installed")
    with pytest.raises(UsageError, match="lacks the address"), open_executor("dask:"):
        pass
    with (
        pytest.raises(InputError, match="no Dask scheduler answers at 'no such'"),
        open_executor("dask:no such"),
    ):
        pass
