r"""Parts inside a stop of the dots that it cuts, left of lines and below others, in closed form.

Stretched so that its half sides are 1, a stop is a unit disc or a square; the dark middle of an annulus is one more
disc, taken away. Cut dots are parted at the axes, and every part is mirrored into the first quadrant. There the rim
y(x) = sqrt(1 - x²) falls, and of a part that begins at l and b

    ∫_l^x clip(y(u), b, y₁) - b du = (y₁ - b)(min(x, x₁) - l) + ∫_{x₁}^{max(x, x₁)} y(u) - b du,    y(x₁) = y₁,

is clear, with ∫_0^x y = (x y(x) + asin x) / 2. Left of and below a point of the disc all is clear; right of and above
one outside it nothing is, so that what two lines leave follows from what either does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Indices
from maskfab.model import Stop, frozen

# Whether parts are mirrored along x and along y.
_QUADRANTS = [(False, False), (False, True), (True, False), (True, True)]


@dataclass(frozen=True, eq=False)
class RimParts:
    """Parts of cut dots, each in one quadrant of the stop.

    Attributes:
        dot: intp [m], whose part; the first k parts are one of every dot, in order.
        mirrored: int8 [2, m], 1 for parts mirrored along x, and along y.
        table: float64 [8, 2, m]: where the parts lie along either axis, see :class:`_Along`; last, what areas of the
            stretched stop count, and the clear one of each part.
        round: whether the stop is.
    """

    dot: Indices
    mirrored: NDArray[np.int8]
    table: Floats
    round: bool

    def __post_init__(self) -> None:
        for name in ("dot", "mirrored", "table"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @classmethod
    def of(cls, stop: Stop, x_um: Floats, y_um: Floats, transmission: Floats) -> RimParts:
        """Parts of dots [k] between x_um [2, k] and y_um [2, k] that a stop cuts, which is no polygon."""
        discs = [(1.0, 1.0), (stop.inner_share, -1.0)] if stop.inner_share else [(1.0, 1.0)]
        width, height = stop.sides_um
        tables, areas = [], []
        for share, sign in discs:
            weight = sign * share**2 * width * height / 4 * transmission
            ends = np.stack([x_um * (2 / (share * width)), y_um * (2 / (share * height))])
            for mirrored in _QUADRANTS:
                along = _Along.of(stop.round, ends, mirrored)
                area = _Lines.of(along, np.ones(along.start.shape)).before[0]
                tables.append(np.stack([*along, np.stack([weight, weight * area])]))
                areas.append(area)
        dots, area = np.arange(transmission.size), np.stack(areas)
        first = np.argmax(area, axis=0)
        rest = area > 0
        rest[first, dots] = False
        others, other_dots = np.nonzero(rest)
        place, dot = np.concatenate([first, others]), np.concatenate([dots, other_dots])
        mirrors = np.array(_QUADRANTS * len(discs), dtype=np.int8)
        return cls(dot, mirrors[place].T, np.stack(tables, axis=-2)[..., place, dot], stop.round)

    @property
    def clear_um2(self) -> Floats:
        """Clear area of each part times the dot's transmission, negative in an annulus's dark middle, [m]."""
        return np.asarray(self.table[-1, 1])

    def excess_um2(self, part: Indices, share: Floats, quarters: NDArray[np.int8] | Floats) -> Floats:
        """Area that quarters of parts' dots pass if they transmit unlike amounts, less the mean's share of it.

        Args:
            part: intp [n], ascending.
            share: [2, n] where lines across x and across y divide the dots, 0 to 1.
            quarters: [4, n] transmissions of those left and below, right and below, left and above, right and above;
                those of the last are taken to be let through by the whole dot.
        """
        held = slice(part[0], part[-1] + 1)
        count = np.diff(np.searchsorted(part, np.arange(held.start, held.stop + 1)))
        found = np.repeat(self.table[..., held], count, axis=2)
        weight, clear = found[-1]
        mirrored = np.repeat(self.mirrored[:, held], count, axis=1)
        here, right, above = quarters[:3] - quarters[3]
        twist = here - right - above
        steps = np.stack([above, right])
        # Mirroring changes sides.
        steps += mirrored[::-1] * twist
        turn = 1 - 2 * mirrored
        steps *= turn
        twist *= turn[0] * turn[1]
        share = abs(share - mirrored)
        lines = _Lines.of(_Along(*found[:-1]), share)
        sides = lines.before
        sides *= weight
        both = lines.rectangle()
        both *= weight
        if self.round:
            # What lies beyond a corner outside the disc is dark.
            both = np.where(lines.place[1] < lines.height[0], both, sides[0] + sides[1] - clear)
        means = clear * share
        sides -= means
        sides *= steps.astype(np.float64, copy=False)
        both -= share[0] * means[1]
        both *= twist.astype(np.float64, copy=False)
        both += sides[1]
        both += sides[0]
        return both


class _Along(NamedTuple):
    """Where parts lie along x and along y, mirrored into the first quadrant; float64 [2, n] each.

    Attributes:
        start, step: where their dots begin, and the way to the ends.
        low: where the parts begin.
        first, last: where the rim's run through them begins and ends.
        across: how far they reach along the other axis.
        base: what makes the area before a line begin at 0.
    """

    start: Floats
    step: Floats
    low: Floats
    first: Floats
    last: Floats
    across: Floats
    base: Floats

    @classmethod
    def of(cls, is_round: bool, ends: Floats, mirrored: tuple[bool, bool]) -> _Along:
        """Of dots that begin and end, float64 [2, 2, k], along x and along y."""
        ends = np.stack([-axis[::-1] if flip else axis for axis, flip in zip(ends, mirrored, strict=True)])
        start = ends[:, 0]
        # Also for dots beyond a disc, whose areas rounding may leave above 0.
        low, high = np.clip(ends, 0, 1).swapaxes(0, 1)
        first, last = (np.clip(_height(end[::-1]), low, high) for end in (high, low)) if is_round else (high, high)
        across = (high - low)[::-1]
        base = low[::-1] * first - across * low - _integral(first, _height(first))
        return cls(start, ends[:, 1] - start, low, first, last, across, base)


class _Lines(NamedTuple):
    """Lines across parts, across x and across y; float64 [2, n] each.

    Attributes:
        low: where the part begins.
        place: of the line, from there on.
        on_rim: the nearest place at which the rim runs through the part.
        height: of the rim there.
        before: what is clear of the part before the line.
    """

    low: Floats
    place: Floats
    on_rim: Floats
    height: Floats
    before: Floats

    @classmethod
    def of(cls, along: _Along, share: Floats) -> _Lines:
        """Lines at shares of mirrored dots."""
        place = share * along.step
        place += along.start
        np.maximum(place, along.low, out=place)
        on_rim = np.maximum(place, along.first)
        np.minimum(on_rim, along.last, out=on_rim)
        height = _height(on_rim)
        before = np.minimum(place, along.first)
        before *= along.across
        before += _integral(on_rim, height)
        before -= along.low[::-1] * on_rim
        before += along.base
        return cls(along.low, place, on_rim, height, before)

    def rectangle(self) -> Floats:
        """Area of the rectangle before lines across both axes, as far as the rim runs."""
        sides = np.minimum(self.place, self.on_rim)
        sides -= self.low
        return np.asarray(sides[0] * sides[1])


def _height(place: Floats) -> Floats:
    """Of the rim."""
    height = place * place
    np.subtract(1, height, out=height)
    return np.sqrt(height, out=height)


def _integral(place: Floats, height: Floats) -> Floats:
    """Of the rim's height, from 0."""
    integral = np.arcsin(place)
    integral += place * height
    integral *= 0.5
    return integral
