"""Fingerprints of values: equal only for values from which the same is found."""

from __future__ import annotations

import functools
import hashlib
import struct
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from datetime import date
from enum import Enum
from itertools import chain
from pathlib import Path
from types import BuiltinFunctionType, FunctionType
from typing import Any, Protocol

import numpy as np
from pydantic import BaseModel

from maskfab import provenance, resources

_PLAIN = frozenset({int, float, bool, str, type(None)})


class _Sum(Protocol):
    def update(self, data: bytes, /) -> None: ...


def fingerprint(*values: object) -> str:
    """Hexadecimal SHA-256 of values and of their types.

    The order of a mapping counts: what is made of it may be in that order.

    Raises:
        TypeError: for a value that may be more than its fields show.
    """
    found = hashlib.sha256()
    for value in values:
        _add(found, value)
    return found.hexdigest()


@functools.cache
def of_installation() -> str:
    """Hexadecimal SHA-256 of this program's own files and of the versions of all libraries that it uses."""
    found = hashlib.sha256()
    _add(found, sorted(provenance.versions(extras=True).items()))
    for folder in (Path(resources.__file__).resolve().parent, resources.path("export_templates")):
        for path in sorted(each for each in folder.rglob("*") if each.is_file() and each.suffix != ".pyc"):
            _add(found, (path.relative_to(folder).as_posix(), path.read_bytes()))
    return found.hexdigest()


def _add(found: _Sum, value: object) -> None:
    kind, content = _leaf(value) or _parts(value)
    if isinstance(content, bytes):
        # Kind and length come first, so that no two sequences of values read alike.
        found.update(f"{kind} {len(content)}\n".encode() + content)
        return
    found.update(f"{kind} of {len(content)}\n".encode())
    for part in content:
        _add(found, part)


def _leaf(value: object) -> tuple[str, bytes] | None:
    """Kind and content of a value that has no parts; None of one that has."""
    match value:
        case date():
            return type(value).__name__, value.isoformat().encode()
        case Enum():
            return _name(type(value)), value.name.encode()
        case None | bool() | int():
            return type(value).__name__, repr(value).encode()
        case float():
            return "float", struct.pack("<d", value)
        case complex():
            return "complex", struct.pack("<dd", value.real, value.imag)
        case str():
            return "str", value.encode("utf-8", "surrogatepass")
        case bytes():
            return "bytes", value
        case np.generic() | np.ndarray():
            return _array(np.asarray(value))
        case FunctionType() | BuiltinFunctionType() | type():
            return _function(value)
        case tuple() if _is_plain(value):
            return "plain", repr(value).encode("utf-8", "surrogatepass")
    return _region(value)


def _region(value: object) -> tuple[str, bytes] | None:
    """Kind and content of a region; None of anything else, for which klayout need not be loaded."""
    if not type(value).__module__.startswith("klayout."):
        return None
    from klayout import db

    return ("region", value.to_s(2**31 - 1).encode()) if isinstance(value, db.Region) else None


def _parts(value: object) -> tuple[str, list[Any]]:
    """Kind and parts of a value."""
    name = _name(type(value))
    match value:
        case tuple() | list():
            return name, list(value)
        case frozenset() | set():
            return name, sorted(fingerprint(each) for each in value)
        case Mapping():
            return "mapping", list(value.items())
        case functools.partial():
            return name, [value.func, value.args, value.keywords]
        case BaseModel():
            return name, [(field, getattr(value, field)) for field in type(value).model_fields]
        case _ if is_dataclass(value):
            return name, [(field.name, getattr(value, field.name)) for field in fields(value)]
    raise TypeError(f"a {name} has no fingerprint")


def _is_plain(value: tuple[Any, ...]) -> bool:
    """Whether a tuple, such as the vertices of a polygon, holds nothing but words and numbers, or tuples of them."""
    kinds = set(map(type, value))
    if kinds == {tuple}:
        kinds = set(map(type, chain.from_iterable(value)))
    return type(value) is tuple and kinds <= _PLAIN


def _array(array: np.ndarray[Any, Any]) -> tuple[str, bytes]:
    if array.dtype.hasobject:
        raise TypeError("an array of objects has no fingerprint")
    # Sums depend on the order in memory, so arrays that only compare equal are told apart.
    order = "F" if array.flags.f_contiguous and not array.flags.c_contiguous else "C"
    return f"array {array.dtype.str} {array.shape} {order}", array.tobytes()


def _function(value: FunctionType | BuiltinFunctionType | type) -> tuple[str, bytes]:
    if "<" in value.__qualname__:
        raise TypeError(f"the function {value.__qualname__} has no name to be found by")
    return "function", f"{value.__module__}.{value.__qualname__}".encode()


def _name(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"
