"""Tasks shared with a second process."""

from __future__ import annotations

import math
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Lock
from typing import Any

import pytest
from shared_tasks import after, printed, sooner_in
from small_job import write_job

from maskfab.base.errors import InternalError, JobError
from maskfab.base.processes import ProcessExecutor, SerialExecutor, Task, read_only
from maskfab.camera.lens import lattice
from maskfab.mask.job import load_job
from maskfab.runs import pipeline


@pytest.fixture(scope="module", autouse=True)
def importable() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(Path(__file__).parents[1]), prepend=os.pathsep)
        yield


@pytest.fixture(scope="module")
def pair() -> Iterator[ProcessExecutor]:
    with ProcessExecutor() as executor:
        yield executor


def given(*arguments: Any) -> Callable[[], tuple[Any, ...]]:
    return lambda: arguments


def done_there(task: Task[Any]) -> Task[Any]:
    """The task once the second process has ended it, which nobody has asked for yet."""
    for _ in range(6000):
        if task.ended:
            return task
        time.sleep(0.01)
    raise TimeoutError


def test_what_is_submitted_is_done_by_another_process_while_this_one_goes_on(pair):
    assert done_there(pair.submit(os.getpid, given())).result() != os.getpid()
    assert SerialExecutor().submit(os.getpid, given()).result() == os.getpid()


@pytest.mark.parametrize("slow", [0, 2, 5])
def test_results_keep_the_order_of_calls_whichever_takes_longest(pair, slow):
    calls = [(after, given(0.3 * (number == slow), number)) for number in range(6)]
    told: list[int] = []
    tasks = pair.run_all(calls, told.append)
    assert [task.result() for task in tasks] == list(range(6))
    assert tasks[slow].seconds >= 0.3
    assert told == sorted(told)
    assert told[-1] == 6


def test_a_result_can_be_asked_for_again_and_is_not_made_again(pair):
    for executor in (pair, SerialExecutor()):
        task = executor.submit(read_only, given({"number": 1}))
        assert task.result() is task.result()


def test_a_coded_error_is_the_same_from_either_process(pair):
    with pytest.raises(JobError) as here:
        SerialExecutor().submit(lattice, given(0)).result()
    task = done_there(pair.submit(lattice, given(0)))
    for _ in range(2):
        with pytest.raises(JobError) as there:
            task.result()
        assert (str(there.value), there.value.code, there.value.cure) == (str(here.value), "MF104", here.value.cure)


def test_the_first_error_in_order_is_told_though_another_comes_sooner(pair):
    calls: list[tuple[Callable[..., Any], Any]] = [
        (after, given(0.3, 0)), (math.sqrt, given(-1.0)), (after, given(0.0, 2)), (lattice, given(0)),
    ]  # fmt: skip
    for executor in (pair, SerialExecutor()):
        with pytest.raises(ValueError, match="math domain error"):
            executor.run_all(calls)


def test_prints_of_a_task_harm_nothing(pair):
    assert done_there(pair.submit(printed, given(3))).result() == 3


def test_what_cannot_be_sent_is_done_here(pair):
    lock = Lock()
    assert [task.result() for task in pair.run_all([(id, given(lock))] * 3)] == [id(lock)] * 3


def test_a_process_that_ends_is_told_and_the_rest_is_done_here():
    with ProcessExecutor() as executor:
        fatal = executor.submit(os._exit, given(3))
        done_there(fatal)
        with pytest.raises(InternalError, match="MF901 another process ended with nothing"):
            fatal.result()
        assert [task.result() for task in executor.run_all([(os.getpid, given())] * 3)] == [os.getpid()] * 3


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("number", ["SIGKILL", "SIGTERM"])
def test_the_task_of_a_process_that_somebody_kills_is_done_here(number):
    with ProcessExecutor() as executor:
        task = executor.submit(sooner_in, given(os.getpid()))
        while executor._waiting:
            time.sleep(0.01)
        executor._processes[0]._process.send_signal(getattr(signal, number))
        assert task.result() == os.getpid()
        assert [each.result() for each in executor.run_all([(os.getpid, given())] * 3)] == [os.getpid()] * 3


def test_nobody_is_waited_for_when_the_work_is_given_up():
    start = time.monotonic()
    with ProcessExecutor() as executor:
        executor.submit(time.sleep, given(600))
        time.sleep(0.1)
    assert time.monotonic() - start < 60
    assert [other._process.poll() is not None for other in executor._processes] == [True]


def test_a_second_process_is_started_for_many_dies_on_two_processors(tmp_path, monkeypatch):
    few = load_job(write_job(tmp_path))
    many = few.__class__(few.spec.model_copy(update={"die": few.spec.die * 4}), few.openings, few.digest, few.where)
    for processors, job, kind in (
        (2, many, ProcessExecutor),
        (1, many, SerialExecutor),
        (None, many, SerialExecutor),
        (2, few, SerialExecutor),
    ):
        monkeypatch.setattr(os, "cpu_count", lambda count=processors: count)
        assert type(pipeline.executor_of(job)) is kind
