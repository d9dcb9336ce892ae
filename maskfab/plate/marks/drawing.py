"""Parts of marks: the plate before them, rectangles, crosses of equal arms, and names of sizes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from maskfab.jobfile.order import ChromeSide, Tone
from maskfab.model import Box, Die, Furniture, Gauge, Point, Polygon


@dataclass(frozen=True, eq=False)
class Setting:
    """A plate before its marks.

    Attributes:
        title: of the plate.
        signature: who made it from what.
        digest: hexadecimal hash of the resolved job.
        blank_nm: side of the blank.
        writable_nm: side of the writable area.
        die_pitch_nm: from die to die.
        dies: at their places.
        feature_nm: the smallest feature, of which test figures are multiples.
        tone: of the data.
        chrome: side from which the plate reads right, marks included.
    """

    title: str
    signature: str
    digest: str
    blank_nm: int
    writable_nm: int
    die_pitch_nm: int
    dies: tuple[Die, ...]
    feature_nm: int
    tone: Tone = "clear"
    chrome: ChromeSide = "up"


@dataclass(frozen=True)
class DrawnMarks:
    """Furniture with its gauges; most marks have none."""

    furniture: tuple[Furniture, ...]
    gauges: tuple[Gauge, ...] = ()


def multiple_name(multiple: float) -> str:
    """A multiple of the smallest feature as part of a cell's name: ``1_5X``."""
    return f"{multiple:g}".replace(".", "_") + "X"


def box_at(centre_nm: Point, size_nm: Point) -> Box:
    """The box of that width and height round a centre; an odd length reaches one nanometre more up or right."""
    x0, y0 = centre_nm[0] - size_nm[0] // 2, centre_nm[1] - size_nm[1] // 2
    return x0, y0, x0 + size_nm[0], y0 + size_nm[1]


def rectangle(box_nm: Box) -> Polygon:
    """The box as a polygon."""
    x0, y0, x1, y1 = box_nm
    return (x0, y0), (x1, y0), (x1, y1), (x0, y1)


def bounding_box(polygons: Iterable[Polygon]) -> Box:
    """The bounding box of at least one polygon."""
    xs, ys = zip(*(point for polygon in polygons for point in polygon), strict=True)
    return min(xs), min(ys), max(xs), max(ys)


def four_arms(centre_nm: Point, arm: Sequence[Point]) -> Polygon:
    """One outline from one arm and its three quarter turns.

    Args:
        centre_nm: what the arm is turned round.
        arm: counter-clockwise outline of the upper arm about (0, 0), from its right foot to its left one, where the
            next arm starts.
    """
    turned = [list(arm)]
    for _ in range(3):
        turned.append([(-y, x) for x, y in turned[-1]])
    points = dict.fromkeys(point for side in turned for point in side)
    return tuple((centre_nm[0] + x, centre_nm[1] + y) for x, y in points)
