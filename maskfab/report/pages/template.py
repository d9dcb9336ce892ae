"""Parts that pages share: reading of templates, their look, rows as cells, links, and a glossary of the trade's words.

Quantities have their own glossary in :mod:`maskfab.base.quantities`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any
from urllib.parse import urlencode

from jinja2 import Environment, StrictUndefined, Template
from markupsafe import Markup

from maskfab.base.folders import VIEW, Place, staged, write_mark
from maskfab.base.quantities import registered
from maskfab.base.resources import template
from maskfab.report.documents.numbers import Methods
from maskfab.report.documents.shape import Record
from maskfab.report.text import EXACT, rounded, short, value_and_error


def write_folder(
    place: Place, texts: Mapping[str, str], job_hash: str | None, more: Callable[[Path], None] = lambda _: None
) -> list[Path]:
    """Write texts by their names, and what ``more`` writes, into a directory that appears whole; return the paths."""
    with staged(place) as folder:
        for name, text in texts.items():
            (folder / name).write_text(text, encoding="utf-8")
        more(folder)
        write_mark(folder, job_hash)
    return sorted(place.asked.iterdir())


def page_environment(**filters: Callable[..., Any]) -> Environment:
    """Texts are escaped, a name that nobody gives is an error, and lines that only steer leave nothing behind."""
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )
    environment.filters.update(filters)
    return environment


_UNITS: Mapping[str, str] = MappingProxyType({"1": "", "um": "µm", "um^2": "µm²"})


def value(row: Record) -> str:
    """The value to the digits that its error allows; a bound says so."""
    text, _ = value_and_error(row["value"], row["uncertainty"], row["unit"])
    return f"≤ {text}" if "at_most" in row else text


def plusminus(row: Record) -> str:
    """The error bar with its sign; a word where it is rounding alone, nothing where there is none."""
    _, error = value_and_error(row["value"], row["uncertainty"], row["unit"])
    return error if error in ("", EXACT) else f"± {error}"


def unit(row: Record) -> str:
    """The unit as a reader writes it; a plain number has none."""
    return _UNITS.get(row["unit"], row["unit"])


def amount(text: str, row: Record) -> str:
    """A number's text with the unit of its row, if it has one."""
    return f"{text} {unit(row)}".rstrip()


def full(row: Record) -> str:
    """The value with every digit that report.json has."""
    error = f" ± {row['uncertainty']!r}" if row["uncertainty"] else ""
    return f"{row['value']!r}{error} {unit(row)}".rstrip()


def limit_text(row: Record) -> str:
    """The limit with the side on which a value must lie, as far as value and verdict tell it."""
    bound, value = row["limit"], row["value"]
    if bound is None:
        return "–"
    if isinstance(bound, str) or isinstance(value, str) or value is None or abs(value) == bound:
        return short(bound)
    return f"{'≤' if (abs(value) < bound) == bool(row['passed']) else '≥'} {short(bound)}"


def verdict(row: Record) -> str:
    """Pass or fail in words, since colour alone does not reach everybody; a dash where nothing was required."""
    return "–" if row["passed"] is None else "✓ pass" if row["passed"] else "✗ FAIL"


def where(row: Record) -> str:
    """Die, wavelength and level of light of a row, as far as it has them."""
    places = [row["die"]] if "die" in row else []
    places += [f"{row['wavelength_nm']:g} nm"] if "wavelength_nm" in row else []
    return ", ".join(places + ([f"{row['level_db']:g} dB"] if "level_db" in row else []))


def decibel(value: float) -> str:
    """A number of decibels of which no error is known."""
    return value_and_error(float(value), None, "dB")[0]


ROW_FILTERS: Mapping[str, Callable[..., Any]] = MappingProxyType(
    {
        "number": rounded, "short": short, "amount": amount, "full": full, "value": value, "plusminus": plusminus,
        "unit": unit, "limit": limit_text, "term": registered, "verdict": verdict, "where": where, "decibel": decibel,
    }
)  # fmt: skip
"""By which the pages of a run tell rows of report.json."""


def references(listed: Methods, page: str = "") -> Callable[[Iterable[Record | None]], Markup]:
    """Writes the keys of the methods of some rows, each a link into the list of methods on ``page`` ("": this one)."""

    def keys(rows: Iterable[Record | None]) -> Markup:
        own = dict.fromkeys(key for row in rows if row is not None and (key := listed.of(row)[0]))
        return Markup(" ").join(Markup('<a href="{}#{}">{}</a>').format(page, key, key) for key in own)

    return keys


@cache
def page_template(name: str, **filters: Callable[..., Any]) -> Template:
    """A page by its file in export_templates/, compiled once; ``number`` rounds, ``told`` does so by the error."""
    return page_environment(number=rounded, told=value_and_error, **filters).from_string(template(name))


@cache
def style() -> Markup:
    """The look of every page."""
    return Markup(template("page.css"))


WORDS: Mapping[str, str] = json.loads(template("words.json"))


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
