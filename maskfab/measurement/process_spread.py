r"""A number over the displays that are made: full cases about the process stated, and the expansion through them.

A number f of a written die is expanded about the process stated, in standard deviations x of the bias and y of the
corner radius,

    f = f0 + a x + c x² + b y + d y²,

from full cases at two deviations either way, where the edges of a band are; where a radius cannot be less by two, from
rounder ones by one and by two. A full case wider and rounder, as far from the process stated as the edges are, tells
the error: what the expansion misses of it are products of x and y and higher powers.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, TypeAlias, TypeVar

import numpy as np
from scipy.special import ndtri

from maskfab.base.arrays import Floats
from maskfab.geometry.writer_model import check_process
from maskfab.model import Panel, Process

Case = TypeVar("Case")
Terms: TypeAlias = tuple[Floats, Floats, Floats, Floats]

SHARE = 0.95
"""Of the displays, within a band."""
FULL_CASES = 5
CORNER = (math.sqrt(2), math.sqrt(2))
"""Deviations of bias and radius, together as far off as an edge."""
_STEPS = 201
_SIDES = (-2.0, 2.0)


@dataclass(frozen=True)
class ProcessSpread:
    """Standard deviations over the displays that are made.

    Attributes:
        bias_um: of the width of clear features.
        radius_um: of the corner radius.
    """

    bias_um: float = 0.0
    radius_um: float = 0.0

    def __bool__(self) -> bool:
        return bool(self.bias_um or self.radius_um)

    def moved(self, process: Process, x: float, y: float) -> Process:
        """The process so many deviations of bias and radius off."""
        bias, radius = process.cd_bias_um + x * self.bias_um, process.corner_radius_um + y * self.radius_um
        return replace(process, corner_radius_um=radius, cd_bias_um=bias)

    def deviations(self, process: Process) -> tuple[Floats, Floats]:
        """Equally likely deviations of bias and radius, [n, n] of all pairs; a radius below zero counts as zero."""
        steps = ndtri((np.arange(_STEPS) + 0.5) / _STEPS)
        none = np.zeros(1)
        x = steps if self.bias_um else none
        y = np.maximum(steps, -process.corner_radius_um / self.radius_um) if self.radius_um else none
        across, down = np.meshgrid(x, y)
        return across, down


@dataclass(frozen=True)
class Expansion:
    """A number about the process stated; differences of two are those of the two numbers in one process.

    Attributes:
        nominal: f0.
        terms: a, c, b and d.
        missed: by how much full cases lie above what is expanded, each for a reason of its own.
    """

    nominal: float
    terms: tuple[float, float, float, float]
    missed: tuple[float, ...]

    def __sub__(self, other: Expansion) -> Expansion:
        a, c, b, d = (one - two for one, two in zip(self.terms, other.terms, strict=True))
        missed = tuple(one - two for one, two in zip(self.missed, other.missed, strict=True))
        return Expansion(self.nominal - other.nominal, (a, c, b, d), missed)

    def edges(self, deviations: tuple[Floats, Floats]) -> tuple[float, float]:
        """The quantiles of 2.5 and 97.5 % over deviations that are equally likely."""
        (a, c, b, d), (x, y) = self.terms, deviations
        values = self.nominal + a * x + c * x**2 + b * y + d * y**2
        low, high = np.quantile(values, [(1 - SHARE) / 2, (1 + SHARE) / 2])
        return float(low), float(high)

    @property
    def error(self) -> float:
        """Of either edge."""
        return math.fsum(map(abs, self.missed))


@dataclass(frozen=True, eq=False)
class Cases(Generic[Case]):
    """Full cases about the nominal one.

    Attributes:
        nominal: as stated.
        bias: narrower and wider by two deviations; the nominal one twice without a spread.
        radius: sharper and rounder likewise, or rounder twice.
        sides: their deviations.
        corner: wider and rounder.
    """

    nominal: Case
    bias: tuple[Case, Case]
    radius: tuple[Case, Case]
    sides: tuple[float, float]
    corner: Case

    @classmethod
    def about(
        cls, process: Process, spread: ProcessSpread, made: Callable[[Process], Case], nominal: Case
    ) -> Cases[Case]:
        """Cases of a process, each made by a function of it; the nominal one is known."""

        def at(x: float, y: float) -> Case:
            moved = spread.moved(process, x, y)
            return nominal if moved == process else made(moved)

        sides = _sides(process, spread)
        near, far = (at(0, side) for side in sides)
        narrow, wide = (at(side, 0) for side in _SIDES)
        return cls(nominal, (narrow, wide), (near, far), sides, at(*CORNER))

    def terms(self, number: Callable[[Case], Floats]) -> Terms:
        """a, c, b and d of a number, or of an array of them."""
        f0 = number(self.nominal)
        bias = _parabola(_SIDES, *(number(each) - f0 for each in self.bias))
        return (*bias, *_parabola(self.sides, *(number(each) - f0 for each in self.radius)))

    def expansion(self, number: Callable[[Case], Floats]) -> Expansion:
        """Of a number."""
        f0, terms = number(self.nominal), self.terms(number)
        a, c, b, d = (float(each) for each in terms)
        return Expansion(float(f0), (a, c, b, d), (float(number(self.corner) - f0 - at_corner(terms)),))


def at_corner(terms: Terms) -> Floats:
    """The change that an expansion has for the case wider and rounder."""
    across, down = CORNER
    a, c, b, d = terms
    return np.asarray(a * across + c * across**2 + b * down + d * down**2)


def check_spread(process: Process, spread: ProcessSpread, panel: Panel, where: str = "") -> None:
    """Refuse a spread of which some case cannot be written on a panel's dots.

    Raises:
        JobError: MF104, MF127.
    """
    for x, y in ((-2, 0), (2, 0), (0, 2), CORNER):
        check_process(spread.moved(process, x, y), panel, f"{where}, with process.spread")


def _sides(process: Process, spread: ProcessSpread) -> tuple[float, float]:
    """Deviations of the radius in full cases: to either side, or rounder alone where it cannot be less by as much."""
    return (1.0, 2.0) if process.corner_radius_um < 2 * spread.radius_um else _SIDES


def _parabola(places: tuple[float, float], near: Floats, far: Floats) -> tuple[Floats, Floats]:
    """Linear and square term of the parabola through 0 at 0 and through two values at two places."""
    p, q = places
    square = (near / p - far / q) / (p - q)
    return near / p - square * p, square
