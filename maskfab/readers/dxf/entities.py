"""Shapes of a text DXF that some programs hide or place differently.

A plot shows paper space or the model but not both, and neither frozen layers nor what is invisible; a mask is made of
what is left. Readers of DXF take all of it for one drawing, and look at shapes that stand upright from the side, each
without a word. So what is drawn has to lie in model space, in its plane, and in sight.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable

from maskfab.readers.dxf.text_entities import Entity, codes

_PAPER = ("*PAPER_SPACE", "$PAPER_SPACE")
_FROZEN = 1
_HIDING = codes(60, 67, 210, 220, 230)
_IN_PLANE = 1e-9
"""Directions are written with so many digits that those along z are closer to it."""


class Unseen:
    """Entities that draw or place something out of sight, collected one by one."""

    def __init__(self) -> None:
        self._layers: dict[str, str] = {}
        self._drawn: Counter[tuple[str, str, str, str]] = Counter()

    def add_layer(self, entry: Entity) -> None:
        """Take an entry of the table of layers, which may stand behind what is drawn on it."""
        if int(entry.number(70)) & _FROZEN:
            self._layers[entry.text(2).upper()] = "the frozen "
        elif entry.number(62) < 0:
            self._layers[entry.text(2).upper()] = "the switched-off "

    def add(self, entity: Entity) -> None:
        """Take an entity that draws, or places a block."""
        placed = entity.text(2) if entity.kind == "INSERT" else ""
        self._drawn[entity.kind, entity.layer, placed, _out_of_sight(entity)] += 1

    def told(self, counts: Callable[[str], bool], drawing: set[str]) -> list[str]:
        """Hidden shapes with the reason, in words.

        Args:
            counts: whether the geometry on a layer of that name does.
            drawing: the blocks that hold geometry that counts.
        """
        found: Counter[str] = Counter()
        for (kind, layer, placed, why), count in self._drawn.items():
            hidden = self._layers.get(layer.upper(), "")
            if (why or hidden) and (placed in drawing if placed else counts(layer)):
                found[f"{kind}{why} on {hidden}layer {layer!r}"] += count
        return [f"{count} x {what}" for what, count in sorted(found.items())]


def _out_of_sight(entity: Entity) -> str:
    if (entity.block or "").upper().startswith(_PAPER):
        return " in paper space"
    if not entity.says(_HIDING):
        return ""
    if entity.number(67) == 1:
        return " in paper space"
    if entity.number(60) == 1:
        return " made invisible"
    x, y, z = entity.number(210), entity.number(220), entity.number(230, 1.0)
    if not math.hypot(x, y) < _IN_PLANE * abs(z):
        return " out of the plane"
    return ""
