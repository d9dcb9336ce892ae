"""The registry of quantities: name, symbol, unit, title, meaning and cure of every reported number, each written once.

The words stand in ``quantities.json`` beside this file, under headings, in the order of the glossary: JSON, which is
read in a fraction of a millisecond where TOML takes twenty. Values are computed elsewhere;
:class:`maskfab.base.model.Quantity` looks its symbol and unit up here.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache, lru_cache
from pathlib import Path
from types import MappingProxyType

from maskfab.base.errors import InternalError


class Subject(StrEnum):
    """Of a plate, what a check is about; each has its own verdict: one can be ordered that no display fits."""

    FILES = "files"
    OPTICS = "optics"
    DISPLAY = "display"


@dataclass(frozen=True)
class Entry:
    """One registered quantity, or a family of quantities whose names differ in a word.

    Attributes:
        name: as report.json has it; a word in braces, one of :data:`FAMILIES`, stands for what tells the members of a
            family apart.
        symbol: of the formula; empty for counts and words.
        unit: ``1`` for a ratio, empty for counts and words.
        cure: what to do if its check fails.
        subject: whose verdict its check counts for.

    In ``symbol`` or ``unit``, ``{detail}`` stands for what differs from row to row, such as ``6 um`` in ``SE(6 um)``.
    """

    name: str
    symbol: str
    unit: str
    title: str
    meaning: str
    cure: str = ""
    subject: Subject = Subject.FILES

    @property
    def takes_detail(self) -> bool:
        """Whether symbol or unit differ from row to row."""
        return _DETAIL in self.symbol + self.unit

    def member(self, words: Mapping[str, str]) -> Entry:
        """The entry of one member of the family, which keeps the name of the family."""

        def told(text: str) -> str:
            for word, value in words.items():
                text = text.replace(f"{{{word}}}", value.replace("_", " "))
            return text

        return replace(
            self,
            symbol=told(self.symbol),
            unit=told(self.unit),
            title=told(self.title),
            meaning=told(self.meaning),
            cure=told(self.cure),
        )


_DETAIL = "{detail}"

_DATA = json.loads(Path(__file__).with_name("quantities.json").read_text(encoding="utf-8"))

FAMILIES: Mapping[str, str] = MappingProxyType(_DATA["families"])
"""Words of families, and what may stand in their place: a regular expression."""

_WORDS: Mapping[str, Mapping[str, str]] = {
    name: words for group in _DATA["quantities"].values() for name, words in group.items()
}


@cache
def quantities() -> Mapping[str, Entry]:
    """Every entry by its name, in the order of the glossary."""
    return MappingProxyType({name: _entry(name, **words) for name, words in _WORDS.items()})


def columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows of a table as lines of text, the cells of a column below each other."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def _entry(
    name: str, title: str, meaning: str, symbol: str = "", unit: str = "", cure: str = "", subject: str = "files"
) -> Entry:
    """One entry of the file; a cure that begins with ``$`` is one that several share."""
    cure = _DATA["cures"][cure[1:]] if cure.startswith("$") else cure
    return Entry(name, symbol, unit, title, meaning, cure, Subject(subject))


def _pattern(name: str) -> re.Pattern[str]:
    def group(word: re.Match[str]) -> str:
        return f"(?P<{word[1]}>{FAMILIES[word[1]]})"

    return re.compile(re.sub(r"\{(\w+)\}", group, name), re.DOTALL)


@cache
def _families() -> tuple[tuple[re.Pattern[str], str], ...]:
    return tuple((_pattern(name), name) for name in _WORDS if "{" in name)


@lru_cache(maxsize=1024)
def registered(name: str) -> Entry:
    """The entry of a quantity, its family's words filled in."""
    if "{" not in name and name in _WORDS:
        return _entry(name, **_WORDS[name])
    for pattern, family in _families():
        if match := pattern.fullmatch(name):
            return _entry(family, **_WORDS[family]).member(match.groupdict())
    what = f"no quantity {name!r} is registered"
    raise InternalError("MF901", what, cure="Add it to maskfab/base/quantities.json")
