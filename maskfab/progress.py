"""Progress of long work, reported to its caller."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, int, int], None]
"""Called with the stage's name, how many of its steps are done, and how many there are."""


def silent(stage: str, done: int, total: int) -> None:
    """A progress that nobody watches."""
