"""Tasks that this process shares with others, so that all processors are kept busy.

    with ProcessExecutor(others=3) as executor:
        photographs = executor.submit(Call(restore_photographs, lambda: (plate, camera)))
        ...
        restored = photographs.result()

Most of the work holds the interpreter, so that threads would only take turns. A task is a function of a module; it, its
arguments and what it finds are pickled. What it finds depends on its arguments alone, so that which process did it does
not show. Another process reads tasks from stdin and answers on stdout until there are no more.

The allocator of Linux keeps what large arrays and many small objects leave behind, in pieces that the next stage of a
run cannot use, so that a plate of many dies grows with every one of them; :func:`release_memory` gives them back.
"""

from __future__ import annotations

import copyreg
import ctypes
import io
import math
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count
from threading import Condition, Thread, Timer
from types import MappingProxyType, TracebackType
from typing import Any, BinaryIO, Generic, Literal, TypeAlias, TypeVar

from maskfab.base.effort import add_helper, measured
from maskfab.base.errors import InputError, InternalError
from maskfab.base.machine import STARTED_BY, end_with_starter
from maskfab.base.work import THREADS, settle


def pickled(content: object) -> bytes:
    """Bytes that unpickle to an equal value; TypeError for one that no other process can be given."""
    buffer = io.BytesIO()
    pickler = pickle.Pickler(buffer, protocol=pickle.HIGHEST_PROTOCOL)
    pickler.dispatch_table = copyreg.dispatch_table | {MappingProxyType: lambda view: (read_only, (dict(view),))}
    pickler.dump(content)
    return buffer.getvalue()


def read_only(content: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    """A read-only view for unpickling, where its own class has no name to be found by."""
    return MappingProxyType(content)


def release_memory() -> None:
    """Return free pages to the system; takes milliseconds, and does nothing where there is no such call."""
    if sys.platform != "linux":
        return
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # of glibc alone
    if trim is not None:
        trim(0)


@contextmanager
def quiet() -> Iterator[None]:
    """Take away the printers of the STEP library's messages, and put them back afterwards."""
    from OCP.Message import Message

    messenger = Message.DefaultMessenger_s()
    printers = list(messenger.Printers())
    for printer in printers:
        messenger.RemovePrinter(printer)
    try:
        yield
    finally:
        for printer in printers:
            messenger.AddPrinter(printer)


Found = TypeVar("Found")
ArgumentsFactory: TypeAlias = Callable[[], tuple[Any, ...]]
"""Makes the arguments of a task when it begins: those of all tasks may not fit into memory."""

_FROM_OUTSIDE = frozenset(
    getattr(signal, name)
    for name in ("SIGKILL", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGUSR1", "SIGUSR2")
    if hasattr(signal, name)
)
"""Signals that end a process from outside: a user, a batch system, or one that is short of memory."""
_ENDS_WITHIN_S = 10.0
_TOLD_EVERY_S = 0.05

_Kind: TypeAlias = Literal["raised", "found"]


@dataclass(frozen=True, eq=False)
class Call(Generic[Found]):
    """Work of a task.

    Attributes:
        function: of a module.
        given: makes its arguments.
        seconds: that it is expected to take; None where nobody knows.
        bytes: of memory that it holds at its most, if that is much.
        then: gets what is found as soon as it is, in this process, by any of its threads.
    """

    function: Callable[..., Found]
    given: ArgumentsFactory
    seconds: float | None = None
    bytes: float = 0.0
    then: Callable[[Found], None] | None = None


class Task(Generic[Found]):
    """Something to be found, by whichever process begins it.

    Attributes:
        begun, ended: whether it has.
        here: whether no other process can do it.
        seconds: that it took, once it is found.
        span: when it began and ended, by :func:`time.monotonic` of this process.
    """

    def __init__(self, call: Call[Found], executor: SerialExecutor) -> None:
        self.call, self._executor = call, executor
        self.begun = self.ended = self.here = False
        self.seconds, self.span = 0.0, (math.nan, math.nan)
        self._outcome: tuple[_Kind, Any] = "raised", InternalError("MF901", "a task was asked before its end")

    @property
    def rank(self) -> float:
        """Place in the order of handing out: the longest first, and before them those of which nobody knows."""
        return -math.inf if self.call.seconds is None else -self.call.seconds

    def message(self) -> bytes:
        """The task for another process.

        Raises:
            TypeError, AttributeError, pickle.PicklingError: for what no other process can be given.
        """
        return pickled((self.call.function, self.call.given()))

    def begin(self) -> None:
        """Nobody else may begin it from now on."""
        self.begun, self.span = True, (time.monotonic(), math.nan)

    def work(self) -> None:
        """Do it here."""
        start = time.perf_counter()
        try:
            self.end("found", self.call.function(*self.call.given()), time.perf_counter() - start)
        except Exception as error:
            self.end("raised", error, time.perf_counter() - start)
        release_memory()

    def end(self, kind: _Kind, content: Any, seconds: float = 0.0) -> None:
        """Take what became of it."""
        if kind == "found" and self.call.then is not None:
            try:
                self.call.then(content)
            except Exception as error:
                kind, content = "raised", error
        self._outcome, self.seconds, self.span = (kind, content), seconds, (self.span[0], time.monotonic())
        self.begun = self.ended = True

    def result(self) -> Found:
        """The finding, once the task has ended.

        Raises:
            Exception: whatever the task raises; InternalError MF901 if it ends the process that does it; InputError
                MF367 if somebody else ends that process, and the next one that it is given to.
        """
        self._executor.finish([self])
        kind, content = self._outcome
        if kind == "raised":
            raise content
        return content  # type: ignore[no-any-return]


class SerialExecutor(AbstractContextManager["SerialExecutor"]):
    """One process does every task itself, when it is asked what is found."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Nothing is left behind."""

    @property
    def processes(self) -> int:
        """Those that do tasks, this one included."""
        return 1

    @property
    def tally(self) -> tuple[int, int]:
        """Findings that need not be found again, and all findings that are kept, so far."""
        return 0, 0

    def run(self, function: Callable[..., Found], *given: Any) -> Found:
        """Do one thing now and in this process, and return its finding."""
        return function(*given)

    def submit(self, call: Call[Found]) -> Task[Found]:
        """A task that may begin at once."""
        return Task(call, self)

    def finish(self, tasks: Sequence[Task[Any]], done: Callable[[int], None] = lambda _: None) -> None:
        """Return when tasks have ended, however they did; ``done`` is told how many have."""
        for number, task in enumerate(tasks, start=1):
            if not task.ended:
                task.begin()
                task.work()
            done(number)

    def run_all(self, calls: Sequence[Call[Found]], done: Callable[[int], None] = lambda _: None) -> list[Task[Found]]:
        """Tasks that have ended, in the order of the calls.

        Args:
            done: told how many have ended.

        Raises:
            Exception: that of the first that fails, in their order.
        """
        tasks = [self.submit(call) for call in calls]
        self.finish(tasks, done)
        for task in tasks:
            task.result()
        return tasks

    def run_alike(self, calls: Sequence[Call[Found]], done: Callable[[int], None] = lambda _: None) -> list[Found]:
        """Findings of tasks that take about as long as one another, in their order.

        The first is begun here, and the rest shared as soon as it has taken so long that they take longer than another
        process to begin; less work is done here as well.

        Args:
            done: told how many have ended.

        Raises:
            Exception: that of the first that fails, in their order.
        """
        shared: list[Task[Found]] = []
        after = Timer(WORTH_SHARING_S / max(1, len(calls) - 1), lambda: shared.extend([*map(self.submit, calls[1:])]))
        after.daemon = True
        after.start()
        try:
            first = ALONE.run_all(calls[:1], done)
        finally:
            after.cancel()
            after.join()
        if not shared and sum(task.seconds for task in first) * (len(calls) - 1) >= WORTH_SHARING_S:
            shared = [self.submit(call) for call in calls[1:]]
        rest = shared or [ALONE.submit(call) for call in calls[1:]]
        (self if shared else ALONE).finish(rest, lambda ended: done(1 + ended))
        return [task.result() for task in (*first, *rest)]


ALONE = SerialExecutor()
"""This process, which shares nothing."""
WORTH_SHARING_S = 4.0
"""Work that is longer than another process takes to begin, which may load torch."""


class ProcessExecutor(SerialExecutor):
    """This process and others, which begin what is submitted while this one goes on, the longest task first.

    Others are started when there is something for them to do. One that somebody kills is replaced, and does its task
    again; where that is killed, too, the task fails. This process does tasks while it waits for one.

    Args:
        others: processes besides this one.
        memory: bytes that tasks may hold together, as far as they say; one may hold more.
    """

    def __init__(self, others: int = 1, memory: float = math.inf) -> None:
        self._others, self._memory = others, memory

    @property
    def processes(self) -> int:
        return 1 + self._others

    def __enter__(self) -> ProcessExecutor:
        self._waiting: list[tuple[float, int, Task[Any]]] = []
        self._changed, self._numbers = Condition(), count()
        self._closed, self._held, self._spent_s = False, 0.0, 0.0
        self._running: set[Other] = set()
        self._threads = [Thread(target=self._lend, daemon=True) for _ in range(self._others)]
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._changed:
            self._closed = True
            self._waiting.clear()
            self._changed.notify_all()
            for other in self._running:
                other.kill()
        for thread in self._threads:
            thread.join()
        add_helper(self._spent_s)

    def submit(self, call: Call[Found]) -> Task[Found]:
        """A task that may begin at once."""
        task = Task(call, self)
        with self._changed:
            heappush(self._waiting, (task.rank, next(self._numbers), task))
            self._changed.notify()
        return task

    def finish(self, tasks: Sequence[Task[Any]], done: Callable[[int], None] = lambda _: None) -> None:
        """Do tasks that have not begun, and while others do the rest, further ones that are submitted, the shortest
        first: whoever waits for these goes on the sooner."""
        told = time.monotonic()

        def tell() -> None:
            nonlocal told
            if time.monotonic() > told + _TOLD_EVERY_S:
                told = time.monotonic()
                done(sum(task.ended for task in tasks))

        for task in sorted(tasks, key=lambda task: task.rank):
            with self._changed:
                self._changed.wait_for(lambda task=task: task.begun or self._fits(task))  # type: ignore[misc]
                mine = not task.begun
                if mine:
                    self._begin(task)
            if mine:
                self._work(task)
                tell()
        for wanted in tasks:
            while not wanted.ended:
                with self._changed:
                    found = self._beside(wanted)
                    if found is not None:
                        self._begin(found)
                    elif not wanted.ended:
                        self._changed.wait()
                if found is not None:
                    self._work(found)
                tell()
        done(len(tasks))

    def _beside(self, wanted: Task[Any]) -> Task[Any] | None:
        """Work of this process while a task is done elsewhere; nothing that may take any time."""
        if wanted.here:
            return wanted
        waiting = (task for *_, task in self._waiting if not task.begun and task.call.seconds is not None)
        return min(filter(self._fits, waiting), key=lambda task: -task.rank, default=None)

    def _fits(self, task: Task[Any]) -> bool:
        return self._held == 0 or self._held + task.call.bytes <= self._memory

    def _begin(self, task: Task[Any]) -> None:
        task.begin()
        task.here = False
        self._held += task.call.bytes

    def _work(self, task: Task[Any]) -> None:
        try:
            task.work()
        finally:
            self._free(task)

    def _free(self, task: Task[Any], *, here: bool = False) -> None:
        with self._changed:
            task.here = here
            self._held -= task.call.bytes
            self._changed.notify_all()

    def _lend(self) -> None:
        other: Other | None = None
        while (task := self._next()) is not None:
            try:
                message = task.message()
            except (TypeError, AttributeError, pickle.PicklingError):
                self._free(task, here=True)
                continue
            except Exception as error:
                task.end("raised", error)
            else:
                other = self._answered(task, message, other)
            self._free(task)
        if other is not None:
            other.close()

    def _answered(self, task: Task[Any], message: bytes, other: Other | None) -> Other | None:
        """The process that has ended a task and lives on: the one that is given, or another one."""
        for again in (False, True):
            try:
                other = other or self._started()
                kind, content, seconds, spent_s = other.answer(message)
                with self._changed:
                    self._spent_s += spent_s
                task.end(kind, content, seconds)
                return other
            except (OSError, EOFError, pickle.UnpicklingError) as error:
                if other is None or self._closed:
                    task.end("raised", error)
                    return other
                lost, other = other, None
                self._running.discard(lost)
                killed, words = lost.was_killed(), lost.last_words()
                lost.close()
            except Exception as error:
                task.end("raised", error)
                return other
            if not killed:
                # What a task does to one process it would do to the next.
                task.end("raised", InternalError("MF901", f"another process ended with {words}"))
                return None
            if again:
                cure = "Give it fewer --workers, or more memory: a system that is short of it kills processes"
                task.end("raised", InputError("MF367", "two processes that began a task were killed", cure=cure))
        return None

    def _started(self) -> Other:
        other = self._other()
        with self._changed:
            self._running.add(other)
            if self._closed:
                other.kill()
        return other

    def _other(self) -> Other:
        return LocalProcess()

    def _next(self) -> Task[Any] | None:
        """The longest task that waits and fits, once there is one; None once there will be none."""
        with self._changed:
            while not self._closed:
                passed, found = [], None
                while self._waiting and found is None:
                    *_, task = entry = heappop(self._waiting)
                    if not task.begun and self._fits(task):
                        found = task
                    elif not task.begun:
                        passed.append(entry)
                for entry in passed:
                    heappush(self._waiting, entry)
                if found is not None:
                    self._begin(found)
                    return found
                self._changed.wait()
        return None


class Other(ABC):
    """Another process, which answers one message after the other."""

    @abstractmethod
    def answer(self, message: bytes) -> tuple[_Kind, Any, float, float]:
        """Result of a task, the seconds that it took, and those of the processor, with what it had to import.

        Raises:
            OSError, EOFError: if the process has ended.
        """

    @abstractmethod
    def kill(self) -> None:
        """End it now, by any thread."""

    def close(self) -> None:
        """Leave nothing behind."""
        self.kill()

    def was_killed(self) -> bool:
        """Whether somebody else ended it, once it does not answer."""
        return True

    def last_words(self) -> str:
        """The last line of what it printed."""
        return "nothing"


class LocalProcess(Other):
    """A process of this machine, with one thread in every numerical library."""

    def __init__(self) -> None:
        with ExitStack() as stack:
            self._said = stack.enter_context(tempfile.TemporaryFile())
            command = [sys.executable, "-P", "-c", f"from {__name__} import work; work()"]
            pipe, alone = subprocess.PIPE, {**os.environ, STARTED_BY: str(os.getpid()), **dict.fromkeys(THREADS, "1")}
            self._process = stack.enter_context(
                subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=self._said, env=alone)
            )
            stack.callback(self._process.kill)
            self._left = stack.pop_all()

    def close(self) -> None:
        self._left.close()

    def kill(self) -> None:
        self._process.kill()

    def answer(self, message: bytes) -> tuple[_Kind, Any, float, float]:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.write(message)
            self._process.stdin.flush()
        except OSError:
            with suppress(OSError):  # what it has not taken would be written again when it is left
                self._process.stdin.close()
            raise
        return pickle.load(self._process.stdout)  # type: ignore[no-any-return]

    def was_killed(self) -> bool:
        try:
            return -self._process.wait(_ENDS_WITHIN_S) in _FROM_OUTSIDE
        except subprocess.TimeoutExpired:
            return False

    def last_words(self) -> str:
        self._said.seek(0)
        lines = self._said.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else "nothing"


def work() -> None:
    """The life of another process."""
    end_with_starter()
    settle()
    # An interrupt is the affair of who waits, who ends this process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # What is printed on the way must not get among the answers.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    with suppress(EOFError):
        while True:
            answers.write(answer(sys.stdin.buffer))
            answers.flush()
            release_memory()


def answer(message: BinaryIO) -> bytes:
    """Result of a task that another process wrote, as it reads it."""
    with measured() as effort:
        function, given = pickle.load(message)
        start = time.perf_counter()
        outcome: tuple[_Kind, Any]
        try:
            outcome = "found", function(*given)
        except Exception as error:
            error.add_note(traceback.format_exc())
            outcome = "raised", error
        seconds = time.perf_counter() - start
    return pickled((*outcome, seconds, effort.seconds))
