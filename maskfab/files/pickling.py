"""Pickles of what passes from one process to another, read-only views included."""

from __future__ import annotations

import copyreg
import io
import pickle
from types import MappingProxyType
from typing import Any


def pickled(content: object) -> bytes:
    """Bytes that unpickle to an equal value.

    Raises:
        TypeError: for a value that no other process can be given.
    """
    buffer = io.BytesIO()
    pickler = pickle.Pickler(buffer, protocol=pickle.HIGHEST_PROTOCOL)
    pickler.dispatch_table = copyreg.dispatch_table | {MappingProxyType: lambda view: (read_only, (dict(view),))}
    pickler.dump(content)
    return buffer.getvalue()


def read_only(content: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    """A read-only view for unpickling, where its own class has no name to be found by."""
    return MappingProxyType(content)
