"""Capacity of a gutter for lines, and the width needed for them."""

from __future__ import annotations

from dataclasses import dataclass

from maskfab.errors import JobError


@dataclass(frozen=True)
class WireRules:
    """Width and space rules for drawing lines; the defaults are a judgement, no source was found.

    Attributes:
        line_nm: width of a line.
        space_nm: least distance between lines of one layer.
        clearance_nm: least distance from an opaque line to any opening.

    Raises:
        JobError: MF120 if the line has no width or a distance is negative.
    """

    line_nm: int = 3000
    space_nm: int = 3000
    clearance_nm: int = 2500

    def __post_init__(self) -> None:
        if self.line_nm <= 0 or self.space_nm <= 0 or self.clearance_nm < 0:
            raise JobError(
                "MF120",
                f"lines of {self.line_nm} nm, {self.space_nm} nm apart and {self.clearance_nm} nm from openings "
                "cannot be drawn",
                where="wiring",
                cure="Give positive widths and spaces, and a clearance of 0 or more",
            )


def lines_per_layer(width_nm: int, rules: WireRules) -> int:
    """Most lines n of one layer with n line + (n - 1) space + 2 clearance <= width."""
    return max(0, (width_nm + rules.space_nm - 2 * rules.clearance_nm) // (rules.line_nm + rules.space_nm))
