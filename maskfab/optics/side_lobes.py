r"""Side lobes of a PSF on the field itself: how high the brightest is, how far the nearest, each with a proved error.

A side lobe is a maximum beside the one on the axis that samples of the intensity show, ``FINER`` times as fine as the
PSF's own; a shoulder that none of them parts from a brighter lobe counts with that.

**Between samples** at distance h along both axes a field E of no frequency above B / 2, turned to be real where it is
largest, is nowhere above max |E_n| / cos(π h B / 2)² (Bernstein's inequality as R. Duffin and A. C. Schaeffer have
it, Trans. Amer. Math. Soc. 50, 517, 1941, for each axis in turn). The intensity so is nowhere above cos(π h B / 2)^-4
times its samples: 2.8 where they are as far apart as those of a PSF may be, 1.06 on the finer ones. For a part of the
plane that holds of E times a window. So only tiles with a sample above a third of the brightest lobe are looked at more
finely, and of their maxima all that could still be brighter than the best are climbed. Of a ring, which has as many of
them as samples, ``_MOST_CLIMBS`` are, and what the others could be is in the error.

**A maximum is climbed** on a polynomial through n x n values of the field at Chebyshev nodes of a square of half side a
about it. For 0 <= I <= M of no frequency above B, Bernstein's inequality bounds the n-th derivative along an axis by
(2πB)^n M / 2, so one axis adds to the error of interpolation

    2 (a/2)^n / n! (2πB)^n M / 2 = (πaB)^n / n! M                (NIST Handbook, 3.3.11, at Chebyshev's nodes)

and two of them 1 + Λ times that, Λ = 1 + 2/π ln n being Lebesgue's constant. With n = 18 and a three of the finer
samples' distances that is below 1e-15 of M, which is the peak, the clear area over (λf)², where all light is in phase;
with a film that leaks it is no more than the stop's area over (λf)² (Cauchy, Schwarz). Within an error e of the
polynomial the maximum lies no lower on it than 2 e below its top, so no farther from that than 2 sqrt(e / κ), κ being
the least curvature there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial.chebyshev import chebder, chebpts1, chebvander

from maskfab.base.arrays import Floats
from maskfab.base.model import Quantity
from maskfab.optics.exact_psf import ExactPsf

FINER = 4

# Below it, of the peak, a maximum is rounding noise.
_FAINTEST = 1e-12
_NODES = 18
_LEBESGUE = 1 + 2 / math.pi * math.log(_NODES)
# What parabolas through finer samples lose of a lobe that nothing near outshines; of PSF samples, the bound above.
_LOST, _BETWEEN = 0.015, 2.8
# Samples along a tile; half the side of a square that is climbed, in finer samples; how far a step on it goes, so that
# no other lobe is in sight, and to what of it a place is known; how many steps, and squares, and lobes on a ring.
_TILE, _SQUARE, _FIRST_REACH, _PLACE_ERROR, _NEWTON, _STEPS, _MOST_CLIMBS = 16, 3, 0.25, 1e-7, 100, 32, 200
# Half the side of the first square in which the nearest lobe is looked for, in units of λf / D; then twice as much.
_FIRST_ORDERS = 2.5
# Chebyshev series of the polynomials at the nodes, and of their first and second derivatives, [3, n, n].
_ANALYSIS = 2 / _NODES * chebvander(chebpts1(_NODES), _NODES - 1).T
_ANALYSIS[0] /= 2
_DERIVED = np.stack([np.pad(chebder(_ANALYSIS, times), ((0, times), (0, 0))) for times in range(3)])

_Bend = tuple[tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True)
class Lobe:
    """A maximum of the intensity.

    Attributes:
        x_um, y_um: its place on the sensor.
        intensity, error: per square micrometre, and the bound of its error.
        distance_error_um: bound of the error of its distance from the axis.
    """

    x_um: float
    y_um: float
    intensity: float
    error: float
    distance_error_um: float

    @property
    def distance_um(self) -> float:
        """Distance from the axis."""
        return math.hypot(self.x_um, self.y_um)


@dataclass(frozen=True, eq=False)
class SideLobes:
    """Those of a PSF in its window."""

    psf: ExactPsf

    @property
    def _half_um(self) -> float:
        return float(self.psf.samples.step_um * (self.psf.samples.values.shape[0] // 2))

    @property
    def _finer_um(self) -> float:
        return self.psf.samples.step_um / FINER

    def brightest(self) -> Lobe | None:
        """The brightest side lobe in the window; None if there is none."""
        best: Lobe | None = None
        climbs = 0
        tiles = sorted(self._tiles(), reverse=True)
        for most, row, column in tiles:
            if best is not None and most * _BETWEEN < best.intensity:
                break
            for top, x, y in self._maxima(column, row):
                if best is None or top > (1 - _LOST) * best.intensity:
                    if best is not None and climbs >= _MOST_CLIMBS:
                        # Of a ring all is as bright as its lobes; what is not climbed is in the error.
                        return replace(best, error=best.error + _LOST * best.intensity)
                    lobe, climbs = self.climbed(x, y), climbs + 1
                    best = max((lobe, best), key=lambda each: 0.0 if each is None else each.intensity)
        return best

    def nearest(self) -> Lobe | None:
        """The side lobe next to the axis in the window; None if there is none."""
        reach = _FIRST_ORDERS / self.psf.highest
        while True:
            count = math.ceil(min(reach, self._half_um) / self._finer_um)
            near = sorted(self._maxima((-count, count), (-count, count)), key=lambda found: math.hypot(*found[1:]))
            whole = count * self._finer_um >= self._half_um
            # Of a square's corners only what lies within its inner circle is known to be the nearest.
            known = math.inf if whole else (count - 2) * self._finer_um
            best: Lobe | None = None
            for climbs, (_, x, y) in enumerate(near):
                # A sample may lie as far from its lobe as from the next sample.
                apart = math.hypot(x, y) - 1.5 * self._finer_um
                if apart > min(known - 1.5 * self._finer_um, math.inf if best is None else best.distance_um):
                    break
                if best is not None and climbs >= _MOST_CLIMBS:
                    # Of a ring all is as near as its lobes; what is not climbed is in the error.
                    error = best.distance_error_um + max(0.0, best.distance_um - apart)
                    return replace(best, distance_error_um=error)
                lobe = self.climbed(x, y)
                if lobe is not None and (best is None or lobe.distance_um < best.distance_um):
                    best = lobe
            if best is not None:
                return best
            if whole:
                return None
            reach *= 2

    def _tiles(self) -> Iterator[tuple[float, tuple[int, int], tuple[int, int]]]:
        """The largest sample in or beside each tile, and its finer samples' rows and columns."""
        values, middle = self.psf.samples.values, self.psf.samples.values.shape[0] // 2
        starts = range(0, 2 * middle, _TILE)
        for top in starts:
            for left in starts:
                bottom, right = min(top + _TILE, 2 * middle), min(left + _TILE, 2 * middle)
                part = values[max(0, top - 1) : bottom + 2, max(0, left - 1) : right + 2]
                rows, columns = (
                    (FINER * (a - middle), FINER * (b - middle)) for a, b in ((top, bottom), (left, right))
                )
                yield float(part.max()), rows, columns

    def _maxima(self, columns: tuple[int, int], rows: tuple[int, int]) -> Iterator[tuple[float, float, float]]:
        """Estimated height and place of finer samples that none beside them exceeds, the highest first."""
        x, y = (self._finer_um * np.arange(first - 1, last + 2, dtype=np.float64) for first, last in (columns, rows))
        values = self.psf.intensity(x, y)
        across = np.maximum(np.maximum(values[:, :-2], values[:, 1:-1]), values[:, 2:])
        inner = values[1:-1, 1:-1]
        lobes = inner >= np.maximum(np.maximum(across[:-2], across[1:-1]), across[2:])
        lobes &= inner > _FAINTEST * self.psf.most
        inside = [abs(axis[1:-1]) < self._half_um + self._finer_um / 2 for axis in (y, x)]
        lobes &= inside[0][:, None] & inside[1] & (np.hypot(x[1:-1], y[1:-1, None]) > 1.5 * self._finer_um)
        if self.psf.even:
            lobes &= (y[1:-1, None] > 0) | ((y[1:-1, None] == 0) & (x[1:-1] > 0))
        row, column = np.nonzero(lobes)
        right, across = _parabola([values[row + 1, column + k] for k in range(3)])
        above, up = _parabola([values[row + k, column + 1] for k in range(3)])
        heights = inner[row, column] + right + above
        places = x[column + 1] + self._finer_um * across, y[row + 1] + self._finer_um * up
        order = np.argsort(-heights, kind="stable")
        yield from zip(*(part[order].tolist() for part in (heights, *places)), strict=True)

    def climbed(self, x_um: float, y_um: float) -> Lobe | None:
        """The maximum that a place leads to; None if that is the middle one, or outside the window."""
        side, nodes = _SQUARE * self._finer_um, _SQUARE * self._finer_um * chebpts1(_NODES)
        for _ in range(_STEPS):
            right, up, (top, bend) = _ascended(self.psf.intensity(x_um + nodes, y_um + nodes))
            x_um, y_um = x_um + side * right, y_um + side * up
            if max(abs(right), abs(up)) < 1:
                break
        if math.hypot(x_um, y_um) < self._finer_um or max(abs(x_um), abs(y_um)) > self._half_um:
            return None
        error = (1 + _LEBESGUE) * (math.pi * side * self.psf.highest) ** _NODES / math.factorial(_NODES) * self.psf.most
        error += self.psf.rounding * (2 * math.sqrt(self.psf.most * top) + self.psf.rounding * self.psf.most)
        away, along, square = max(math.hypot(x_um, y_um), side), 0.0, 0.0
        for curvature, across, upward in bend:
            moved = side * min(1.0, 2 * math.sqrt(error / max(-curvature, error))) + _PLACE_ERROR * side
            # Across the radius a lobe that moves is hardly farther.
            along += abs(across * x_um + upward * y_um) / away * moved
            square += moved**2
        return Lobe(x_um, y_um, top, error, along + square / (2 * away))


def _ascended(values: Floats) -> tuple[float, float, tuple[float, _Bend]]:
    """Place, -1 to 1 along x and y, height and bend of the maximum uphill of a square's middle, by nodes [y, x].

    Newton's steps along the axes of curvature, uphill where that is not downward, none longer than keeps other lobes
    out of sight: a ridge is followed as far as it rises.
    """
    # [derivatives by y, orders of y, derivatives by x, orders of x]
    series = np.tensordot(_DERIVED @ values, _DERIVED, (2, 2))
    reach, least = _FIRST_REACH / _SQUARE, float(np.finfo(np.float64).eps * abs(series[0, :, 0]).max())
    orders, x, y = np.arange(_NODES, dtype=np.float64), 0.0, 0.0

    def seen() -> tuple[float, tuple[float, float], _Bend]:
        waves_x, waves_y = np.cos(orders * math.acos(x)), np.cos(orders * math.acos(y))
        (height, right, xx), (up, xy, _), (yy, _, _) = (waves_y @ (series @ waves_x)).tolist()
        return height, (right, up), _bend(xx, xy, yy)

    for _ in range(_NEWTON):
        _, (right, up), bend = seen()
        step_x = step_y = rise = 0.0
        for curvature, across, upward in bend:
            uphill = across * right + upward * up
            step = min(max(uphill / max(abs(curvature), 1e-300), -reach), reach)
            step_x, step_y, rise = step_x + step * across, step_y + step * upward, rise + uphill * step
        before = x, y
        x, y = min(max(x + step_x, -1.0), 1.0), min(max(y + step_y, -1.0), 1.0)
        # Along a ring that is level to rounding no step ends by itself.
        if max(abs(x - before[0]), abs(y - before[1])) < _PLACE_ERROR / 100 or rise < least:
            break
    height, _, bend = seen()
    return x, y, (height, bend)


def _bend(xx: float, xy: float, yy: float) -> _Bend:
    """Curvatures of a surface, the least first, and the unit vectors along x and y of their axes."""
    mean, size, turn = (xx + yy) / 2, math.hypot((xx - yy) / 2, xy), math.atan2(xy, (xx - yy) / 2) / 2
    across, upward = math.cos(turn), math.sin(turn)
    return (mean - size, -upward, across), (mean + size, across, upward)


def _parabola(three: Sequence[Floats]) -> tuple[Floats, Floats]:
    """The rise of a parabola through three values above the middle one, and where its top is, in their distances."""
    before, middle, after = three
    bend = 2 * middle - before - after
    place = np.divide(after - before, 2 * bend, out=np.zeros_like(bend), where=bend > 0)
    return (after - before) * place / 4, place


def peak_to_side_lobe(psf: ExactPsf, die: str | None = None) -> Quantity:
    """Peak over the brightest side lobe; None if the window has none."""
    lobe = SideLobes(psf).brightest()
    middle = psf.samples.values.shape[0] // 2
    value = uncertainty = None
    where = "none inside the window"
    if lobe is not None:
        value = float(psf.samples.values[middle, middle]) / lobe.intensity
        uncertainty = value * (lobe.error / lobe.intensity + 4 * psf.rounding)
        where = f"the brightest is {lobe.distance_um:.4g} um from the axis"
    return Quantity(
        "peak_to_side_lobe",
        value,
        f"peak over the brightest other local maximum, climbed on the field itself; {where}",
        uncertainty=uncertainty,
        die=die,
        wavelength_nm=psf.samples.wavelength_nm,
    )


def first_side_lobe(psf: ExactPsf, die: str | None = None) -> Quantity:
    """Distance of the side lobe nearest to the axis; None if the window has none."""
    lobe = SideLobes(psf).nearest()
    return Quantity(
        "first_side_lobe",
        None if lobe is None else lobe.distance_um,
        "distance from the axis of the nearest other local maximum, climbed on the field itself",
        uncertainty=None if lobe is None else lobe.distance_error_um,
        die=die,
        wavelength_nm=psf.samples.wavelength_nm,
    )
