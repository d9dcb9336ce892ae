"""Where the pages of a run lead to one another: from a row to its place on the plate, from a die to its numbers."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from urllib.parse import urlencode

from markupsafe import Markup

from maskfab.base.folders import VIEW
from maskfab.report.documents.shape import Record
from maskfab.report.pages.template import where

_RULES: Mapping[str, str] = MappingProxyType(
    {"corner_touches": "corner_touch", "min_feature": "width", "min_space": "space"}
)
"""Rules of the markers by the quantities that tell whether they are kept."""
_AT = re.compile(r"at \((-?\d+\.\d+), (-?\d+\.\d+)\) um in (?:die (\w+)|the marks)")
"""Place of a broken rule of a mask house, as a method begins."""
_MOST_PLACES = 12


def in_view(row: Record) -> str:
    """Address, in the page that shows the plate, of what a row is about: a broken rule, a point, a die, or all.

    ``rule`` and ``die`` are names, ``x`` and ``y`` micrometres on the plate.
    """
    asked = {"die": row["die"]} if "die" in row else {}
    at = _AT.match(row["method"])
    if row["name"] in _RULES:
        asked = {"rule": _RULES[row["name"]], **asked}
    elif at is not None:
        x, y, die = at.groups()
        asked = {"rule": row["name"], **({"die": die} if die else asked), "x": x, "y": y}
    return f"{VIEW}#{urlencode(asked)}" if asked else VIEW


def linked_places(rows: Iterable[Record]) -> Markup:
    """Places of failed rows as links into the view, each named by its die; the first twelve, and how many more."""
    names: dict[str, str] = {}
    for row in rows:
        names.setdefault(in_view(row), row.get("die", "the plate"))
    links = [Markup('<a href="{}">{}</a>').format(address, name) for address, name in names.items()]
    more = [Markup("{} more").format(len(links) - _MOST_PLACES)] if len(links) > _MOST_PLACES else []
    return Markup(", ").join(links[:_MOST_PLACES] + more)


def where_linked(row: Record) -> Markup:
    """Die, wavelength and level of light of a row, as a link into the view."""
    return Markup('<a href="{}">{}</a>').format(in_view(row), where(row) or "plate")
