"""The cache of runs: what is kept, and room for more."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.runs.store import VARIABLE, Entry, Store

_UNITS = {"kB": 1e3, "MB": 1e6, "GB": 1e9}
_DAY_S = 86400


@dataclass(frozen=True, repr=False)
class Kept:
    """Findings of earlier runs, which later ones take from there.

    Attributes:
        folder: that holds it; None where the cache is off, or has no place that only its owner may write.
        entries: everything that is kept.
        removed: just now; None if nothing was to be.
    """

    folder: Path | None
    entries: tuple[Entry, ...]
    removed: tuple[Entry, ...] | None = None

    def to_dict(self) -> dict[str, Any]:
        """Numbers and bytes, by kind."""
        kinds = {what: _sums(each) for what, each in sorted(_by_kind(self.entries).items())}
        folder = None if self.folder is None else str(self.folder)
        return {"folder": folder, "kept": kinds, "removed": None if self.removed is None else _sums(self.removed)}

    def __str__(self) -> str:
        if self.folder is None:
            return f"The cache is off, or has no place that only you may write; {VARIABLE} names another folder."
        now = time.time()
        lines = [str(self.folder)]
        for what, each in sorted(_by_kind(self.entries).items(), key=lambda item: -_sums(item[1])["bytes"]):
            days = (now - max(entry.used for entry in each)) / _DAY_S
            lines.append(_line(each, f"{what}, used {days:.1f} days ago"))
        lines.append(_line(self.entries, "in all"))
        return "\n".join(lines if self.removed is None else [*lines, _line(self.removed, "removed")])

    def __repr__(self) -> str:
        return str(self)


@checked_arguments
def cache(limit: str | None = None) -> Kept:
    """Tell what earlier runs have found, and remove what was used longest ago.

    Examples:
        >>> import maskfab as mf
        >>> print(mf.cache(limit="1 GB"))                                              # doctest: +SKIP

    Args:
        limit: size that the rest may take, such as ``"1 GB"``; None removes nothing.

    Raises:
        JobError: MF105 for what is no size.
    """
    most, store = None if limit is None else _bytes(limit), Store.of_user()
    if store is None:
        return Kept(None, ())
    removed = None if most is None else store.prune(most)
    return Kept(store.folder, tuple(store.entries()), removed)


def _by_kind(entries: Iterable[Entry]) -> dict[str, list[Entry]]:
    kinds: dict[str, list[Entry]] = {}
    for entry in entries:
        kinds.setdefault(entry.what, []).append(entry)
    return kinds


def _sums(entries: Iterable[Entry]) -> dict[str, int]:
    sizes = [entry.bytes for entry in entries]
    return {"entries": len(sizes), "bytes": sum(sizes)}


def _line(entries: Iterable[Entry], words: str) -> str:
    sums = _sums(entries)
    return f"{sums['bytes'] / 1e6:9.1f} MB  {sums['entries']:6}  {words}"


def _bytes(text: str) -> int:
    number, _, unit = text.strip().partition(" ")
    try:
        value = float(number)
        value *= 1.0 if value == 0 and not unit else _UNITS[unit.strip()]
    except (ValueError, KeyError):
        value = math.nan
    if not (math.isfinite(value) and value >= 0):
        raise JobError("MF105", f"{text!r} is no size", where="limit", cure="Give a number and kB, MB or GB: '1 GB'")
    return int(value)
