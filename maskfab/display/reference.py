"""The reference display of a job: its maker's regular layout, without openings, at the pitch of a die.

Emitters are as large as the job's own rules let them be, and are never turned. The gap between colours is kept on every
side of an emitter, to its own colour too, for pixels that are driven apart have electrodes apart. Three layouts:

* stripe: red, green and blue upright side by side, each as high as the pixel less a gap;
* pentile: a square of green in the middle of every pixel, squares of red and of blue on its corners, each shared by
  four pixels, so that a pixel has two emitters: the diamond of phones, its rhombi as squares since gaps here are kept
  in x or in y;
* delta: rows of red, green and blue two thirds of a pixel apart and half a pixel high, every other one shifted by one
  and a half of them.

Every pixel of each holds as much red, green and blue as any other, which for pentile and delta is a mirror image of its
neighbour, so that a reference is tiled as panels are, and shows any picture pixel by pixel.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from maskfab.base.arrays import Indices
from maskfab.base.errors import JobError
from maskfab.base.model import COLOURS
from maskfab.base.units import NM_PER_UM
from maskfab.display.drive import Triple
from maskfab.display.emitted_light import Tile, Tiled
from maskfab.display.emitter_rules import EmitterRules

Box = tuple[float, float, float, float]
"""x0, y0, x1, y1 in pixels, from the pixel's lower left corner."""
Drawn = tuple[list[list[Box]], float]
"""Boxes of red, green and blue, which may reach beyond the pixel, and the least width of any emitter, in pixels."""

_UPRIGHT, _MIRRORED, _UPSIDE_DOWN = 0, 4, 6


@dataclass(frozen=True, eq=False)
class Reference:
    """A regular display without openings.

    Attributes:
        turns: int [2, 2], element of D4 of the pixels of a square that repeats, row 0 the lowest.
    """

    layout: str
    pitch_nm: int
    tile: Tile
    turns: Indices

    @classmethod
    def of(cls, layout: str, pitch_nm: int, rules: EmitterRules, *, where: str = "looks.reference") -> Reference:
        """The layout by a job's rules; MF117 if an emitter would be narrower than ``min_width``."""
        draw, turns = _LAYOUTS[layout]
        boxes, least = draw(rules.colour_gap_nm / pitch_nm, rules.ratio)
        # Floating point may lose the last part of a nanometre.
        if least * pitch_nm < rules.min_width_nm - 1e-6:
            width = max(0.0, least * pitch_nm / NM_PER_UM)
            what = (
                f"{layout} at a pitch of {pitch_nm / NM_PER_UM:g} um with colour_gap = "
                f"{rules.colour_gap_nm / NM_PER_UM:g} um leaves emitters {width:.4g} um wide, and min_width is "
                f"{rules.min_width_nm / NM_PER_UM:g} um"
            )
            others = " or ".join(f'"{name}"' for name in LAYOUTS if name != layout)
            cure = f"Use a larger pitch, a smaller colour_gap or min_width of [emitters], or reference = {others}"
            raise JobError("MF117", what, where=where, cure=cure)
        return cls(layout, pitch_nm, _tile(boxes), np.array(turns, dtype=np.intp))

    @property
    def shares(self) -> Triple:
        """Share of a pixel that red, green and blue cover."""
        return self.tile.shares

    def beside(self, across: int) -> Reference:
        """So many of its pixels along each side as one, as a display has them beside larger ones."""
        if across == 1:
            return self
        # Turned pixels have their lines where others have.
        lines = np.concatenate([[0.0], *(self.tile.lines[1:] + step for step in range(across))]) / across
        held = np.tile(self.turns, (across, across))[:across, :across]
        labels = np.block([[self.tile.turned(int(turn)).labels for turn in row] for row in held])
        # An even number repeats itself, and an odd one has its neighbour's mirror image, as a pixel has.
        turns = self.turns if across % 2 else np.zeros_like(self.turns)
        return Reference(self.layout, self.pitch_nm * across, Tile(labels, lines), turns)

    def tiled(self, rows: int, columns: int) -> Tiled:
        """So many of its pixels."""
        kinds = np.unique(self.turns)
        square = np.searchsorted(kinds, self.turns)
        held = np.tile(square, (-(-rows // 2), -(-columns // 2)))[:rows, :columns]
        return Tiled(tuple(self.tile.turned(int(kind)) for kind in kinds), held, self.pitch_nm / NM_PER_UM)


def _stripe(gap: float, ratio: Triple) -> Drawn:
    widths = [part / 3 * (1 - 3 * gap) for part in ratio]
    left, boxes = gap / 2, []
    for width in widths:
        boxes.append([(left, gap / 2, left + width, 1 - gap / 2)])
        left += width + gap
    return boxes, min(*widths, 1 - gap)


def _pentile(gap: float, ratio: Triple) -> Drawn:
    # Areas of a pixel: one square of green, half a square of red and of blue.
    red, green, blue = math.sqrt(2 * ratio[0]), math.sqrt(ratio[1]), math.sqrt(2 * ratio[2])
    larger = max(red, blue)
    scale = min((1 - 2 * gap) / (larger + green), 2 * (1 - gap) / (red + blue), (1 - gap) / larger)
    sides = [side * scale for side in (red, green, blue)]
    places = ([(0.0, 0.0), (1.0, 1.0)], [(0.5, 0.5)], [(1.0, 0.0), (0.0, 1.0)])
    return [[_about(x, y, side, side) for x, y in middles] for middles, side in zip(places, sides, strict=True)], min(
        sides
    )


def _delta(gap: float, ratio: Triple) -> Drawn:
    pairs = ((0, 1), (1, 2), (2, 0))
    scale = min((2 / 3 - gap) * 2 / (ratio[one] + ratio[other]) for one, other in pairs)
    widths, height = [part * scale for part in ratio], 0.5 - gap
    boxes = []
    for index, width in enumerate(widths):
        middle = 1 / 6 + index * 2 / 3
        # The upper row is one pixel on; both repeat every two.
        places = [(middle + off, 0.25) for off in (-2, 0)] + [(middle + 1 + off, 0.75) for off in (-2, 0)]
        boxes.append([_about(x, y, width, height) for x, y in places])
    return boxes, min(*widths, height)


def _about(x: float, y: float, width: float, height: float) -> Box:
    return x - width / 2, y - height / 2, x + width / 2, y + height / 2


_LAYOUTS: Mapping[str, tuple[Callable[[float, Triple], Drawn], tuple[tuple[int, int], tuple[int, int]]]] = (
    MappingProxyType(
        {
            "stripe": (_stripe, ((_UPRIGHT, _UPRIGHT), (_UPRIGHT, _UPRIGHT))),
            "pentile": (_pentile, ((_UPRIGHT, _MIRRORED), (_MIRRORED, _UPRIGHT))),
            "delta": (_delta, ((_UPRIGHT, _UPSIDE_DOWN), (_UPRIGHT, _UPSIDE_DOWN))),
        }
    )
)
LAYOUTS = tuple(_LAYOUTS)
"""Regular layouts by their names."""


def _tile(boxes: list[list[Box]]) -> Tile:
    """The part of boxes that lies in the pixel, on lines that are alike from either side."""
    kept = [[tuple(min(1.0, max(0.0, along)) for along in box) for box in own] for own in boxes]
    sides = {along for own in kept for box in own for along in box}
    lines = np.unique(np.round([*sides, *(1 - along for along in sides), 0.0, 1.0], 14))
    middles = (lines[1:] + lines[:-1]) / 2
    labels = np.zeros((len(middles), len(middles)), dtype=np.int8)
    for label, own in zip(range(1, 1 + len(COLOURS)), kept, strict=True):
        for x0, y0, x1, y1 in own:
            inside = np.outer((middles > y0) & (middles < y1), (middles > x0) & (middles < x1))
            labels[inside] = label
    return Tile(labels, lines)
