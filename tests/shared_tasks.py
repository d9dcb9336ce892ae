"""Tasks that a second process can import, for tests of processes."""

from __future__ import annotations

import os
import time


def after(seconds: float, value: int) -> int:
    """The value, only later."""
    time.sleep(seconds)
    return value


def sooner_in(process: int) -> int:
    """The process that does it: at once in the one given, in any other after ten minutes."""
    if os.getpid() != process:
        time.sleep(600)
    return os.getpid()


def printed(number: int) -> int:
    """The number, and a word where answers go."""
    print("a word to nobody")
    return number
