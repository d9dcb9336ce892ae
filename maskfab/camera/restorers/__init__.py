"""Restorers: what undoes the blur of a record. How a record is made is not here, nor how its restoration is scored.

The table of their names is all that this folder loads by itself, so that the door can name them at no cost.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING

from maskfab.base.errors import JobError

if TYPE_CHECKING:
    from maskfab.camera.record import Restorer

FILES: Mapping[str, str] = MappingProxyType(
    {
        "wiener": "wiener",
        "dct+wiener": "dct",
        "gradient": "least_squares",
        "dct+gradient": "dct",
        "tv": "least_squares",
    }
)
"""Names that users give, each with the file here whose ``RESTORERS`` hold it; the first of equally good ones wins."""


def named(names: Sequence[str] = ()) -> tuple[Restorer, ...]:
    """Restorers of these names, each once (MF105 for an unknown one); all of them where none is named."""
    restorers: list[Restorer] = []
    for name in dict.fromkeys(names or FILES):
        if name not in FILES:
            cure = f"Use {', '.join(FILES)} or auto"
            raise JobError("MF105", f"there is no restorer {name!r}", where="restore", cure=cure)
        restorers += (r for r in import_module(f"{__name__}.{FILES[name]}").RESTORERS if r.name == name)
    return tuple(restorers)
