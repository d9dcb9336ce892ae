"""TOML: plain data as text, and text within limits; what takes Python's reader more than linear time is refused."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable, Mapping
from datetime import date
from typing import Any

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
    bare = _SPOKEN.sub(lambda found: "" if found[0].startswith("#") else "s", text)
    _limit("characters besides strings and comments", len(bare), _MOST_BARE)
    _limit("keys and values", bare.count("=") + bare.count(",") + bare.count("\n["), MOST_VALUES)
    if (found := _DOTTED.search(bare)) is not None:
        line = bare.count("\n", 0, found.start()) + 1
        raise tomllib.TOMLDecodeError(f"a key of more than {MOST_PARTS} parts, near line {line}")
    _limit("arrays or tables in each other", _depth(bare), MOST_LEVELS)
    return tomllib.loads(text, parse_float=parse_float)


def _limit(what: str, found: int, most: int) -> None:
    if found > most:
        raise tomllib.TOMLDecodeError(f"{found} {what}; at most {most} are read")


def _depth(bare: str) -> int:
    """Largest number of brackets that are open at once."""
    depth = most = 0
    for found in _BRACKETS.finditer(bare):
        opens = found[0][0] in "[{"
        depth = depth + len(found[0]) if opens else max(0, depth - len(found[0]))
        most = max(most, depth)
    return most


def dumps(data: Mapping[str, object]) -> str:
    """Plain values first, then a table for each mapping; mappings within these stand on one line.

    Equal data have equal texts.
    """
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
        return f"{{ {', '.join(f'{value_text(key)} = {value_text(each)}' for key, each in value.items())} }}"
    if isinstance(value, str):
        # TOML escapes what JSON does, and the one control character that JSON leaves as it is.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, date):
        return value.isoformat()
    return str(value).lower() if isinstance(value, bool) else repr(value)
