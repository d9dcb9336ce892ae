"""Result of a rule over a whole panel or plate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maskfab.base.arrays import Floats, Ints
from maskfab.model import Box


@dataclass(frozen=True)
class RuleResult:
    """One rule on one owner.

    Attributes:
        rule: width, space, notch, area, chrome_area, grid, manhattan, acute_angle, corner_touch, overlap, vertices,
            references, name_pattern, forbidden_name, name_length or extent.
        limit: what the rule asks for.
        unit: of limit and value; empty for names.
        value: the worst that breaks the rule; None where nothing does.
        count: how many places break it.
        places: the first of them, by y and then x of the lower left corner: x0, y0, x1, y1 in plate nanometres.
        die: the die that owns them; None for marks and for the plate as a whole.
        names: the names that break a rule about names.
    """

    rule: str
    limit: int | str
    unit: str
    value: float | int | str | None
    count: int
    places: tuple[Box, ...] = ()
    die: str | None = None
    names: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        return self.count == 0


@dataclass(frozen=True, eq=False)
class Found:
    """Violations of a rule.

    Attributes:
        count: how many there are.
        value: the worst; None where there are none.
        boxes_nm: int64 [n, 4] of the first, sorted by lower left corner.
    """

    count: int
    value: float | None
    boxes_nm: Ints

    def result(self, rule: str, limit: int, unit: str, die: str | None, origin_nm: tuple[int, int]) -> RuleResult:
        """The violations under a rule's name, moved to where the owner lies on the plate."""
        moved = self.boxes_nm + np.tile(np.asarray(origin_nm, dtype=np.int64), 2)
        places = tuple((x0, y0, x1, y1) for x0, y0, x1, y1 in moved.tolist())
        value = int(self.value) if self.value is not None and self.value == int(self.value) else self.value
        return RuleResult(rule, limit, unit, value, self.count, places, die)


def counted_references(references: int, limit: int) -> RuleResult:
    """The rule on references; the count is 1 if there are too many, and the value how many there are."""
    return RuleResult("references", limit, "references", references, int(references > limit))


def first(boxes: Ints, most: int) -> Ints:
    """The first boxes by y and then x of the lower left corner."""
    return boxes[np.lexsort(boxes.T[[3, 2, 0, 1]])[:most]]


def listed(boxes: Ints, values: Floats, most: int, *, largest: bool = False) -> Found:
    """Violations that were all found at their own place; the worst value is the smallest unless said otherwise."""
    if not len(boxes):
        return Found(0, None, np.zeros((0, 4), dtype=np.int64))
    return Found(len(boxes), float(values.max() if largest else values.min()), first(boxes, most))


def joined(parts: list[Found], most: int, *, largest: bool = False) -> Found:
    """Violations of one rule, found in several ways."""
    boxes = np.concatenate([part.boxes_nm for part in parts]) if parts else np.zeros((0, 4), dtype=np.int64)
    values = [part.value for part in parts if part.value is not None]
    worst = (max(values) if largest else min(values)) if values else None
    return Found(sum(part.count for part in parts), worst, first(boxes, most))


@dataclass(frozen=True, eq=False)
class Repeated:
    """Violations found once in each distinct item, and where the items lie.

    Attributes:
        items: int64 [m], the item that each occurrence is.
        origins_nm: int64 [m, 2], where the occurrence lies.
        owners: int64 [n], the item that each violation was found in.
        boxes_nm: int64 [n, 4], from its item's origin.
        values: float64 [n].
    """

    items: Ints
    origins_nm: Ints
    owners: Ints
    boxes_nm: Ints
    values: Floats

    def found(self, most: int, *, largest: bool = False) -> Found:
        """All violations counted, the first of them placed; only the lowest occurrences are ever written out."""
        empty = Found(0, None, np.zeros((0, 4), dtype=np.int64))
        if not len(self.owners) or not len(self.items):
            return empty
        kinds = int(max(self.items.max(), self.owners.max())) + 1
        each, times = np.bincount(self.owners, minlength=kinds), np.bincount(self.items, minlength=kinds)
        count = int(each @ times)
        if count == 0:
            return empty
        values = self.values[times[self.owners] > 0]
        worst = float(values.max() if largest else values.min())
        order = np.flatnonzero(each[self.items] > 0)
        heights = self.origins_nm[order, 1]
        if (heights[1:] < heights[:-1]).any():
            upwards = np.argsort(heights, kind="stable")
            order, heights = order[upwards], heights[upwards]
        enough = min(int(np.searchsorted(np.cumsum(each[self.items[order]]), most)), len(order) - 1)
        highest = heights[enough] + self.boxes_nm[:, 1].max() - self.boxes_nm[:, 1].min()
        chosen = order[heights <= highest]
        by_item = np.argsort(self.owners, kind="stable")
        starts = np.cumsum(each) - each
        which = expanded(starts[self.items[chosen]], each[self.items[chosen]])
        origins = np.repeat(self.origins_nm[chosen], each[self.items[chosen]], axis=0)
        return Found(count, worst, first(self.boxes_nm[by_item][which] + np.tile(origins, 2), most))


def expanded(starts: Ints, lengths: Ints) -> Ints:
    """The runs ``start, start + 1, ...`` of the given lengths, one after the other."""
    before = np.cumsum(lengths) - lengths
    runs: Ints = np.arange(int(lengths.sum())) + np.repeat(starts - before, lengths)
    return runs
