"""Words of OpenImageIO about a picture that it cannot read."""

from __future__ import annotations

from typing import Any


def said_by(library: Any) -> str:
    """Error message of OpenImageIO or of one of its files; it repeats content of the file, which may be no text."""
    try:
        return str(library.geterror())
    except UnicodeDecodeError:
        return "a name or an entry in it is no text"
