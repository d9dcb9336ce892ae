"""Tasks that a second process can import, for tests of processes."""

from __future__ import annotations

import time
from collections.abc import Callable


def after(seconds: float, value: int) -> int:
    """The value, only later."""
    time.sleep(seconds)
    return value


def counted(count: int, progress: Callable[[str, int, int], None]) -> int:
    """Tells every number below."""
    for number in range(count):
        print("a word to nobody")
        progress("count", number, count)
    return count
