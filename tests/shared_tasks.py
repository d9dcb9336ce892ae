"""Tasks that another process can import, for tests of processes."""

from __future__ import annotations

import os
import time
from pathlib import Path


def after(seconds: float, value: int) -> int:
    """The value, only later."""
    time.sleep(seconds)
    return value


def written_down(place: Path, free: Path) -> int:
    """The process that does it, which first writes its number down and waits until it is free."""
    place.with_suffix(".aside").write_text(str(os.getpid()))
    place.with_suffix(".aside").replace(place)
    while not free.exists():
        time.sleep(0.01)
    return os.getpid()


def printed(number: int) -> int:
    """The number, and a word where answers go."""
    print("a word to nobody")
    return number


def busy(seconds: float) -> int:
    """Keep a processor busy for so many of its seconds, and return the number of the process."""
    began = time.thread_time()
    while time.thread_time() < began + seconds:
        pass
    return os.getpid()
