"""TOML: text read within limits, plain data as text, and one more value put into the text of a file.

Text that takes Python's reader more than linear time is refused. A value is inserted and nothing is taken away, so
comments and the order of lines stay. Where it may go is guessed from how tables are usually written; a guess counts
only if the text with it reads as the values before and the new one.
"""

from __future__ import annotations

import copy
import json
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from datetime import date
from typing import Any

from maskfab.base.errors import JobError

MOST_CHARACTERS = 20_000_000
"""Of a file; the drawing of the largest opening has 17 million."""
_MOST_OF = {"\n": 200_000, '"': 400_000, "'": 400_000, "\\": 400_000}
"""Of characters that cost time each; that drawing has 4096 lines."""
_MOST_BARE = 2_000_000
"""Characters besides strings and comments."""
MOST_VALUES = 200_000
"""Keys and items of arrays; each takes some microseconds here, and again when it is judged."""
MOST_PARTS = 32
"""Of a dotted key, whose time grows with the cube of them."""
MOST_LEVELS = 64
"""Of arrays and inline tables in each other."""

_SPOKEN = re.compile(
    r'#[^\n]*|"""(?:[^"\\]|\\.|"(?!""))*+(?:"{3,5}|\\?\Z)|\'\'\'(?:[^\']|\'(?!\'\'))*+(?:\'{3,5}|\Z)'
    r'|"(?:[^"\\\n]|\\[^\n])*+(?:"|\\?$)|\'[^\'\n]*+(?:\'|$)',
    re.DOTALL | re.MULTILINE,
)
"""Comments and strings; one that never ends, which is no TOML, goes on to the end, so that none is looked at twice."""
_DOTTED = re.compile(rf"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){{{MOST_PARTS}}}")
_BRACKETS = re.compile(r"[\[{]++|[\]}]++")


def loads(text: str, parse_float: Callable[[str], Any] = float) -> dict[str, Any]:
    """As :func:`tomllib.loads`, in a time that grows with the text only.

    Raises:
        ValueError: for what is no TOML, or longer, deeper or with more keys than any file of ours.
        RecursionError: never for a text within the limits.
    """
    _limit("characters", len(text), MOST_CHARACTERS)
    for character, most in _MOST_OF.items():
        _limit(f"times {character!r}", text.count(character), most)
    # A string in a key is a part of it, and one anywhere else a word.
    bare = _SPOKEN.sub(lambda match: "" if match[0].startswith("#") else "s", text)
    _limit("characters besides strings and comments", len(bare), _MOST_BARE)
    _limit("keys and values", bare.count("=") + bare.count(",") + bare.count("\n["), MOST_VALUES)
    if (match := _DOTTED.search(bare)) is not None:
        line = bare.count("\n", 0, match.start()) + 1
        raise tomllib.TOMLDecodeError(f"a key of more than {MOST_PARTS} parts, near line {line}")
    _limit("arrays or tables in each other", _depth(bare), MOST_LEVELS)
    return tomllib.loads(text, parse_float=parse_float)


def _limit(what: str, number: int, most: int) -> None:
    if number > most:
        raise tomllib.TOMLDecodeError(f"{number} {what}; at most {most} are read")


def _depth(bare: str) -> int:
    depth = most = 0
    for run in _BRACKETS.finditer(bare):
        opens = run[0][0] in "[{"
        depth = depth + len(run[0]) if opens else max(0, depth - len(run[0]))
        most = max(most, depth)
    return most


def dumps(data: Mapping[str, object]) -> str:
    """Plain values first, then a table for each mapping, one line for those within; equal data, equal texts."""
    tables = {key: value for key, value in data.items() if isinstance(value, Mapping)}
    lines = [f"{key} = {value_text(value)}" for key, value in data.items() if key not in tables]
    for name, table in tables.items():
        lines += [
            *([""] if lines else []),
            f"[{name}]",
            *(f"{key} = {value_text(value)}" for key, value in table.items()),
        ]
    return "\n".join(lines) + "\n"


def value_text(value: object) -> str:
    """A value as TOML writes it."""
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(value_text, value))}]"
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{value_text(key)} = {value_text(item)}' for key, item in value.items())} }}"
    if isinstance(value, str):
        # TOML escapes what JSON does, and the one control character that JSON leaves as it is.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, date):
        return value.isoformat()
    return str(value).lower() if isinstance(value, bool) else repr(value)


_NEXT_HEADER = re.compile(r"^[ \t]*\[", re.MULTILINE)
_SILENT = re.compile(r"[ \t\r]*(?:#[^\n]*)?\n?")
"""A line without a value."""


def inserted(text: str, key: str, value: object, *, where: str) -> str:
    """The text with one more value.

    Args:
        text: TOML, with or without a byte order mark.
        key: of the value, with the tables that it is in: ``order.contact.name``.
        value: text, number, truth value, day, or a list or table of these.

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
    what = f"the table {table} is written so that no line can be put into it"
    raise JobError("MF105", what, where=where, cure=f"Write {name} = {value_text(value)} into [{table}] by hand")


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
    end = "\r\n" if "\r\n" in text else "\n"
    for depth in range(len(path) - 1, 0, -1):
        name, rest = path[depth - 1], f"{'.'.join(path[depth:])} = {value}"
        header = r"[ \t]*\.[ \t]*".join(map(re.escape, path[:depth]))
        for match in re.finditer(rf"^\ufeff?[ \t]*\[[ \t]*{header}[ \t]*\][^\n]*(?:\n|\Z)", text, re.MULTILINE):
            following = _NEXT_HEADER.search(text, match.end())
            last = len(text) if following is None else following.start()
            for place in (_last_value(text, match.end(), last), match.end()):
                before = "" if text[:place].endswith("\n") else end
                yield place, f"{before}{rest}{end}"
        for match in re.finditer(rf"\b{re.escape(name)}[ \t]*=[ \t]*\{{", text):
            yield match.end(), f" {rest},"
            yield match.end(), f" {rest} "
    # Beside a key such as order.glass, which stands before all tables.
    for match in re.finditer(rf"^[ \t]*{re.escape(path[0])}[ \t]*\.", text, re.MULTILINE):
        yield match.start(), f"{'.'.join(path)} = {value}{end}"
    gap = "" if not text else end if text.endswith("\n") else end + end
    yield len(text), f"{gap}[{path[0]}]{end}{'.'.join(path[1:])} = {value}{end}"


def _last_value(text: str, start: int, end: int) -> int:
    """The end of the last line of a piece of text that has a value; its start if none has."""
    lines = text[start:end].splitlines(keepends=True)
    while lines and _SILENT.fullmatch(lines[-1]):
        lines.pop()
    return start + sum(map(len, lines))
