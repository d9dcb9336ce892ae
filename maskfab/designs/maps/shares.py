"""Cells that hold the denser of two openings, and the clear dots of each, at the light of a uniform panel.

At a given total, the gain of an uneven panel goes with the largest local share of light: all of it in a disc round the
axis, as dense as the display allows, restores best. So the denser cells are those nearest to the axis. Where the share
of the rest is stated, how many cells are denser follows from the light; else they fill the central half of the stop,
and the share of the rest follows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from maskfab.base.arrays import Floats, Indices, Mask
from maskfab.base.errors import JobError
from maskfab.designs.model.panel_judgement import PanelError

SPARSEST = range(1, 4)
"""Clear dots beyond the denser cells that a search chooses from: fewer are better, and the light must come out."""


@dataclass(frozen=True)
class Denser:
    """A middle that is asked for.

    Attributes:
        share: of the dots that are clear there; "search" for the one that restores best within the rules.
        outer: clear dots beyond it; None where it fills the central half of the stop, and the fewest with "search".
    """

    share: float | Literal["search"]
    outer: int | None = None

    @property
    def sought(self) -> bool:
        """Whether a search finds the share."""
        return self.share == "search"


@dataclass(frozen=True, eq=False)
class Shares:
    """Two openings' clear dots, and where each lies.

    Attributes:
        dense, sparse: clear dots of the denser and the sparser unit.
        denser: cells that hold the denser one, bool [cells, cells].
    """

    dense: int
    sparse: int
    denser: Mask


def covered(error: PanelError) -> Floats:
    """Share of every cell that lies in the stop, [cells, cells]."""
    cells, dots = error.cells, error.dots
    inside: Floats = error.inside.reshape(cells, dots, cells, dots).sum(axis=(1, 3)) / dots**2
    return inside


def central(error: PanelError) -> Mask:
    """Cells whose middle lies in the central half of the stop's area, bool [cells, cells]."""
    # The stop's radius comes from its area, so that the panel's pitch plays no part.
    squared = float(error.inside.sum()) / error.dots**2 / math.pi
    return np.asarray(_squared(error) <= squared / 2)


def nearest(error: PanelError, count: int) -> Mask:
    """So many cells nearest to the axis, bool [cells, cells]; of equals, the lower and the left ones first."""
    held = np.zeros(error.cells**2, dtype=np.bool_)
    held[_order(error)[:count]] = True
    return held.reshape(error.cells, error.cells)


def stated(uniform: Mask, error: PanelError, asked: Denser) -> Shares:
    """Clear dots of the denser and the sparser unit, and where they lie, for the light of the uniform one.

    Args:
        uniform: bool [dots, dots].

    Raises:
        JobError: MF104 for a share that is not between the uniform unit's and 1, or leaves nothing clear outside, or
            outer dots that are not fewer than the uniform unit's.
    """
    share, dots = float(asked.share), error.dots
    dense = round(share * dots**2) if math.isfinite(share) else 0
    uniform_count = int(uniform.sum())
    if not uniform_count < dense <= dots**2:
        what = f"density = {share:g} is not above the uniform unit's {uniform_count / dots**2:.3g}, and at most 1"
        raise JobError("MF104", what, where="density", cure="Choose a larger share of clear dots for the middle")
    if asked.outer is not None:
        require_outer(asked.outer, uniform_count)
        return beside(dense, (asked.outer,), uniform_count, error)
    area, middle = covered(error), central(error)
    inner, outer = float(area[middle].sum()), float(area[~middle].sum())
    sparse = round((uniform_count * (inner + outer) - dense * inner) / outer)
    if sparse < 1:
        what = f"density = {share:g} leaves {sparse} clear dots outside the middle"
        most = uniform_count * (inner + outer) / inner / dots**2
        cure = f"Choose less than {most:.3g}, or state outer_dots, such as 1, so that the middle takes less of the stop"
        raise JobError("MF104", what, where="density", cure=cure)
    return Shares(dense, sparse, middle)


def require_outer(outer: int, uniform_count: int, *, where: str = "outer_dots") -> None:
    """Refuse outer dots that are not fewer than those of the uniform unit. Raises JobError MF104."""
    if not 1 <= outer < uniform_count:
        what = f"outer_dots = {outer} is not 1 or more and below the {uniform_count} clear dots of the mean"
        raise JobError("MF104", what, where=where, cure=f"Choose 1 to {uniform_count - 1}")


def beside(dense: int, outer: tuple[int, ...], uniform_count: int, error: PanelError) -> Shares:
    """Shares of a denser unit with the outer dots, and as many denser cells, that come nearest to the light.

    Args:
        dense: clear dots of the denser unit, more than ``uniform_count``.
        outer: clear dots beyond to choose from.
    """
    held = np.cumsum(covered(error).ravel()[_order(error)])
    off = np.stack([np.abs(dense * held + sparse * (held[-1] - held) - uniform_count * held[-1]) for sparse in outer])
    best, last = np.unravel_index(int(off.argmin()), off.shape)
    return Shares(dense, outer[int(best)], nearest(error, int(last) + 1))


def _squared(error: PanelError) -> Floats:
    """Squared distance of every cell's middle from the axis, in cells."""
    middles = np.arange(error.cells) - (error.cells - 1) / 2
    return np.asarray(middles[:, None] ** 2 + middles**2)


def _order(error: PanelError) -> Indices:
    return np.argsort(_squared(error).ravel(), kind="stable")
