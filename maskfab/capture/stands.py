"""Stand of a die before the camera, as options and verdicts name it."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from maskfab.errors import JobError

STANDS: Mapping[str, int] = MappingProxyType({"drawn": 0, "turned": 1, "mirrored": 4, "mirrored-turned": 5})
"""Elements of D4, as :func:`maskfab.model.orient` counts, that take the die as drawn to how the picture shows it; each
stands for itself turned by 180 degrees, too."""

_WORDS = {0: "as drawn", 1: "turned by 90 degrees", 4: "mirrored", 5: "mirrored and turned by 90 degrees"}


def stand_words(way: int) -> str:
    """A stand in words, of its element of D4."""
    return _WORDS[way]


def stand_named(name: str) -> int:
    """The element of D4 of a name.

    Raises:
        JobError: MF105 for a name that none has.
    """
    if name not in STANDS:
        raise JobError(
            "MF105",
            f"{name!r} is no stand of a die",
            where="stands",
            cure=f"Use one of {', '.join(STANDS)}; turned is by 90 degrees",
        )
    return STANDS[name]
