"""Tasks that this process shares with a second one, or several, so that all processors are kept busy.

    with ProcessExecutor() as executor:
        photographs = executor.submit(restore_photographs, lambda: (plate, camera))
        ...
        restored = photographs.result()

Most of the work holds the interpreter, so that threads would only take turns. A task is a function of a module; it, its
arguments and what it finds are pickled. What it finds depends on its arguments alone, so that which process did it does
not show. The second process reads tasks from stdin and answers on stdout until there are no more.

The allocator of Linux keeps what large arrays and many small objects leave behind, in pieces that the next stage of a
run cannot use, so that a plate of many dies grows with every one of them; :func:`release_memory` gives them back.
"""

from __future__ import annotations

import copyreg
import ctypes
import io
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from queue import SimpleQueue
from threading import Condition, Thread
from types import MappingProxyType, TracebackType
from typing import Any, Generic, Literal, TypeAlias, TypeVar

from maskfab.base.errors import InternalError
from maskfab.base.work import settle


def pickled(content: object) -> bytes:
    """Bytes that unpickle to an equal value.

    Raises:
        TypeError: for a value that no other process can be given.
    """
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

_Kind: TypeAlias = Literal["kept", "raised", "found"]


class Task(Generic[Found]):
    """Something to be found, by whichever process begins it.

    Attributes:
        seconds: that it took, once it is found.
    """

    def __init__(
        self, function: Callable[..., Found], given: ArgumentsFactory, begin: Callable[[Task[Any]], bool]
    ) -> None:
        self._function, self._given, self._begin = function, given, begin
        self._news: SimpleQueue[tuple[_Kind, Any]] = SimpleQueue()
        self._outcome: tuple[_Kind, Any] | None = None
        self.ended = False
        self.seconds = 0.0

    def attempt(self) -> None:
        """Do it here, unless it has begun."""
        if self._begin(self):
            self._work()

    def message(self) -> bytes:
        """The task for the second process.

        Raises:
            TypeError: for arguments that no other process can be given.
        """
        return pickled((self._function, self._given()))

    def tell(self, kind: _Kind, content: Any) -> None:
        """Take what the second process says of it."""
        self.ended = kind != "kept"
        self._news.put((kind, content))

    def result(self) -> Found:
        """The finding, once the task has ended.

        Raises:
            Exception: whatever the task raises; InternalError MF901 if it ends the second process. Where somebody else
                does, it is done here.
        """
        self.attempt()
        if self._outcome is None:
            kind, content = self._news.get()
            if kind == "kept":
                self._work()
            elif kind == "found":
                finding, self.seconds = content
                self._outcome = kind, finding
            else:
                self._outcome = kind, content
        assert self._outcome is not None
        kind, content = self._outcome
        if kind == "raised":
            raise content
        return content  # type: ignore[no-any-return]

    def _work(self) -> None:
        start = time.perf_counter()
        try:
            self._outcome = "found", self._function(*self._given())
        except Exception as error:
            self._outcome = "raised", error
        self.ended, self.seconds = True, time.perf_counter() - start
        release_memory()


class SerialExecutor(AbstractContextManager["SerialExecutor"]):
    """One process does every task itself, when it is asked what is found."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Nothing is left behind."""

    @property
    def tally(self) -> tuple[int, int]:
        """Findings that need not be found again, and all findings that are kept, so far."""
        return 0, 0

    def run(self, function: Callable[..., Found], *given: Any) -> Found:
        """Do one thing now and in this process, and return its finding."""
        return function(*given)

    def submit(self, function: Callable[..., Found], given: ArgumentsFactory) -> Task[Found]:
        """A task that may begin at once.

        Args:
            function: of a module.
            given: its arguments.
        """
        return self._offered(Task(function, given, self._begin))

    def run_all(
        self,
        calls: Sequence[tuple[Callable[..., Found], ArgumentsFactory]],
        done: Callable[[int], None] = lambda _: None,
    ) -> list[Task[Found]]:
        """Tasks that have ended, in the order of the calls.

        Args:
            calls: functions of modules, and their arguments.
            done: told how many have ended.

        Raises:
            Exception: that of the first that fails, in their order.
        """
        tasks = [self._offered(Task(function, given, self._begin)) for function, given in calls]
        # The second process begins with the first, this one with the last: they meet where little is left.
        for task in reversed(tasks):
            task.attempt()
            done(sum(task.ended for task in tasks))
        for task in tasks:
            task.result()
            done(sum(task.ended for task in tasks))
        return tasks

    def _offered(self, task: Task[Found]) -> Task[Found]:
        return task

    def _begin(self, task: Task[Any]) -> bool:
        """Whether a task has not begun; now it has."""
        return not task.ended


class ProcessExecutor(SerialExecutor):
    """This process and a second one, or several, which begin what is submitted while this one goes on.

    Args:
        others: processes besides this one.
    """

    def __init__(self, others: int = 1) -> None:
        self._others = others

    def __enter__(self) -> ProcessExecutor:
        self._waiting: deque[Task[Any]] = deque()
        self._changed = Condition()
        self._closed = False
        with ExitStack() as stack:
            self._processes = [stack.enter_context(_Other()) for _ in range(self._others)]
            for other in self._processes:
                thread = Thread(target=self._lend, args=(other,), daemon=True)
                thread.start()
                stack.callback(thread.join)
                stack.callback(other.kill)
            self._left = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._changed:
            self._closed = True
            self._waiting.clear()
            self._changed.notify_all()
        for other in self._processes:
            other.kill()
        self._left.close()

    def _offered(self, task: Task[Found]) -> Task[Found]:
        with self._changed:
            self._waiting.append(task)
            self._changed.notify()
        return task

    def _begin(self, task: Task[Any]) -> bool:
        with self._changed, suppress(ValueError):
            self._waiting.remove(task)
            return True
        return False

    def _lend(self, other: _Other) -> None:
        """Hand tasks to another process, one after the other."""
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._closed)
                if self._closed:
                    return
                task = self._waiting.popleft()
            try:
                message = task.message()
            except TypeError:
                task.tell("kept", None)
                continue
            except Exception as error:
                task.tell("raised", error)
                continue
            try:
                task.tell(*other.answer(message))
            except (OSError, EOFError, pickle.UnpicklingError):
                if other.was_killed():
                    task.tell("kept", None)
                else:
                    task.tell("raised", InternalError("MF901", f"another process ended with {other.last_words()}"))
                return
            except Exception as error:
                task.tell("raised", error)


class _Other(AbstractContextManager["_Other"]):
    """Another process, which answers one message after the other."""

    def __enter__(self) -> _Other:
        with ExitStack() as stack:
            self._said = stack.enter_context(tempfile.TemporaryFile())
            command = [sys.executable, "-P", "-c", f"from {__name__} import work; work()"]
            pipe = subprocess.PIPE
            self._process = stack.enter_context(subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=self._said))
            stack.callback(self._process.kill)
            self._left = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._left.close()

    def kill(self) -> None:
        self._process.kill()

    def answer(self, message: bytes) -> tuple[_Kind, Any]:
        """Its news of a task.

        Raises:
            OSError, EOFError: if it has ended.
        """
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
        """Whether somebody else ended it, once it does not answer; what a task does to it, it would do here, too."""
        try:
            return -self._process.wait(_ENDS_WITHIN_S) in _FROM_OUTSIDE
        except subprocess.TimeoutExpired:
            return False

    def last_words(self) -> str:
        """The last line of what it printed."""
        self._said.seek(0)
        lines = self._said.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else "nothing"


def work() -> None:
    """The life of the second process."""
    settle()
    # An interrupt is the affair of who waits, who ends this process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # What is printed on the way must not get among the answers.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())

    def say(kind: _Kind, content: object) -> None:
        answers.write(pickled((kind, content)))
        answers.flush()

    with suppress(EOFError):
        while True:
            function, given = pickle.load(sys.stdin.buffer)
            start = time.perf_counter()
            try:
                finding = function(*given)
            except Exception as error:
                error.add_note(traceback.format_exc())
                say("raised", error)
            else:
                say("found", (finding, time.perf_counter() - start))
                del finding
            release_memory()
