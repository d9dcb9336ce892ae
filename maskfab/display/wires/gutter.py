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

    def width_nm(self, lines: int) -> int:
        """Room that parallel lines of one layer take, clearances on both sides included; 0 for none."""
        if lines <= 0:
            return 0
        return lines * self.line_nm + (lines - 1) * self.space_nm + 2 * self.clearance_nm


def lines_per_layer(width_nm: int, rules: WireRules) -> int:
    """Most lines n of one layer with n line + (n - 1) space + 2 clearance <= width."""
    return max(0, (width_nm + rules.space_nm - 2 * rules.clearance_nm) // (rules.line_nm + rules.space_nm))


def dot_capacity(dot_nm: int, rules: WireRules) -> int:
    """Lines of one layer that run abreast through a closed dot beside any neighbour.

    A neighbour may be an opening, which wants the clearance, or a dot as full of lines as this one, which wants half a
    space from either side.
    """
    margin = max(rules.clearance_nm, -(-rules.space_nm // 2))
    return lines_per_layer(dot_nm, WireRules(rules.line_nm, rules.space_nm, margin))


def gutter_for(lines: int, layers: int, rules: WireRules) -> int:
    """Narrowest gutter, in nanometres, that holds so many parallel lines spread over so many layers.

    Raises:
        JobError: MF120 for a negative number of lines or no layer.
    """
    if lines < 0 or layers < 1:
        raise JobError(
            "MF120",
            f"{lines} lines on {layers} layers cannot be drawn",
            where="wiring",
            cure="Give 0 lines or more and at least 1 layer",
        )
    return rules.width_nm(-(-lines // layers))
