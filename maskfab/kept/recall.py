"""A crew that does only what nobody has found before."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from types import TracebackType
from typing import Any, Generic, TypeAlias

from maskfab.kept.fingerprint import fingerprint, of_installation
from maskfab.kept.store import Store
from maskfab.processes import Alone, Found, Given, Task

Expected: TypeAlias = Callable[[Callable[..., Any], tuple[Any, ...]], float | None]
"""Seconds of a processor that a function of a module is expected to take with its arguments; None for unknown ones."""


@dataclass(frozen=True)
class Recalled(Generic[Found]):
    """A finding, and whether it was kept."""

    found: Found
    kept: bool


class Recalling(Alone):
    """A crew whose findings are kept, each as soon as it is found, by whichever process found it.

    Args:
        crew: does what is not kept.
        store: keeps it.
        expected: kept with each finding, beside what it took.
    """

    def __init__(self, crew: Alone, store: Store, expected: Expected | None = None) -> None:
        self._crew, self._recall = crew, partial(recalled, store, expected)
        self._asked = self._taken = 0

    def __enter__(self) -> Recalling:
        self._crew.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._crew.__exit__(kind, error, trace)

    @property
    def tally(self) -> tuple[int, int]:
        """Findings that were kept, and all findings, so far."""
        return self._taken, self._asked

    def do(self, function: Callable[..., Found], *given: Any) -> Found:
        """Return the finding of a function of a module, now and here."""
        return self._unwrap(self._recall(function, *given))

    def submit(self, function: Callable[..., Found], given: Given) -> Task[Found]:
        """A task that may begin at once."""
        return _Unwrapped(self._crew.submit(partial(self._recall, function), given), self._unwrap)

    def each(
        self, calls: Sequence[tuple[Callable[..., Found], Given]], done: Callable[[int], None] = lambda _: None
    ) -> list[Task[Found]]:
        """Tasks that have ended, in the order of the calls."""
        tasks = self._crew.each([(partial(self._recall, each), given) for each, given in calls], done)
        unwrapped = [_Unwrapped(task, self._unwrap) for task in tasks]
        for task in unwrapped:
            task.result()
        return list(unwrapped)

    def _unwrap(self, recalled: Recalled[Found]) -> Found:
        self._asked += 1
        self._taken += recalled.kept
        return recalled.found


class _Unwrapped(Task[Found]):
    """A task of the crew, of whose finding it is told once whether it was kept."""

    def __init__(self, task: Task[Recalled[Found]], unwrap: Callable[[Recalled[Found]], Found]) -> None:
        self._task, self._unwrap = task, unwrap
        self._found: list[Found] = []
        self.seconds = 0.0

    def result(self) -> Found:
        """The finding, once the task has ended; raises as :meth:`Task.result`."""
        if not self._found:
            self._found.append(self._unwrap(self._task.result()))
            self.seconds = self._task.seconds
        return self._found[0]


def recalled(store: Store, expected: Expected | None, function: Callable[..., Found], *given: Any) -> Recalled[Found]:
    """The finding of a function of a module, which depends on its arguments alone; kept if they have a fingerprint.

    Raises:
        Exception: that of the function, which is not kept.
    """
    try:
        key = fingerprint(of_installation(), function, given)
    except TypeError:
        return Recalled(function(*given), False)
    kept = store.get(key)
    if kept is not None:
        return Recalled(kept[0], True)
    begun = time.thread_time()
    found = function(*given)
    took = time.thread_time() - begun
    store.put(key, words(function), found, took, None if expected is None else expected(function, given))
    return Recalled(found, False)


def words(function: Callable[..., Any]) -> str:
    """Name of a function of a module in the store."""
    named = function.func if isinstance(function, partial) else function
    return f"{named.__module__.removeprefix('maskfab.')}.{named.__qualname__}"
