"""An executor that does only what nobody has found before."""

from __future__ import annotations

import time
import typing
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from types import TracebackType
from typing import Any, Generic, TypeAlias

from maskfab.base import __version__
from maskfab.base.findings import words
from maskfab.base.folders import Account
from maskfab.base.model import Die
from maskfab.base.processes import Call, Found, SerialExecutor, Task
from maskfab.runs.store import KeptFinding, Origin, Refused, Store, fingerprint, of_installation

Expected: TypeAlias = Callable[[Callable[..., Any], tuple[Any, ...]], float | None]
"""Seconds of a processor that a function of a module is expected to take with its arguments; None for unknown ones."""


@dataclass(frozen=True)
class Recalled(Generic[Found]):
    """A finding, and where it comes from; None for one that cannot be kept."""

    found: Found
    account: Account | None


class CachingExecutor(SerialExecutor):
    """An executor whose findings are kept, each as soon as it is found, by whichever process found it."""

    def __init__(self, executor: SerialExecutor, store: Store, expected: Expected | None = None) -> None:
        self._executor, self._recall = executor, partial(recalled, store, expected)
        self._accounts: list[Account | None] = []

    def __enter__(self) -> CachingExecutor:
        self._executor.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._executor.__exit__(kind, error, trace)

    @property
    def tally(self) -> tuple[int, int]:
        """Findings that were kept, and all findings, so far."""
        return sum(account is not None and account.kept for account in self._accounts), len(self._accounts)

    @property
    def accounts(self) -> tuple[Account, ...]:
        """Where every finding comes from that can be kept, so far."""
        return tuple(account for account in self._accounts if account is not None)

    def run(self, function: Callable[..., Found], *given: Any) -> Found:
        """Return the finding of a function of a module, now and here."""
        return self._unwrap(self._recall(function, *given))

    def submit(self, call: Call[Found]) -> Task[Found]:
        """A task that may begin at once."""
        function, then = partial(self._recall, call.function), call.then
        found = None if then is None else lambda recalled: then(recalled.found)
        return _Unwrapped(self._executor.submit(replace(call, function=function, then=found)), self._unwrap)  # type: ignore[arg-type]

    def finish(self, tasks: Sequence[Task[Any]], done: Callable[[int], None] = lambda _: None) -> None:
        """Return when tasks have ended, however they did."""
        self._executor.finish([task.task for task in tasks if isinstance(task, _Unwrapped)], done)

    def _unwrap(self, recalled: Recalled[Found]) -> Found:
        self._accounts.append(recalled.account)
        return recalled.found


class _Unwrapped(Task[Found]):
    """A task of the executor, of whose finding it is told once whether it was kept."""

    def __init__(self, task: Task[Recalled[Found]], unwrap: Callable[[Recalled[Found]], Found]) -> None:
        self.task, self._unwrap = task, unwrap
        self._found: list[Found] = []
        self.seconds = 0.0

    def result(self) -> Found:
        """The finding, once the task has ended; raises as :meth:`Task.result`."""
        if not self._found:
            self._found.append(self._unwrap(self.task.result()))
            self.seconds = self.task.seconds
        return self._found[0]


def recalled(store: Store, expected: Expected | None, function: Callable[..., Found], *given: Any) -> Recalled[Found]:
    """The finding of a function of a module, which depends on its arguments alone; kept if they have a fingerprint."""
    try:
        origin, kind = origin_of(function, *given), kind_of(function)
    except TypeError:
        return Recalled(function(*given), None)
    entry, die = store.get(origin, kind), _die_of(given)
    if isinstance(entry, KeptFinding):
        return Recalled(entry.value, Account(origin.what, die, True, entry.since, entry.version, origin.key))
    begun = time.thread_time()
    finding = function(*given)
    took = time.thread_time() - begun
    since = store.put(origin, finding, kind, took, None if expected is None else expected(function, given))
    refused = entry.why if isinstance(entry, Refused) else None
    return Recalled(finding, Account(origin.what, die, False, since, __version__, origin.key, refused))


def origin_of(function: Callable[..., Any], *given: object) -> Origin:
    """Everything that the finding of a function of a module depends on."""
    return Origin(words(function), (of_installation(), *map(fingerprint, (function, *given))))


def kind_of(function: Callable[..., Any]) -> Any:
    """Kind of the findings of a function, as it states it."""
    return _stated_kind(function.func if isinstance(function, partial) else function)


@cache
def _stated_kind(function: Callable[..., Any]) -> Any:
    hints = typing.get_type_hints(function)
    if "return" not in hints:
        raise TypeError(f"{words(function)} does not state what it finds")
    return hints["return"]


def _die_of(given: tuple[Any, ...]) -> str | None:
    """Name of the die that arguments are about; None if they name none."""
    for argument in given:
        named = argument if isinstance(argument, Die | str) else getattr(argument, "die", None)
        if isinstance(named, Die | str):
            return named if isinstance(named, str) else named.name
    return None
