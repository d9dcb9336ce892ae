"""Rules on which dots may be clear: a drawing of those that stay closed, a closed rim, a symmetry."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Mask
from maskfab.errors import JobError
from maskfab.jobfile.sections import DesignSection
from maskfab.model import frozen
from maskfab.optimiser.rules.orbits import orbits, sums
from maskfab.optimiser.rules.rule import Conflict, Rule

if TYPE_CHECKING:
    from maskfab.optimiser.rules.constraints import Constraints


def _kept_out(drawing: Any, section: DesignSection, where: str) -> Mask | None:
    """Dots that stay closed, row 0 the lowest; MF105 for anything but ``dots`` rows of as many x and dots."""
    if drawing is None:
        return None
    rows, dots = drawing.split(), section.dots
    if len(rows) != dots or any(len(row) != dots or set(row) - {"x", "."} for row in rows):
        raise JobError(
            "MF105",
            f"the drawing is not {dots} rows of {dots} signs, each x or .",
            where=f"{where}.rules.keep_out",
            cure="Draw the cell, the top row first: x stays closed, . is free",
        )
    return np.array([[sign == "x" for sign in row] for row in reversed(rows)])


def _of_the_cell(constraints: Constraints, given: Any) -> Mask:
    kept = np.asarray(given, dtype=np.bool_)
    if kept.shape != (constraints.dots, constraints.dots):
        raise JobError(
            "MF105",
            f"the keep-out is {kept.shape}, the cell {constraints.dots} x {constraints.dots} dots",
            where=KEEP_OUT.where,
            cure="Give one value per dot",
        )
    return frozen(kept)


def _in_keep_out(constraints: Constraints, unit: Mask) -> str | None:
    inside = int((unit & constraints["keep_out"]).sum())
    return f"{inside} clear dots where none may be" if inside else None


def _inside_rim(constraints: Constraints) -> Mask:
    rim, dots = constraints["rim_dots"], constraints.dots
    inside = np.zeros((dots, dots), dtype=np.bool_)
    inside[rim : dots - rim, rim : dots - rim] = True
    return inside


def _in_rim(constraints: Constraints, unit: Mask) -> str | None:
    inside = int((unit & ~_inside_rim(constraints)).sum())
    return f"{inside} clear dots within {constraints['rim_dots']} of a side" if inside else None


def _orbits(constraints: Constraints) -> tuple[NDArray[np.intp], ...]:
    return orbits(constraints.dots, constraints["symmetry"])


def _uneven(constraints: Constraints, unit: Mask) -> str | None:
    flat = unit.ravel()
    uneven = sum(len(set(flat[orbit].tolist())) > 1 for orbit in constraints.orbits)
    told = f"{uneven} sets of dots differ from their images under {constraints['symmetry']}"
    return told if uneven else None


def _by_orbits(constraints: Constraints) -> Conflict | None:
    """The sets of dots that the symmetry maps onto each other never sum to the count."""
    wanted, symmetry = constraints.clear_dots, constraints["symmetry"]
    reached = sums([len(orbit) for orbit in constraints.members])[-1]
    if reached >> wanted & 1:
        return None
    below = (reached & ((1 << wanted) - 1)).bit_length() - 1
    above = next((k for k in range(wanted + 1, constraints.dots**2 + 1) if reached >> k & 1), None)
    nearest = f"{below}" if above is None else f"{below} and {above}"
    return Conflict(
        ("clear_dots", "symmetry", *constraints.closing),
        f"sets of dots that {symmetry} maps onto each other never sum to {wanted}; the nearest counts are {nearest}",
    )


KEEP_OUT = Rule(
    "keep_out",
    "",
    _in_keep_out,
    free=lambda constraints: ~constraints["keep_out"],
    counted=True,
    read=_kept_out,
    checked=_of_the_cell,
)
RIM = Rule("rim_dots", "dots", _in_rim, free=_inside_rim, counted=True)
SYMMETRY = Rule("symmetry", "", _uneven, proof=_by_orbits, linked=_orbits, counted=True)
