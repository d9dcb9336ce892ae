"""Objects that every verb takes from Python, read from its signature, in words."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from types import MappingProxyType
from typing import Any, NamedTuple

import maskfab

_PANELS = ("Panel", "Opening", "Design with a map")
WORDS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "AnyJob": ("job file", "loaded job", "Plate", *_PANELS, "list or mapping of these"),
        "AnyPanel": _PANELS,
        "AnyReport": ("finished run", "loaded job", "Plate", *_PANELS, "list of these"),
        "DesignJob": ("job file", "loaded job"),
        "AnyPhoto": ("file", "array"),
        "AnyPath": ("path", "result of run"),
        "ArrayLike": ("array",),
        "NDArray[Any]": ("array",),
        "Plate": ("Plate",),
        "Panel": ("Panel",),
        "Tiled": ("Panel",),
        "Opening": ("Opening",),
        "model.Opening": ("Opening",),
        "Tensor": ("tensor",),
        "Brief": ("Brief",),
        "CellMap": ("map",),
        "Path": ("path",),
    }
)
"""Words for the types of :mod:`maskfab.api.asked`, and for others that stand in signatures."""
_VALUES = frozenset(
    {"str", "int", "float", "bool", "None", "Progress", "Length", "Wavelength", "Wavelengths", "Camera", "Any"}
)
_OUTPUTS = frozenset({"out", "place", "images", "checkpoint", "checkpoints", "chart", "masks"})
"""Files that are written, or that go with an object and are none."""


class Taken(NamedTuple):
    """One verb: the objects that its parameters take, in words, and whether it takes a camera."""

    verb: str
    parameters: Mapping[str, tuple[str, ...]]
    camera: bool


def verbs() -> Iterator[tuple[str, Callable[..., Any]]]:
    """Public functions that take something, by their names as they are called after ``mf.``."""
    for name, module in maskfab.WHERE.items():
        held = getattr(maskfab, name)
        if inspect.ismodule(held):
            inner = vars(import_module(f"{module}.{name}"))
            functions = (part for part in inner.items() if inspect.isfunction(part[1]) and part[0][:1] != "_")
            yield from (
                (f"{name}.{part}", function) for part, function in functions if function.__module__ == held.__name__
            )
        elif inspect.isfunction(held):
            yield name, held


def taken() -> list[Taken]:
    """Every verb that takes an object, in the order of the public names."""
    rows = []
    for verb, function in verbs():
        parameters = inspect.signature(function).parameters
        words = {name: _words(str(held.annotation)) for name, held in parameters.items() if name not in _OUTPUTS}
        objects = {name: found for name, found in words.items() if set(found) - {"path"}}
        if objects:
            rows.append(Taken(verb, objects, "camera" in parameters))
    return rows


def _words(annotation: str) -> tuple[str, ...]:
    """Words for the types in an annotation, each once."""
    names = re.findall(r"NDArray\[Any\]|[A-Za-z_][\w.]*", re.sub(r'"[^"]*"', "", annotation))
    return tuple(dict.fromkeys(word for name in names for word in WORDS.get(name, ())))
