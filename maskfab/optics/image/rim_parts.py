r"""Parts inside a stop of the dots that it cuts, left of lines and below others, in closed form.

Stretched so that its half sides are 1, a stop is a unit disc or a square; the dark middle of an annulus is one more
disc, taken away. Cut dots are parted at the axes, and every part is mirrored into the first quadrant. There the rim
y(x) = sqrt(1 - x²) falls, and of a part that begins at l and b

    ∫_l^x clip(y(u), b, y₁) - b du = (y₁ - b)(min(x, x₁) - l) + ∫_{x₁}^{max(x, x₁)} y(u) - b du,    y(x₁) = y₁,

is clear, with ∫_0^x y = (x y(x) + asin x) / 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maskfab.model import Stop, frozen

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class RimParts:
    """Parts of cut dots, each in one quadrant of the stop.

    Attributes:
        dot: intp [m], whose part; the first k parts are one of every dot, in order.
        table: float64 [m, 22], one row for each: where it lies along x and along y, see :func:`_along`, and what areas
            of the stretched stop count that lie before a line along x, along y and both, and the clear one of it all.
        round: whether the stop is.
    """

    dot: Indices
    table: Floats
    round: bool

    def __post_init__(self) -> None:
        for name in ("dot", "table"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @classmethod
    def of(cls, stop: Stop, x_um: Floats, y_um: Floats, transmission: Floats) -> RimParts:
        """Parts of dots [k] between x_um [2, k] and y_um [2, k] that a stop cuts, which is no polygon."""
        discs = [(1.0, 1.0), (stop.inner_share, -1.0)] if stop.inner_share else [(1.0, 1.0)]
        width, height = stop.sides_um
        found = []
        for share, sign in discs:
            weight = sign * share**2 * width * height / 4 * transmission
            x, y = x_um * (2 / (share * width)), y_um * (2 / (share * height))
            for mirrored_x in (False, True):
                for mirrored_y in (False, True):
                    *rows, area = _quadrant(stop.round, x, y, mirrored_x, mirrored_y)
                    sign_x, sign_y = (-1.0 if mirrored else 1.0 for mirrored in (mirrored_x, mirrored_y))
                    weights = [weight * factor for factor in (sign_x, sign_y, sign_x * sign_y, area)]
                    found.append((np.stack([*rows, *weights], axis=1), area))
        tables, area = (np.stack(each) for each in zip(*found, strict=True))
        dots = np.arange(transmission.size)
        first = np.argmax(area, axis=0)
        rest = area > 0
        rest[first, dots] = False
        others, dot = np.nonzero(rest)
        return cls(
            np.concatenate([dots, dot]), np.concatenate([tables[first, dots], tables[others, dot]]), stop.round
        )  # fmt: skip

    def excess_um2(self, part: Indices, share_x: Floats, share_y: Floats, quarters: list[Floats]) -> Floats:
        """Area that quarters of parts' dots pass if they transmit unlike amounts, less the mean's share of it.

        Args:
            part: intp [n].
            share_x, share_y: where lines divide the dots, 0 to 1.
            quarters: transmissions [n] of those left and below, right and below, left and above, all less that of the
                one right and above.
        """
        table = self.table.take(part, axis=0).T
        x, y = _Line.of(table[:9], share_x), _Line.of(table[9:18], share_y)
        of_x, of_y, of_both, clear = table[18:]
        here, right, above = quarters
        twist = here - right - above
        mean = clear * y.share
        both = self._before(x, y)
        both *= of_both
        both -= x.share * mean
        both *= twist
        below = y.before
        below *= of_y
        below -= mean
        below *= right + x.mirrored * twist
        both += below
        beside = x.before
        beside *= of_x
        beside -= clear * x.share
        beside *= above + y.mirrored * twist
        both += beside
        return both

    def _before(self, x: _Line, y: _Line) -> Floats:
        """Clear area before lines along both axes."""
        if not self.round:
            return (np.minimum(x.place, x.on_rim) - x.low) * (np.minimum(y.place, y.on_rim) - y.low)
        # x₁ is the rim's height above the line along x.
        area = np.minimum(x.place, y.height)
        area -= x.low
        area *= np.minimum(y.place, y.on_rim) - y.low
        beyond = x.integral + y.integral
        beyond -= y.on_rim * y.height
        beyond -= np.pi / 4
        area += np.maximum(beyond, 0.0, out=beyond)
        run = x.on_rim - y.height
        np.maximum(run, 0.0, out=run)
        run *= y.low
        area -= run
        return area


class _Line(NamedTuple):
    """Lines across parts along one axis.

    Attributes:
        mirrored: 1 where a part is, else 0.
        share: of the dot before the line, less 1 if mirrored.
        low: where the part begins.
        place: of the line, from there on.
        on_rim: the nearest place at which the rim runs through the part.
        height: of the rim there.
        integral: of the height up to there.
        before: what is clear of the part before the line.
    """

    mirrored: Floats
    share: Floats
    low: Floats
    place: Floats
    on_rim: Floats
    height: Floats
    integral: Floats
    before: Floats

    @classmethod
    def of(cls, along: Floats, share: Floats) -> _Line:
        mirrored, start, step, low, first, last, across, bottom, base = along
        share = share - mirrored
        place = share * step
        place += start
        np.maximum(place, low, out=place)
        on_rim = np.maximum(place, first)
        np.minimum(on_rim, last, out=on_rim)
        height = _height(on_rim)
        integral = _integral(on_rim, height)
        before = np.minimum(place, first)
        before *= across
        before += integral
        before -= bottom * on_rim
        before += base
        return cls(mirrored, share, low, place, on_rim, height, integral, before)


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


def _quadrant(is_round: bool, x: Floats, y: Floats, mirrored_x: bool, mirrored_y: bool) -> list[Floats]:
    """Where dots between x [2, k] and y [2, k] lie in one quadrant, and what is clear of them."""
    x, y = (-each[::-1] if mirrored else each for each, mirrored in ((x, mirrored_x), (y, mirrored_y)))
    (left, right), (bottom, top) = np.clip(x, 0, None), np.clip(y, 0, None)
    if is_round:
        first_x, last_x, first_y, last_y = (
            np.clip(_height(np.minimum(far, 1)), low, np.minimum(high, 1))
            for far, low, high in ((top, left, right), (bottom, left, right), (right, bottom, top), (left, bottom, top))
        )
    else:
        left, right, bottom, top = (np.minimum(each, 1) for each in (left, right, bottom, top))
        first_x, last_x, first_y, last_y = right, right, top, top
    along_x = _along(mirrored_x, x, left, first_x, last_x, bottom, top)
    along_y = _along(mirrored_y, y, bottom, first_y, last_y, left, right)
    area = _Line.of(np.stack(along_x), np.full(left.shape, 0.0 if mirrored_x else 1.0)).before
    return [*along_x, *along_y, area]


def _along(
    mirrored: bool, ends: Floats, low: Floats, first: Floats, last: Floats, bottom: Floats, top: Floats
) -> list[Floats]:
    """Where parts lie along one axis.

    Whether they are mirrored, as 0 and 1; where their dots begin, and the way to the ends; where the
    parts begin, and the rim's run through them first and last is; how far they reach across, and from where; and what
    makes the area before a line begin at 0.
    """
    base = bottom * first - (top - bottom) * low - _integral(first, _height(first))
    sign = -1.0 if mirrored else 1.0
    return [
        np.full(low.shape, float(mirrored)), ends[0], sign * (ends[1] - ends[0]),
        low, first, last, top - bottom, bottom, base,
    ]  # fmt: skip
