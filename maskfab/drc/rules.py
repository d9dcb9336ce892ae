"""Design rules of a mask shop for the data it writes, and KLayout's checks that those on distances are made of."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

from klayout import db

from maskfab.errors import JobError

Check = Callable[[db.Region], db.EdgePairs]
"""Pairs of edges that face each other too closely, of a region merged with kissing corners apart."""


@dataclass(frozen=True)
class DesignRules:
    """Limits on what is clear, on how it is drawn, and on names; a rule that is None or False is not checked.

    Distances are Euclidian, as KLayout measures them: between the facing parts of two edges, corner to corner
    included. So a point in which clear corners kiss counts as two spaces of zero, and if both corners are of one
    polygon, as two notches and two widths of zero as well, unless ``kissing`` is False.

    Attributes:
        min_width_nm: least width of a clear polygon.
        min_space_nm: least chrome between clear edges, of one polygon or of two.
        min_notch_nm: least chrome between two edges of one clear polygon.
        min_area_nm2: least area of a clear polygon, and of an island of chrome inside one. Shapes that only kiss in
            a corner are two.
        grid_nm: every vertex, as drawn, is a multiple of it in plate coordinates.
        manhattan: edges, as drawn, run along x or y only.
        no_acute_angles: no corner, as drawn, is sharper than 90 degrees.
        no_corner_touch: no two clear shapes, and no two corners of one, meet in a point.
        kissing: whether distances of zero, where corners kiss, break the rules on width, space and notch, too.
        no_overlap: nothing is drawn twice.
        max_vertices: most vertices of a polygon as drawn.
        max_references: most references in the file, an array counting once.
        name_pattern: regular expression that every cell name matches as a whole.
        forbidden_names: texts that no cell name contains, in whatever case.
        max_name_length: most characters of a cell name.
        extent_nm: sides of the box, centred on the origin, that holds everything.

    Raises:
        JobError: MF417 if a limit is not positive or the pattern is no regular expression.
    """

    min_width_nm: int | None = None
    min_space_nm: int | None = None
    min_notch_nm: int | None = None
    min_area_nm2: int | None = None
    grid_nm: int | None = None
    manhattan: bool = False
    no_acute_angles: bool = False
    no_corner_touch: bool = False
    kissing: bool = True
    no_overlap: bool = False
    max_vertices: int | None = None
    max_references: int | None = None
    name_pattern: str | None = None
    forbidden_names: tuple[str, ...] = ()
    max_name_length: int | None = None
    extent_nm: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            numbers = value if each.name == "extent_nm" and value is not None else (value,)
            for number in numbers:
                if isinstance(number, int) and not isinstance(number, bool) and number <= 0:
                    raise JobError(
                        "MF417",
                        f"the design rule {each.name} is {number}; it must be positive",
                        cure="Give a positive number, or leave the rule out",
                    )
        if self.name_pattern is not None:
            try:
                re.compile(self.name_pattern)
            except re.error as error:
                raise JobError(
                    "MF417",
                    f"the design rule name_pattern is {self.name_pattern!r}, no regular expression: {error}",
                    cure='Correct the expression, for example "[A-Z][A-Z0-9_]*"',
                ) from error

    @property
    def reach_nm(self) -> int:
        """Largest distance in nanometres at which two shapes can interact in a rule."""
        return max(1, self.min_width_nm or 0, self.min_space_nm or 0, self.min_notch_nm or 0)


def distance_checks(rules: DesignRules) -> dict[str, tuple[int, Check]]:
    """Limit and check of the rules on width, space and notch that are set, by their names."""
    # Corners that kiss are edges that touch at a distance of nothing.
    options: dict[str, Any] = {} if rules.kissing else {"zero_distance_mode": db.Region.NeverIncludeZeroDistance}
    checks: dict[str, tuple[int, Check]] = {}
    if (width := rules.min_width_nm) is not None:
        checks["width"] = width, lambda region: region.width_check(width, **options)
    if (space := rules.min_space_nm) is not None:
        checks["space"] = space, lambda region: region.space_check(space, **options)
    if (notch := rules.min_notch_nm) is not None:
        checks["notch"] = notch, lambda region: region.notch_check(notch, **options)
    return checks
