"""Terms of the JSON Schemas of documents."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

Document = dict[str, Any]


def closed_object(properties: Mapping[str, Any], optional: Sequence[str] = ()) -> Document:
    """An object of these properties alone, all required but the ``optional`` ones."""
    return {
        "type": "object",
        "properties": dict(properties),
        "required": [name for name in properties if name not in optional],
        "additionalProperties": False,
    }


def or_null(schema: Document) -> Document:
    """The schema, or null in its place."""
    return {"anyOf": [schema, {"type": "null"}]}
