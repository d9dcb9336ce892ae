"""Tasks that a second process can import, for tests of processes."""

from __future__ import annotations

import time


def after(seconds: float, value: int) -> int:
    """The value, only later."""
    time.sleep(seconds)
    return value


def printed(number: int) -> int:
    """The number, and a word where answers go."""
    print("a word to nobody")
    return number
