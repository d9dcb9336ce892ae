"""Tasks shared with other processes."""

from __future__ import annotations

import itertools
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
from shared_tasks import after, printed, written_down
from small_job import write_job

from maskfab.base import machine, workers
from maskfab.base.errors import InputError, InternalError, JobError
from maskfab.base.processes import ALONE, Call, ProcessExecutor, SerialExecutor, Task, read_only
from maskfab.base.workers import Workers
from maskfab.camera.stop_cells import lattice
from maskfab.mask.job import load_job
from maskfab.runs.stages import executor_of


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
    assert done_there(pair.submit(Call(os.getpid, given()))).result() != os.getpid()
    assert SerialExecutor().submit(Call(os.getpid, given())).result() == os.getpid()


@pytest.mark.parametrize("slow", [0, 2, 5])
def test_results_keep_the_order_of_calls_whichever_takes_longest(pair, slow):
    calls = [Call(after, given(0.3 * (number == slow), number)) for number in range(6)]
    told: list[int] = []
    tasks = pair.run_all(calls, told.append)
    assert [task.result() for task in tasks] == list(range(6))
    assert tasks[slow].seconds >= 0.3
    assert told == sorted(told)
    assert told[-1] == 6


def test_what_is_alike_is_shared_where_the_first_takes_long(pair, monkeypatch):
    calls = [Call(after, given(0.05, number)) for number in range(4)]
    for worth, ended in ((10.0, 0), (0.1, 3)):
        monkeypatch.setattr("maskfab.base.processes.WORTH_SHARING_S", worth)
        shared = []
        monkeypatch.setattr(pair, "submit", lambda call, shared=shared: shared.append(call) or Task(call, ALONE))
        monkeypatch.setattr(pair, "finish", ALONE.finish)
        assert pair.run_alike(calls) == [0, 1, 2, 3]
        assert len(shared) == ended


def test_what_is_alike_is_shared_as_a_whole_or_not_at_all(pair, monkeypatch):
    given_once, taken = iter([None, OSError("the second is not taken")]), []

    def submit(call: Call[Any]) -> Task[Any]:
        if (refused := next(given_once, None)) is not None:
            raise refused
        taken.append(call)
        return Task(call, ALONE)

    monkeypatch.setattr("threading.excepthook", lambda _: None)
    monkeypatch.setattr("maskfab.base.processes.WORTH_SHARING_S", 0.1)
    monkeypatch.setattr(pair, "submit", submit)
    monkeypatch.setattr(pair, "finish", ALONE.finish)
    assert pair.run_alike([Call(after, given(0.05, number)) for number in range(4)]) == [0, 1, 2, 3]
    assert len(taken) == 4


def test_a_result_can_be_asked_for_again_and_is_not_made_again(pair):
    for executor in (pair, SerialExecutor()):
        task = executor.submit(Call(read_only, given({"number": 1})))
        assert task.result() is task.result()


def test_a_coded_error_is_the_same_from_either_process(pair):
    with pytest.raises(JobError) as here:
        SerialExecutor().submit(Call(lattice, given(0))).result()
    task = done_there(pair.submit(Call(lattice, given(0))))
    for _ in range(2):
        with pytest.raises(JobError) as there:
            task.result()
        assert (str(there.value), there.value.code, there.value.cure) == (str(here.value), "MF104", here.value.cure)


def test_the_first_error_in_order_is_told_though_another_comes_sooner(pair):
    calls: list[Call[Any]] = [
        Call(after, given(0.3, 0)), Call(math.sqrt, given(-1.0)), Call(after, given(0.0, 2)), Call(lattice, given(0)),
    ]  # fmt: skip
    for executor in (pair, SerialExecutor()):
        with pytest.raises(ValueError, match=r"math domain error|expected a nonnegative input"):
            executor.run_all(calls)


def test_prints_of_a_task_harm_nothing(pair):
    assert done_there(pair.submit(Call(printed, given(3)))).result() == 3


def test_what_cannot_be_sent_is_done_here(pair):
    for local in (Lock(), lambda: None):
        assert [task.result() for task in pair.run_all([Call(id, given(local))] * 3)] == [id(local)] * 3


def test_a_process_that_ends_is_told_and_another_takes_its_place():
    with ProcessExecutor() as executor:
        fatal = done_there(executor.submit(Call(os._exit, given(3))))
        with pytest.raises(InternalError, match="MF901 another process ended with nothing"):
            fatal.result()
        assert done_there(executor.submit(Call(os.getpid, given()))).result() != os.getpid()


def killed(executor: ProcessExecutor, place: Path, number: int) -> int:
    """End the process that has written itself down, from outside."""
    while not place.exists() or not place.read_text():
        time.sleep(0.01)
    ended = int(place.read_text())
    place.unlink()
    os.kill(ended, number)
    return ended


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("name", ["SIGKILL", "SIGTERM"])
def test_the_task_of_a_process_that_somebody_kills_is_done_by_another(name, tmp_path):
    with ProcessExecutor() as executor:
        task = executor.submit(Call(written_down, given(tmp_path / "first", tmp_path / "free")))
        ended = killed(executor, tmp_path / "first", getattr(signal, name))
        (tmp_path / "free").touch()
        assert done_there(task).result() not in {ended, os.getpid()}


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_task_whose_processes_are_killed_twice_fails_and_this_process_lives(tmp_path):
    with ProcessExecutor() as executor:
        task = executor.submit(Call(written_down, given(tmp_path / "place", tmp_path / "never")))
        assert len({killed(executor, tmp_path / "place", signal.SIGKILL) for _ in range(2)}) == 2
        with pytest.raises(InputError, match="MF367 two processes"):
            task.result()
        assert executor.submit(Call(math.sqrt, given(4.0))).result() == 2


def test_the_longest_task_begins_first_and_none_waits_while_a_process_is_idle():
    """By the log of begin and end of three processes, one of them this one."""
    long = (1, 3, 2, 6, 4, 5, 3, 2)
    with ProcessExecutor(others=2) as executor:
        executor.finish([executor.submit(Call(after, given(0.5, 0))) for _ in range(3)])
        unknown = Call(after, given(0.2, 0))
        tasks = executor.run_all([unknown, *(Call(after, given(0.1 * each, 0), float(each)) for each in long)])
    order = sorted(tasks[1:], key=lambda task: task.span[0])
    assert [task.call.seconds for task in order] == sorted(long, reverse=True)
    assert tasks[0].span[0] <= order[2].span[0]
    last = max(task.span[0] for task in tasks)
    ends = sorted(task.span[1] for task in tasks if task.span[1] <= last)
    begins = sorted(task.span[0] for task in tasks)[3:]
    assert all(begin - end < 0.09 for begin, end in zip(begins, ends, strict=False))


def test_who_waits_for_a_task_does_another_one_meanwhile():
    with ProcessExecutor() as executor:
        slow = executor.submit(Call(after, given(1.0, 0)))
        while not slow.begun:
            time.sleep(0.01)
        short, unknown = (executor.submit(Call(os.getpid, given(), seconds)) for seconds in (1.0, None))
        slow.result()
        assert (short.ended, short.result()) == (True, os.getpid())
        assert done_there(unknown).result() != os.getpid()


def test_tasks_that_hold_more_memory_than_there_is_take_turns():
    with ProcessExecutor(others=2, memory=10.0) as executor:
        tasks = executor.run_all([Call(after, given(0.1, 0), bytes=6.0)] * 3 + [Call(after, given(0.0, 0), bytes=99.0)])
    spans = sorted(task.span for task in tasks)
    assert all(begun >= ended - 1e-3 for (_, ended), (begun, _) in itertools.pairwise(spans))


def test_what_is_found_is_told_at_once_and_what_that_raises_is_the_tasks():
    told: list[int] = []
    with ProcessExecutor() as executor:
        done_there(executor.submit(Call(after, given(0.0, 7), then=told.append)))
        assert told == [7]
        with pytest.raises(AttributeError):
            done_there(executor.submit(Call(after, given(0.0, 7), then=lambda number: number.nothing))).result()


def test_nobody_is_waited_for_when_the_work_is_given_up():
    start = time.monotonic()
    with ProcessExecutor() as executor:
        executor.submit(Call(time.sleep, given(600)))
        time.sleep(0.1)
    assert time.monotonic() - start < 60
    assert not any(thread.is_alive() for thread in executor._threads)


def test_as_many_processes_as_cores_dies_and_memory_bear(tmp_path, monkeypatch):
    few = load_job(write_job(tmp_path))
    many = few.__class__(few.spec.model_copy(update={"die": few.spec.die * 4}), few.openings, few.digest, few.where)
    for processors, memory, stated, job, others in (
        (2, math.inf, None, many, 1),
        (5, math.inf, None, many, 4),
        (64, math.inf, None, many, 15),
        (64, 3.5e9, None, many, 2),
        (1, math.inf, None, many, 0),
        (1, math.inf, 8, many, 7),
        (2, math.inf, None, few, 0),
    ):
        monkeypatch.setattr(workers, "cores", lambda count=processors: count)
        monkeypatch.setattr(workers, "memory_bytes", lambda bytes=memory: bytes)
        assert getattr(executor_of(job, workers=Workers(stated)), "_others", 0) == others


def test_a_container_bounds_cores_and_memory(tmp_path, monkeypatch):
    monkeypatch.setattr(machine, "_GROUPS", tmp_path)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)), raising=False)
    free = machine.memory_bytes()
    assert machine.cores() == 8
    for share, cores in (("max 100000", 8), ("250000 100000", 3), ("10000 100000", 1), ("9900000 100000", 8)):
        (tmp_path / "cpu.max").write_text(f"{share}\n")
        assert machine.cores() == cores
    (tmp_path / "memory.max").write_text("max\n")
    assert machine.memory_bytes() == free
    (tmp_path / "memory.max").write_text("1000000\n")
    assert machine.memory_bytes() == 1e6
