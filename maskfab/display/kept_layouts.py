"""Layouts that long searches have found, which come with the program and are proved again before they are used.

``kept_layouts.npz`` beside this file has each under the SHA-256 of everything that its search depends on: what it was
given, and the version of its algorithm. Whoever takes one proves it by the rules that the search keeps; what does not
prove, or is not there, is searched for. CONTRIBUTING says how the file is made.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

FILE = Path(__file__).with_name("kept_layouts.npz")

Layout = TypeVar("Layout", bound=NDArray[Any])


@dataclass(frozen=True)
class KeptLayouts:
    """Layouts by their origins; none by default."""

    layouts: Mapping[str, NDArray[Any]] = field(default_factory=dict)

    def layout(
        self, origin: str, proved: Callable[[Layout], bool], search: Callable[[], Layout | None]
    ) -> tuple[Layout | None, bool]:
        """The layout that is kept of an origin, if it proves, else what a search finds; and whether it was kept."""
        kept: Any = self.layouts.get(origin)
        return (kept, True) if kept is not None and proved(kept) else (search(), False)


@cache
def shipped(file: Path = FILE) -> KeptLayouts:
    """Those that come with the program; none of a file that is damaged."""
    # Whatever zipfile, zlib, tokenize or NumPy makes of it.
    with suppress(Exception), file.open("rb") as own, np.load(own) as stored:
        return KeptLayouts(dict(stored))
    return KeptLayouts()


def origin_of(search: str, version: int, *given: object) -> str:
    """Hexadecimal SHA-256 of a search and what it is given: arrays, and values whose ``repr`` is all of them."""
    total = hashlib.sha256(f"{search} {version}".encode())
    for value in given:
        array = isinstance(value, np.ndarray)
        kind = f"{value.dtype.str} {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__
        content = np.ascontiguousarray(value).tobytes() if array else repr(value).encode()
        total.update(f"\n{kind} {len(content)}\n".encode() + content)
    return total.hexdigest()
