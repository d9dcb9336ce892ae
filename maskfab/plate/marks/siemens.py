"""A star of spokes, whose grey middle shows what a writer resolves in every direction."""

from __future__ import annotations

import math

from maskfab.model import CLEAR, Furniture, Point, Polygon


def inner_radius_nm(feature_nm: float, spokes: int) -> float:
    """Where spokes, as wide as the spaces between them, are one smallest feature wide along their chord."""
    return feature_nm / (2 * math.sin(math.pi / (2 * spokes)))


def siemens_star(name: str, centre_nm: Point, feature_nm: int, radius_nm: int, spokes: int) -> Furniture:
    """Clear spokes from where they are one smallest feature wide to a radius.

    A spoke is a trapezium between chords, its vertices rounded to nanometres; without rounding its area is
    ``(radius^2 - inner_radius^2) sin(pi / spokes) / 2``. A number of spokes that 4 divides makes the star the same
    after every turn by 90 degrees and every mirror.
    """
    inner = inner_radius_nm(feature_nm, spokes)
    return Furniture(
        name, "resolution", CLEAR, tuple(_spoke(centre_nm, inner, radius_nm, k, spokes) for k in range(spokes))
    )


def _spoke(centre: Point, inner: float, outer: float, number: int, spokes: int) -> Polygon:
    low, high = (_direction(4 * number + side, spokes) for side in (-1, 1))
    corners = ((inner, low), (outer, low), (outer, high), (inner, high))
    return tuple((centre[0] + round(radius * x), centre[1] + round(radius * y)) for radius, (x, y) in corners)


def _direction(steps: int, spokes: int) -> tuple[float, float]:
    """Cosine and sine of so many steps, of which a quarter turn has as many as the star has spokes.

    Both are taken from one eighth of the circle, so that its symmetries hold to the last bit.
    """
    quarters, rest = divmod(steps, spokes)
    eighth = min(rest, spokes - rest) * math.pi / (2 * spokes)
    x, y = math.cos(eighth), math.sin(eighth)
    if 2 * rest > spokes:
        x, y = y, x
    for _ in range(quarters % 4):
        x, y = -y, x
    return x, y
