"""What is dear and follows from its arguments alone, done once of equal ones, for tests that are about something else.

Drawing figures takes more than half of a small run and of a package, and the bounds of an opening most of a short
design. Where one argument differs in anything, the work is done.
"""

from __future__ import annotations

import copyreg
import hashlib
import io
import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from importlib import import_module
from types import MappingProxyType
from typing import Any

import pytest

from maskfab.camera.scenes import dead_leaves, indoors
from maskfab.processes import read_only

FIGURES = (
    "maskfab.report.plots.die_figures.pictures",
    "maskfab.report.plots.die_figures.overview",
    "maskfab.delivery.papers.drawing_sheet",
)
BOUNDS = ("maskfab.optimiser.result.bounds",)

leaves = cache(dead_leaves)
"""The scene of a seed and a size, drawn once by each process. Nobody writes into it."""

dimmed = cache(indoors)
"""The same scene indoors."""

_KNOWN: dict[tuple[str, bytes], Any] = {}


@contextmanager
def once(*places: str) -> Iterator[None]:
    """Within this, functions, each as ``module.name``, answer to equal arguments what they answered before."""
    with pytest.MonkeyPatch.context() as patch:
        for place in places:
            module, _, name = place.rpartition(".")
            patch.setattr(place, partial(_remembered, place, getattr(import_module(module), name)))
        yield


def _remembered(place: str, work: Callable[..., Any], *given: object, **named: object) -> Any:
    key = place, _digest((given, named))
    if key not in _KNOWN:
        _KNOWN[key] = work(*given, **named)
    return _KNOWN[key]


def _digest(content: object) -> bytes:
    """The same for equal contents, whichever of them are one object."""
    buffer = io.BytesIO()
    pickler = pickle.Pickler(buffer)
    pickler.fast = True
    pickler.dispatch_table = copyreg.dispatch_table | {MappingProxyType: lambda view: (read_only, (dict(view),))}
    pickler.dump(content)
    return hashlib.sha256(buffer.getbuffer()).digest()
