"""Memory that is free again, given back to the system.

The allocator of Linux keeps what large arrays and many small objects leave behind, in pieces that the next stage of a
run cannot use, so that a plate of many dies grows with every one of them. Elsewhere nothing need be done.
"""

from __future__ import annotations

import ctypes
import sys


def give_back() -> None:
    """Return free pages to the system; takes milliseconds, and does nothing where there is no such call."""
    if sys.platform != "linux":
        return
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # of glibc alone
    if trim is not None:
        trim(0)
