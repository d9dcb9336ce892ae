"""All restorers, by the names that users give."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from maskfab.camera.restorers.dct import Dct
from maskfab.camera.restorers.gradient import Gradient
from maskfab.camera.restorers.restorer import Restorer
from maskfab.camera.restorers.tv import TotalVariation
from maskfab.camera.restorers.wiener import Wiener
from maskfab.errors import JobError

RESTORERS: Mapping[str, Restorer] = MappingProxyType(
    {each.name: each for each in (Wiener(), Dct(), Gradient(), Dct(Gradient()), TotalVariation())}
)


def named(names: tuple[str, ...]) -> tuple[Restorer, ...]:
    """Restorers of these names, each once.

    Raises:
        JobError: MF105 for a name that none has.
    """
    for name in names:
        if name not in RESTORERS:
            known = ", ".join(RESTORERS)
            raise JobError("MF105", f"there is no restorer {name!r}", where="restore", cure=f"Use {known} or auto")
    return tuple(RESTORERS[name] for name in dict.fromkeys(names))
