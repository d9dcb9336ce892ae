"""Boxes of drive circuits as a display's maker states them: sizes, gaps, and how many a pixel holds."""

from __future__ import annotations

from dataclasses import dataclass

from maskfab.base.errors import JobError
from maskfab.base.units import NM_PER_UM


@dataclass(frozen=True)
class BoxKind:
    """Boxes of one size in one circuit, contacts included."""

    name: str
    width_nm: int
    height_nm: int
    count: int = 1


@dataclass(frozen=True)
class BoxRules:
    """Boxes of a pixel's drive circuits, one for each subpixel, and their gaps; pixels may take turns at a circuit."""

    kinds: tuple[BoxKind, ...]
    gap_nm: int
    to_opening_nm: int
    turnable: bool = True
    circuits: int = 3
    shared_by: int = 1

    @property
    def held(self) -> int:
        """Circuits that every pixel holds, all pixels being drawn alike."""
        return -(-self.circuits // self.shared_by)

    @property
    def boxes(self) -> int:
        """Boxes that every pixel holds."""
        return self.held * sum(kind.count for kind in self.kinds)

    def margin_nm(self, gutter_nm: int) -> int:
        """From the sides of the pixel less its gutter to boxes: enough for any two neighbours to keep the gap."""
        return max(0, -(-(self.gap_nm - gutter_nm) // 2))

    @property
    def area_um2(self) -> float:
        """Area of a pixel's boxes, gaps left out."""
        return self.held * sum(kind.count * kind.width_nm * kind.height_nm for kind in self.kinds) / NM_PER_UM**2


def check_boxes(rules: BoxRules, side_nm: int) -> None:
    """Refuse boxes and gaps that no pixel can hold.

    Args:
        side_nm: of a pixel less its gutter.
    """
    side_um = side_nm / NM_PER_UM
    lengths = [
        (f"the {name} of box {kind.name!r}", length_nm, "boxes")
        for kind in rules.kinds
        for name, length_nm in (("width", kind.width_nm), ("height", kind.height_nm))
    ]
    lengths += [("gap", rules.gap_nm, "gap"), ("gap_to_opening", rules.to_opening_nm, "gap_to_opening")]
    for name, length_nm, key in lengths:
        if length_nm > side_nm:
            what = f"{name} = {length_nm / NM_PER_UM:g} um is wider than the {side_um:g} um of a pixel less its gutter"
            raise JobError("MF117", what, where=f"circuits.{key}", cure=f"Give a length up to {side_um:g} um")
