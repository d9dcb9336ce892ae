"""More light in the middle of the stop than at its rim, at the light of a uniform panel, and what the display pays.

Cells whose middle lies in the central half of the stop's area hold a denser unit, those beyond it a sparser one, so
that the whole panel passes what the uniform one does; the cells that the stop cuts are turned to make up what whole
dots leave over. A stop that is clearer in its middle passes more at the frequencies that pictures live from.

Notes:
    It is no merit of the mask: the display has less room to emit where the camera looks through its middle. The
    emitters there run at a higher current density for the same luminance, and age faster, or the display is darker
    there. Both are stated; quote them beside the gain.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maskfab.display.emitters.emitter_rules import EmitterRules
from maskfab.display.emitters.fit import footprint
from maskfab.display.light import LightDemand, relative_life
from maskfab.errors import JobError
from maskfab.model import ORIENTATIONS, Opening, frozen
from maskfab.optimiser.maps.orientation_map import DesignedMap, MapMode, design_map
from maskfab.optimiser.model.layout_error import PupilError
from maskfab.optimiser.rules.constraints import Constraints
from maskfab.progress import Progress, silent

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class DisplayPrice:
    """Cost of a denser middle for the display, against the uniform panel.

    Attributes:
        uniform_share: of a cell that each colour's emitter can cover, 0 to 1.
        worst_share: the same of the densest cell.
        best_share: the same of the sparsest.
        current_ratio: current density for equal luminance in the densest cell, over the uniform one's; inf where
            nothing fits there.
        life_ratio: life of those emitters over that of the uniform panel's, 0 where nothing fits.
        luminance_step: largest relative difference of emitting area between neighbouring cells, of the larger; so much
            the luminance steps where all emitters run at one current density.
    """

    uniform_share: float
    worst_share: float
    best_share: float
    current_ratio: float
    life_ratio: float
    luminance_step: float


@dataclass(frozen=True, eq=False)
class Graded:
    """A panel with two units.

    Attributes:
        units: bool [2, dots, dots], the denser one first.
        designed: the map, 8 u + k for unit u; its gains are over the same cells turned at random.
        uniform_psnr: expected restored PSNR of the uniform unit's random map, dB by level.
        uniform_clear_dots: inside the stop, of the same.
        price: of the display.
    """

    units: Mask
    designed: DesignedMap
    uniform_psnr: tuple[float, ...]
    uniform_clear_dots: int
    price: DisplayPrice

    def __post_init__(self) -> None:
        object.__setattr__(self, "units", frozen(np.asarray(self.units, dtype=np.bool_)))

    @property
    def gain_db(self) -> tuple[float, ...]:
        """Over the uniform unit's random map of equal light, at each level."""
        return tuple(a - b for a, b in zip(self.designed.psnr, self.uniform_psnr, strict=True))


def graded(
    uniform: Mask,
    error: PupilError,
    share: float,
    find: Callable[[int], Mask],
    *,
    constraints: Constraints,
    seed: int = 0,
    kicks: int = 0,
    light: LightDemand | None = None,
    progress: Progress = silent,
) -> Graded:
    """Design a panel whose middle is denser, at equal light.

    Args:
        uniform: bool [dots, dots], the unit of the panel that is compared with.
        error: of panels of such units.
        share: of the denser unit's dots that are clear, above the uniform unit's.
        find: gives a good unit, bool [dots, dots], of so many clear dots.
        constraints: that each unit keeps for its own count of clear dots, and both beside one another.
        seed: of the random map.
        kicks: as of :func:`maskfab.optimiser.maps.orientation_map.design_map`.
        light: whose ageing exponent counts; None for the usual one.
        progress: as ``design_map`` tells.

    Raises:
        JobError: MF104 for a share that is not between the uniform unit's and 1, or leaves nothing clear outside;
            MF117, MF118 where the emitters' rules do not suit the pixel; MF123 for units that break the constraints.
    """
    mask = np.asarray(uniform, dtype=np.bool_)
    dense_count, sparse_count = counts(mask, error, share)
    units = np.stack([find(dense_count), find(sparse_count)])
    _require(units, (dense_count, sparse_count), constraints)
    first = error.laid(mask, seed=seed)
    clear = round(float(first.sum()))
    size = error.cells, error.cells
    drawn = np.random.default_rng(seed).integers(ORIENTATIONS, size=size).astype(np.int8)
    held = (drawn + ORIENTATIONS * ~central(error)).astype(np.int8)
    designed = design_map(
        units,
        error,
        mode=MapMode.EQUAL_LIGHT,
        seed=seed,
        kicks=kicks,
        start=held,
        light=clear,
        keep_units=True,
        progress=progress,
    )
    exponent = (light or LightDemand()).ageing_exponent
    held = designed.orientations // ORIENTATIONS
    price = display_price(mask, units, held, constraints.dot_nm, exponent, constraints.emitters)
    return Graded(units, designed, error.psnr(first), clear, price)


def _require(units: Mask, wanted: tuple[int, int], constraints: Constraints) -> None:
    for unit, count, which in zip(units, wanted, ("denser", "sparser"), strict=True):
        if (broken := replace(constraints, clear_dots=count).first_broken(unit)) is not None:
            raise JobError(
                "MF123",
                f"the {which} opening of {count} clear dots breaks {broken}",
                where="density",
                cure="Relax that rule, or choose another density",
            )
    if broken := constraints.broken_beside(units):
        raise JobError(
            "MF123",
            f"the denser and the sparser opening break {broken} where they meet",
            where="density",
            cure="Relax that rule, or ask for rim_dots",
        )


def central(error: PupilError) -> Mask:
    """Cells whose middle lies in the central half of the stop's area, bool [24, 24]."""
    middles = np.arange(error.cells) - (error.cells - 1) / 2
    # The stop's radius comes from its area, so that the panel's pitch plays no part.
    squared = float(error.inside.sum()) / error.dots**2 / math.pi
    return np.asarray(middles[:, None] ** 2 + middles**2 <= squared / 2)


def counts(uniform: Mask, error: PupilError, share: float) -> tuple[int, int]:
    """Clear dots of the denser and the sparser unit for the light of the uniform one, to the nearest dot.

    Raises:
        JobError: MF104 for a share that is not between the uniform unit's and 1, or leaves nothing clear outside.
    """
    dots = error.dots
    dense = round(share * dots**2) if math.isfinite(share) else 0
    uniform_count = int(uniform.sum())
    if not uniform_count < dense <= dots**2:
        raise JobError(
            "MF104",
            f"density = {share:g} is not above the uniform unit's {uniform_count / dots**2:.3g}, and at most 1",
            where="density",
            cure="Choose a larger share of clear dots for the middle",
        )
    cells = error.cells
    area = error.inside.reshape(cells, dots, cells, dots).sum(axis=(1, 3)) / dots**2
    middle = central(error)
    inner, outer = float(area[middle].sum()), float(area[~middle].sum())
    sparse = round((uniform_count * (inner + outer) - dense * inner) / outer)
    if sparse < 1:
        raise JobError(
            "MF104",
            f"density = {share:g} leaves {sparse} clear dots outside the middle",
            where="density",
            cure=f"Choose less than {uniform_count * (inner + outer) / inner / dots**2:.3g}",
        )
    return dense, sparse


def display_price(
    uniform: Mask,
    units: Mask,
    held: NDArray[np.integer],
    dot_nm: int,
    exponent: float = LightDemand.ageing_exponent,
    emitters: EmitterRules | None = None,
) -> DisplayPrice:
    """Cost for the display, from the largest emitters found around each unit in all orientations.

    Args:
        uniform: bool [dots, dots].
        units: bool [2, dots, dots].
        held: which unit each cell holds, integers [rows, columns].
        dot_nm: side of a dot.
        exponent: n of life ~ J^-n.
        emitters: their rules; None for two dots of width, 8 µm between colours, none to the opening.

    Raises:
        JobError: MF117, MF118 as :func:`maskfab.display.emitters.fit.footprint`.
    """
    rules = emitters or EmitterRules(0, 8000, 2 * dot_nm)
    shares = [
        footprint(Opening("unit", mask, dot_nm), dot_nm, 0, range(ORIENTATIONS), rules).found_share
        for mask in (uniform, *units)
    ]
    here = np.array(shares[1:])[held]
    pairs = np.concatenate(
        [np.stack([a.ravel(), b.ravel()]) for a, b in ((here[1:], here[:-1]), (here[:, 1:], here[:, :-1]))], axis=1
    )
    larger = pairs.max(axis=0)
    steps = np.divide(larger - pairs.min(axis=0), larger, out=np.zeros_like(larger), where=larger > 0)
    worst = min(shares[1:])
    fits = worst > 0 and shares[0] > 0
    ratio = shares[0] / worst if fits else math.inf
    life = relative_life(ratio, 1.0, exponent) if fits else 0.0
    return DisplayPrice(shares[0], worst, max(shares[1:]), ratio, life, float(steps.max(initial=0.0)))
