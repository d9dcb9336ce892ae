"""A value put into the text of a TOML file, of which nothing else changes.

Text is inserted and nothing is taken away, so comments and the order of lines stay. Where it may go is guessed from how
tables are usually written; a guess counts only if the text with it reads as the values before and the new one.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Iterator, Mapping
from typing import Any

from maskfab.errors import JobError
from maskfab.jobfile.toml import loads, value_text

_NEXT_HEADER = re.compile(r"^[ \t]*\[", re.MULTILINE)
_SILENT = re.compile(r"[ \t\r]*(?:#[^\n]*)?\n?")
"""A line without a value."""


def inserted(text: str, key: str, value: object, *, where: str) -> str:
    """The text with one more value.

    Args:
        text: TOML, with or without a byte order mark.
        key: of the value, with the tables that it is in: ``order.contact.name``.
        value: text, number, truth value, day, or a list or table of these.
        where: the file, for errors.

    Raises:
        JobError: MF105 if the key has a value already, or if its table is written in a way that nothing can be put
            into, with the line to write by hand.
    """
    before, path = _read(text), key.split(".")
    wanted = None if before is None else _with(before, path, value)
    if wanted is None:
        raise JobError("MF105", f"{key} is stated already", where=where, cure=f"Change {key} in the file itself")
    for place, piece in _guesses(text, path, value_text(value)):
        longer = text[:place] + piece + text[place:]
        if _read(longer) == wanted:
            return longer
    table, name = ".".join(path[:-1]), path[-1]
    raise JobError(
        "MF105",
        f"the table {table} is written so that no line can be put into it",
        where=where,
        cure=f"Write {name} = {value_text(value)} into [{table}] by hand",
    )


def _read(text: str) -> dict[str, Any] | None:
    """Values of a text, numbers as they are written; None if it is no TOML."""
    try:
        return loads(text.removeprefix("\ufeff"), parse_float=str)
    except (ValueError, RecursionError):
        return None


def _with(values: Mapping[str, Any], path: list[str], value: object) -> dict[str, Any] | None:
    """The values with one more; None where its place is taken."""
    whole = copy.deepcopy(dict(values))
    table: Any = whole
    for name in path[:-1]:
        table = table.setdefault(name, {})
        if not isinstance(table, dict):
            return None
    if path[-1] in table:
        return None
    # As it will be read.
    table[path[-1]] = str(value) if isinstance(value, float) else value
    return whole


def _guesses(text: str, path: list[str], value: str) -> Iterator[tuple[int, str]]:
    """Places, and what to insert there, the innermost table first."""
    end = "\r\n" if "\r\n" in text else "\n"
    for depth in range(len(path) - 1, 0, -1):
        name, rest = path[depth - 1], f"{'.'.join(path[depth:])} = {value}"
        header = r"[ \t]*\.[ \t]*".join(map(re.escape, path[:depth]))
        for found in re.finditer(rf"^\ufeff?[ \t]*\[[ \t]*{header}[ \t]*\][^\n]*(?:\n|\Z)", text, re.MULTILINE):
            following = _NEXT_HEADER.search(text, found.end())
            last = len(text) if following is None else following.start()
            for place in (_last_value(text, found.end(), last), found.end()):
                before = "" if text[:place].endswith("\n") else end
                yield place, f"{before}{rest}{end}"
        for found in re.finditer(rf"\b{re.escape(name)}[ \t]*=[ \t]*\{{", text):
            yield found.end(), f" {rest},"
            yield found.end(), f" {rest} "
    # Beside a key such as order.glass, which stands before all tables.
    for found in re.finditer(rf"^[ \t]*{re.escape(path[0])}[ \t]*\.", text, re.MULTILINE):
        yield found.start(), f"{'.'.join(path)} = {value}{end}"
    gap = "" if not text else end if text.endswith("\n") else end + end
    yield len(text), f"{gap}[{path[0]}]{end}{'.'.join(path[1:])} = {value}{end}"


def _last_value(text: str, start: int, end: int) -> int:
    """The end of the last line of a piece of text that has a value; its start if none has."""
    lines = text[start:end].splitlines(keepends=True)
    while lines and _SILENT.fullmatch(lines[-1]):
        lines.pop()
    return start + sum(map(len, lines))
