"""Layouts that long searches have found, which come with the program and are proved again before they are used.

``kept_layouts.json`` beside this file has each under the SHA-256 of everything that its search depends on: what it was
given, and the version of its algorithm. Whoever takes one proves it by the rules that the search keeps; what does not
prove, or is not there, is searched for. CONTRIBUTING says how the file is made.
"""

from __future__ import annotations

import hashlib
import json
import zlib
from base64 import b85decode, b85encode
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

FILE = Path(__file__).with_name("kept_layouts.json")

Layout = TypeVar("Layout", bound=NDArray[Any])
Packed: TypeAlias = Mapping[str, str | list[int]]
"""Type and shape of a layout, and its differences along the first axis, zlib in base 85."""
_TYPES = {"int8": "<i1", "int64": "<i4"}


@dataclass(frozen=True)
class KeptLayouts:
    """Packed layouts by their origins."""

    packed: Mapping[str, Packed]

    def layout(
        self, origin: str, proved: Callable[[Layout], bool], search: Callable[[], Layout | None]
    ) -> tuple[Layout | None, bool]:
        """The layout that is kept of an origin, if it proves, else what a search finds; and whether it was kept."""
        if (packed := self.packed.get(origin)) is not None:
            kept: Any = unpack(packed)
            if kept is not None and proved(kept):
                return kept, True
        return search(), False


@cache
def shipped() -> KeptLayouts:
    """Those that come with the program."""
    return KeptLayouts(json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {})


def origin_of(search: str, version: int, *given: object) -> str:
    """Hexadecimal SHA-256 of a search and what it is given: arrays, and values whose ``repr`` is all of them."""
    total = hashlib.sha256(f"{search} {version}".encode())
    for value in given:
        array = isinstance(value, np.ndarray)
        content = np.ascontiguousarray(value).tobytes() if array else repr(value).encode()
        kind = f"{value.dtype.str} {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__
        total.update(f"\n{kind} {len(content)}\n".encode() + content)
    return total.hexdigest()


def pack(layout: NDArray[Any]) -> Packed:
    """A layout as JSON can say it; coordinates fit 32 bits, two metres in nanometres."""
    kind = layout.dtype.name
    steps = np.diff(layout, axis=0, prepend=layout.dtype.type(0)).astype(_TYPES[kind], casting="same_kind")
    return {"type": kind, "shape": list(layout.shape), "steps": b85encode(zlib.compress(steps.tobytes(), 9)).decode()}


def unpack(packed: Packed) -> NDArray[Any] | None:
    """The layout of :func:`pack`; None for what is none."""
    try:
        kind, shape, steps = str(packed["type"]), packed["shape"], zlib.decompress(b85decode(str(packed["steps"])))
        return np.frombuffer(steps, _TYPES[kind]).reshape(tuple(shape)).cumsum(axis=0, dtype=kind)  # type: ignore[arg-type]
    except (KeyError, TypeError, ValueError, zlib.error):
        return None
