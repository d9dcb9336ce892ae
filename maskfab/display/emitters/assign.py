r"""Where a pixel's light comes from, and which colour goes where so that random orientations show least.

An emitter pattern whose luminance centroid lies off the pixel's centre moves the light about when pixels are turned at
random, which the eye sees as grain; its contrast grows with the centroid's distance from its mean over orientations.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Labels
from maskfab.display.emitters.across_borders import border_margin
from maskfab.display.emitters.borders import borders
from maskfab.display.emitters.emitter_rules import EmitterGrid, EmitterRules
from maskfab.display.emitters.free_area import free_region
from maskfab.display.emitters.freeform import Shapes, cut_triples, shaved
from maskfab.display.emitters.rectangles import Ratio
from maskfab.display.emitters.squares import Squares
from maskfab.model import ORIENTATIONS, Emitters, Opening, orient
from maskfab.optics.numbers.centroid import luminance_centroid
from maskfab.optics.numbers.colour import LUMINANCE

_PLACES = 12
"""Places of each cut that are looked at; more makes no centroid better by what can be seen."""
_TRIMMED = 3
"""Placements trimmed to each footprint: so many of the best as they are, and of those that trimming could make best."""
_REACHED = 0.7
"""Of the way that trimming could move the light if it all went one way, as much as it usually does."""
_ROUNDS = 4
"""In each, every colour loses half of what it has to lose, on the side to which the light then leans."""
_DIGITS = 3
"""Of a centroid in pixels; differences below make no grain that is seen, so that the larger area is chosen."""


def wander(emitters: Emitters, pitch_nm: int, elements: Iterable[int] = range(ORIENTATIONS)) -> float:
    """Root mean square distance of the centroid from its mean over equally likely orientations, in pixels."""
    places = np.array(
        [luminance_centroid(Emitters(orient(emitters.labels, k), emitters.cell_nm), pitch_nm) for k in elements]
    )
    return float(np.sqrt(((places - places.mean(axis=0)) ** 2).sum(axis=1).mean()))


def centred(
    found: Emitters | None,
    opening: Opening,
    grid: EmitterGrid,
    orientations: NDArray[np.int8],
    rules: EmitterRules,
    *,
    keep: float,
) -> Emitters | None:
    """The placement, among those with enough area, with the luminance centroid nearest to the pixel's centre.

    Looked at are the one found and those that two straight cuts leave, in all colour orders that the ratio allows,
    trimmed to the ratio on the side to which the light leans. Centroids that differ by less than 0.001 pixel are equal;
    of these the larger placement is chosen.

    Args:
        found: the largest placement that keeps the rules; None if there is none.
        opening: the pixel's.
        grid: its cells and rules.
        orientations: of the panel's pixels.
        rules: the ratio, and the footprint below which no placement goes that is required and found.
        keep: share of the footprint found that must be left, 0 to 1.

    Returns:
        A placement that keeps all rules, across borders too; None if none was found.
    """
    if found is None:
        return None
    ratio = rules.ratio
    best = min(float((found.labels == k + 1).sum()) / ratio[k] for k in range(3))
    if best <= 0:
        return found
    required = rules.required * (grid.pitch_nm / grid.cell_nm) ** 2
    least = max(min(keep, 1.0) * best, min(best, required))
    used = tuple(int(k) for k in np.unique(orientations % ORIENTATIONS))
    region = free_region(opening.mask, grid, used, margin=border_margin(grid))
    light = _Light(Squares.of(region, grid.min_width, grid.colour_gap), grid, ratio)
    red, green, blue = (light.squares.largest(light.squares.among(found.labels == k)) for k in (1, 2, 3))
    triples = [(red, green, blue), *cut_triples(light.squares, least * min(ratio), _PLACES)]
    levels = sorted({best, (best + least) / 2, least}, reverse=True)
    candidates = [light.trimmed(shapes, level) for level in levels for shapes in light.most_promising(triples, level)]
    clear = np.kron(opening.mask, np.ones((grid.per_dot, grid.per_dot), dtype=np.bool_))
    offset = round(math.hypot(*luminance_centroid(found, grid.pitch_nm)), _DIGITS)
    keyed = [(*light.key(shapes), shapes) for shapes in candidates if light.footprint(shapes) >= least - 1e-9]
    for distance, area, shapes in sorted(keyed, key=lambda each: each[:2]):
        if (distance, area) >= (offset, -best):
            break
        labels = light.labels(shapes)
        if borders(labels, clear, grid, orientations).legal:
            return Emitters(labels, grid.cell_nm)
    return found


class _Light:
    """Where the light of three shapes, in the order red, green, blue, comes from; each shape measured once."""

    def __init__(self, squares: Squares, grid: EmitterGrid, ratio: Ratio) -> None:
        self.squares = squares
        self.grid = grid
        self.ratio = ratio
        self._measured: dict[int, tuple[int, float, float, float]] = {}

    def measured(self, shape: int) -> tuple[int, float, float, float]:
        """Cells, centroid (y, x) off the pixel's centre in pixels, and extent in pixels."""
        if shape not in self._measured:
            cells = self.squares.picture(shape)
            rows, columns = cells.sum(axis=1), cells.sum(axis=0)
            area = int(rows.sum())
            along = np.arange(self.grid.cells) + 0.5 - self.grid.cells / 2
            unit = self.grid.cell_nm / self.grid.pitch_nm
            y, x = (float(along @ line) / max(area, 1) * unit for line in (rows, columns))
            extent = max(np.count_nonzero(rows), np.count_nonzero(columns)) * unit
            self._measured[shape] = area, y, x, extent
        return self._measured[shape]

    def centroid(self, shapes: Shapes) -> tuple[float, float]:
        """(y, x) of the light off the pixel's centre, in pixels."""
        places = [self.measured(shape) for shape in shapes]
        y, x = (
            sum(share * place[axis] for share, place in zip(LUMINANCE.tolist(), places, strict=True)) for axis in (1, 2)
        )
        return y, x

    def footprint(self, shapes: Shapes) -> float:
        return min(self.measured(shape)[0] / part for shape, part in zip(shapes, self.ratio, strict=True))

    def key(self, shapes: Shapes) -> tuple[float, float]:
        """Lower is better."""
        return round(math.hypot(*self.centroid(shapes)), _DIGITS), -self.footprint(shapes)

    def labels(self, shapes: Shapes) -> Labels:
        labels = np.zeros((self.grid.cells, self.grid.cells), dtype=np.int8)
        for k, shape in enumerate(shapes):
            labels[self.squares.picture(shape)] = k + 1
        return labels

    def most_promising(self, triples: list[Shapes], least: float) -> list[Shapes]:
        """The best few triples, in any colour order, by how near to the centre trimming could bring the light."""
        unique = list(dict.fromkeys(triples))
        known = np.array([[self.measured(shape) for shape in shapes] for shapes in unique])
        shares, ratio = LUMINANCE, np.array(self.ratio)
        chosen: dict[Shapes, None] = {}
        for part in (0.0, _REACHED):
            keys: list[tuple[float, int, tuple[int, ...]]] = []
            for order in permutations(range(3)):
                area, y, x, extent = np.moveaxis(known[:, order], -1, 0)
                # A fraction cut off one end moves the middle by half as much of the length.
                reach = (np.maximum(1 - least * ratio / area, 0) * extent / 2) @ shares
                left = np.hypot(y @ shares, x @ shares) - part * reach
                fits = np.flatnonzero((area >= least * ratio - 1e-9).all(axis=1))
                keys.extend((round(float(left[i]), 9), int(i), order) for i in fits)
            for _, i, order in heapq.nsmallest(_TRIMMED, keys):
                chosen[unique[i][order[0]], unique[i][order[1]], unique[i][order[2]]] = None
        return list(chosen)

    def trimmed(self, shapes: Shapes, level: float) -> Shapes:
        """The shapes without what they have beyond a footprint, so that the light comes to the centre."""
        placed = list(shapes)
        targets = [math.ceil(level * part - 1e-9) for part in self.ratio]
        for left in reversed(range(_ROUNDS)):
            # The colour with the most light first: what is left is for the finer steps of the others.
            for k in (1, 0, 2):
                spare = self.measured(placed[k])[0] - targets[k]
                count = spare if left == 0 else -(-spare // 2)
                y, x = self.centroid((placed[0], placed[1], placed[2]))
                for towards in ((y, x), self._other(y, x), (-y, -x), self._other(-y, -x)):
                    if count <= 0:
                        break
                    before = self.measured(placed[k])[0]
                    placed[k] = shaved(self.squares, placed[k], towards, count, targets[k])
                    count -= before - self.measured(placed[k])[0]
                    if left:
                        break
        return placed[0], placed[1], placed[2]

    @staticmethod
    def _other(y: float, x: float) -> tuple[float, float]:
        """Of the sides across, the one that the light leans to."""
        return math.copysign(abs(x), y), math.copysign(abs(y), x)
