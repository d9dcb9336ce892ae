"""Proven bounds and ideals for all openings of one clear count, to be printed beside a design.

Two numbers are bounded: the expected PSNR far from the sensor's edge, by :mod:`maskfab.designs.model.duals`, and the
area under the radial minimum of the MTF. What leaks in from the edge is bounded by nothing better than 0, and a bound
of the whole frame lay 2 to 5 dB above the best opening known: none is told.

**The area**, the most that it can be, in expectation, by linear programming. It is the mean over whole lags r = 0, 1,
... up to half a cycle per pixel of the least of S(t) M(t) sinc(t) over the lags t of length r, rounded; M is the unit's
modulation, which is linear in these unknowns:

* repeated: C, with C(0) = 1, C >= 0, sum over residues c;
* turned at random: M(t) = C(t mod n) at lags of a cell and more, and C + L - B at shorter ones. L is the mean of the
  turned units' autocorrelations, B that of their mean, both over the c clear dots: L(0) = 1, L, B >= 0, sums c, and
  C(d) is the sum of B over the lags of residue d. L - B, B and L are positive semidefinite, at the points of a cosine
  transform that has no wrap-round.

The minimum of linear functions is concave, so its largest mean is a linear programme (Boyd, Vandenberghe, Convex
Optimization, 4.3.1), and the mean's expectation over layouts is at most its value at the expected modulation (Jensen).
What is returned is the programme's dual objective, recomputed from its multipliers, which bounds it whatever the
solver's accuracy.

Notes:
    That autocorrelations are positive semidefinite tightens the bound on the PSNR by at most 0.002 dB (100 of 441 dots,
    at the best ε), for 0.7 s per ε and level; it is left out there and kept in the bound on the area.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, sparse

from maskfab.base.arrays import Floats
from maskfab.camera.stop_cells import CellGrid, OpenStop, at_lags, lattice, pupil_autocorrelation
from maskfab.designs.model.duals import residue_classes, residue_errors, residues
from maskfab.designs.model.expected_psnr import Interior, Surrogate, interior, unit_modulation
from maskfab.mask.opening_masks import require_clear_dots


@dataclass(frozen=True, eq=False)
class Rings:
    """Lags 0 <= y <= x up to half a cycle per pixel, and the open stop's MTF at them.

    Attributes:
        lags: int64 [2, m], y and x in dots.
        ring: int64 [m], length of each lag, rounded.
        clear: [m], the open stop's autocorrelation times the pixel's sinc.
    """

    dots: int
    lags: NDArray[np.int64]
    ring: NDArray[np.int64]
    clear: Floats

    @property
    def count(self) -> int:
        """Rings; the area is the mean over them."""
        return int(self.ring.max()) + 1

    def area(self, modulation: Floats) -> float:
        """Mean over the rings of the least of a modulation [..., m] relative to the open stop, -> 1 at lag 0."""
        least = np.full(self.count, np.inf)
        for values in np.atleast_2d(modulation):
            np.minimum.at(least, self.ring, self.clear * values)
        return float(least.mean())

    def of_unit(self, unit: NDArray[np.bool_], *, periodic: bool = False) -> float:
        """Area of a unit's expected modulation, turned at random or repeated."""
        n = self.dots
        far, near = unit_modulation(unit, periodic=periodic)
        y, x = self.lags
        moduli = []
        for v, u in [(y, x), (-y, x), (x, y), (-x, y)]:
            short = np.maximum(abs(v), abs(u)) < n
            moduli.append(np.where(short, near[v % (2 * n), u % (2 * n)], far[v % n, u % n]))
        return self.area(np.stack(moduli))


def rings(dots: int = 21, *, room: CellGrid | None = None) -> Rings:
    """The rings of a camera at its shortest wavelength; of cells of 168 um behind protocol F1's without a ``room``."""
    room = room or lattice(dots)
    nm = room.camera.shortest_nm
    per_cycle = room.per_cycle(nm)
    longest = round(per_cycle / 2)
    y, x = (v.ravel() for v in np.mgrid[0 : longest + 1, 0 : longest + 1])
    ring = np.rint(np.hypot(y, x)).astype(np.int64)
    inside = (y <= x) & (ring <= int(per_cycle / 2))
    y, x, ring = y[inside], x[inside], ring[inside]
    clear = np.maximum(OpenStop.of(room, nm).at(y, x), 0) * np.sinc(y / per_cycle) * np.sinc(x / per_cycle)
    return Rings(dots, np.stack([y, x]), ring, clear)


def auc_bound(around: Rings, clear_dots: int, *, periodic: bool, positive: bool = True) -> float:
    """No unit of this clear count has a larger expected area.

    Args:
        clear_dots: of the unit, at least 1.
        periodic: the unit is repeated; otherwise turned at random.
        positive: use that autocorrelations are positive semidefinite (turned at random only).
    """
    n, count = around.dots, around.count
    y, x = around.lags
    every, size = residue_classes(n)
    classes = len(size)
    far = np.full(len(y), True) if periodic else np.maximum(y, x) >= n
    # Of the lags of one ring and one residue only the faintest can be the least.
    least = np.full(count * classes, np.inf)
    np.minimum.at(least, (around.ring * classes + every[y % n, x % n])[far], around.clear[far])
    place = np.flatnonzero(np.isfinite(least))
    ring, residue = np.divmod(place, classes)
    rows = np.arange(len(place))
    areas = sparse.csr_array((np.ones(len(place)), (rows, ring)), shape=(len(place), count))
    scaled = sparse.csr_array((least[place], (rows, residue)), shape=(len(place), classes))
    if periodic:
        # Columns: the rings' least values, then C. Its value at residue 0 is 1.
        fixed = sparse.csr_array(([1.0], ([0], [0])), shape=(1, classes))
        equal = sparse.hstack(
            [sparse.csr_array((2, count)), sparse.vstack([fixed, sparse.csr_array(size[None])])], format="csr"
        )
        return _most(sparse.hstack([areas, -scaled], format="csr"), equal, np.array([1.0, clear_dots]), count)
    v, u = (w.ravel() for w in np.mgrid[0:n, 0:n])
    half = v <= u
    v, u = v[half], u[half]
    shorts = len(v)
    images = np.where((v == u) | (v == 0), 4.0, 8.0)
    images[0] = 1
    # Each residue of a class has as many members among the short lags, in all, as the class has lags over its size.
    of_short = every[v, u]
    circular = sparse.csr_array((images / size[of_short], (of_short, np.arange(shorts))), shape=(classes, shorts))
    number = np.full((n, n), -1)
    number[v, u] = np.arange(shorts)
    near = np.flatnonzero(~far)
    short = number[y[near], x[near]]
    picked = sparse.csr_array(
        (around.clear[near], (np.arange(len(near)), short)), shape=(len(near), shorts), dtype=np.float64
    )
    ring_near = sparse.csr_array((np.ones(len(near)), (np.arange(len(near)), around.ring[near])), (len(near), count))
    expand = sparse.csr_array((np.ones(shorts), (np.arange(shorts), of_short)), shape=(shorts, classes)) @ circular
    none = sparse.csr_array((len(place), shorts))
    upper = [
        sparse.hstack([areas, -(scaled @ circular), none]),
        sparse.hstack([ring_near, -(picked @ (expand - sparse.eye_array(shorts))), -picked]),
    ]
    if positive:
        cosine = np.cos(np.pi * np.outer(np.arange(n + 1), np.arange(n)) / n)
        j, k = np.triu_indices(n + 1)
        waves = sparse.csr_array(images * (cosine[j][:, v] * cosine[k][:, u] + cosine[k][:, v] * cosine[j][:, u]) / 2)
        zero = sparse.csr_array((len(j), count))
        upper += [sparse.hstack([zero, -waves, sparse.csr_array(waves.shape)]), sparse.hstack([zero, waves, -waves])]
    start = sparse.csr_array(([1.0], ([0], [count + shorts])), shape=(1, count + 2 * shorts))
    blank = np.zeros(count)
    sums = np.stack([np.r_[blank, images, 0 * images], np.r_[blank, 0 * images, images]])
    equal = sparse.vstack([start, sparse.csr_array(sums)], format="csr")
    return _most(sparse.vstack(upper, format="csr"), equal, np.array([1.0, clear_dots, clear_dots]), count)


def _most(upper: sparse.csr_array, equal: sparse.csr_array, value: Floats, count: int) -> float:
    """Largest mean of the first ``count`` unknowns, all within 0 to 1, where upper · z <= 0 and equal · z = value."""
    goal = np.zeros(upper.shape[1])
    goal[:count] = -1 / count
    # All ones: no modulation exceeds the open stop's.
    solved = optimize.linprog(
        goal, A_ub=upper, b_ub=np.zeros(upper.shape[0]), A_eq=equal, b_eq=value, bounds=(0, 1), method="highs-ipm"
    )
    if not solved.success:
        return 1.0
    slack = np.minimum(np.asarray(solved.ineqlin.marginals), 0)
    price = np.asarray(solved.eqlin.marginals)
    # Weak duality: whatever the multipliers, the unknowns' reduced costs are paid within their bounds.
    reduced = goal - upper.T @ slack - equal.T @ price
    return -float(price @ value + np.minimum(reduced, 0).sum())


_MOST_DOTS_OF_LP = 25


@dataclass(frozen=True)
class Bounds:
    """Upper bounds that no opening can exceed, at each level of light.

    Attributes:
        level_db: levels of light in dB.
        periodic: the unit is repeated; otherwise turned at random.
        psnr: dB, no unit tiled so has a higher expected interior PSNR.
        grey: dB, a neutral filter that passes as much light, which is also the open stop exposed as briefly.
        open_stop: dB, a clear stop of the area that is clear.
        auc: no unit has a larger expected area under the radial minimum of the blue MTF; None above 25 dots a side,
            where its linear programme takes minutes.
        method: how each was found, and under which assumptions it holds.
    """

    level_db: tuple[float, ...]
    clear_dots: int
    periodic: bool
    psnr: tuple[float, ...]
    grey: tuple[float, ...]
    open_stop: tuple[float, ...]
    auc: float | None
    method: tuple[str, ...]


@dataclass(frozen=True)
class Gap:
    """Distance of a design from its bounds.

    Attributes:
        psnr: dB, its expected interior PSNR at each level.
        head_room: dB, what at most could be gained in the interior; not below 0.
        auc: its expected area under the radial minimum of the blue MTF.
    """

    bounds: Bounds
    psnr: tuple[float, ...]
    head_room: tuple[float, ...]
    auc: float


def bounds(
    estimate: Surrogate, clear_dots: int, *, periodic: bool = False, levels: Sequence[float] | None = None
) -> Bounds:
    """Bounds for units of the surrogate's size, its scenes and its camera.

    Args:
        levels: of light; None for the surrogate's own.

    Raises:
        OpeningError: MF203 if no dot is clear; MF204 if there are more than the unit has.
        JobError: MF104 for a level that there is not.
    """
    total = estimate.dots**2
    require_clear_dots(clear_dots, total, where="clear_dots")
    levels = estimate.levels if levels is None else levels
    estimate.noise.settings.require(levels)
    inner = interior(estimate)
    ratio = clear_dots / total
    grey_light = [inner.psnr(a, ratio, g, levels) for a, g in ((inner.stop, 1.0), (_smaller_stop(inner, ratio), 0.0))]
    grey, small = grey_light
    variances = [inner.noise.variance(level, ratio) for level in levels]
    errors = residue_errors(inner, residues(inner, periodic=periodic), ratio, variances, periodic=periodic)
    interior_psnr = tuple(inner.decibels(level, error) for level, error in zip(levels, errors, strict=True))
    area = None
    if estimate.dots <= _MOST_DOTS_OF_LP:
        area = auc_bound(rings(estimate.dots, room=estimate.lattice), clear_dots, periodic=periodic)
    method = [
        "psnr: Lagrangian dual over lag residues, least over the protocol's ε; cut cells as whole ones",
        "auc: linear programme's dual, positive semidefinite" if not periodic else "auc: linear programme's dual",
    ]
    return Bounds(tuple(levels), clear_dots, periodic, interior_psnr, grey, small, area, tuple(method))


def optimality_gap(estimate: Surrogate, unit: NDArray[np.bool_], limit: Bounds) -> Gap:
    """A unit, bool [dots, dots], beside the bounds of its clear count."""
    reached = interior(estimate).of_unit(unit, periodic=limit.periodic, levels=limit.level_db)
    area = rings(estimate.dots, room=estimate.lattice).of_unit(unit, periodic=limit.periodic)
    return Gap(limit, reached, tuple(max(0.0, a - b) for a, b in zip(limit.psnr, reached, strict=True)), area)


def _smaller_stop(inner: Interior, ratio: float) -> Floats:
    """Autocorrelation at the lags of a clear round stop of ``ratio`` times the area."""
    side = inner.lattice.side
    distance = (np.arange(side) - (side - 1) / 2) ** 2
    square = distance[:, None] + distance
    # As many dots as are clear, nearest to the axis first.
    area = max(1, round(ratio * inner.lattice.stop.sum()))
    clear = (square <= np.partition(square.ravel(), area - 1)[area - 1]).astype(np.float64)
    table = pupil_autocorrelation(clear)
    y, x = inner.lags
    return np.asarray(np.maximum(at_lags(table, y, x), 0) / table[side - 1, side - 1])
