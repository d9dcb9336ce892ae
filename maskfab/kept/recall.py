"""A crew that does only what nobody has found before."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from types import TracebackType
from typing import Any

from maskfab.kept.fingerprint import fingerprint, of_installation
from maskfab.kept.store import Store
from maskfab.processes import Alone, Found, Given, Task


class Recalling(Alone):
    """A crew whose findings are kept, each as soon as it is found, by whichever process found it."""

    def __init__(self, crew: Alone, store: Store) -> None:
        self._crew, self._store = crew, store

    def __enter__(self) -> Recalling:
        self._crew.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._crew.__exit__(kind, error, trace)

    def do(self, function: Callable[..., Found], *given: Any) -> Found:
        """Return the finding of a function of a module, now and here."""
        return recall(self._store, function, *given)

    def submit(self, function: Callable[..., Found], given: Given) -> Task[Found]:
        """A task that may begin at once."""
        return self._crew.submit(partial(recall, self._store, function), given)

    def each(
        self, calls: Sequence[tuple[Callable[..., Found], Given]], done: Callable[[int], None] = lambda _: None
    ) -> list[Task[Found]]:
        """Tasks that have ended, in the order of the calls."""
        return self._crew.each([(partial(recall, self._store, each), given) for each, given in calls], done)


def recall(store: Store, function: Callable[..., Found], *given: Any) -> Found:
    """The finding of a function of a module, which depends on its arguments alone; kept if they have a fingerprint.

    Raises:
        Exception: that of the function, which is not kept.
    """
    try:
        key = fingerprint(of_installation(), function, given)
    except TypeError:
        return function(*given)
    kept = store.get(key)
    if kept is not None:
        return kept[0]  # type: ignore[no-any-return]
    found = function(*given)
    store.put(key, _words(function), found)
    return found


def _words(function: Callable[..., Any]) -> str:
    named = function.func if isinstance(function, partial) else function
    return f"{named.__module__.removeprefix('maskfab.')}.{named.__qualname__}"
