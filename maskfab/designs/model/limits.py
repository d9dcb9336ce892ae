"""The best that the surrogate returns for any opening of one clear count, found by trying them all.

Where few openings have that count, no proof beats looking: openings that the tiling makes alike are tried once, and the
leak, which is most of the work and at least nothing, only of those that could be the best without it.

A proven limit of the surrogate itself: of the whole frame, what leaks in from the sensor's edge included.

:mod:`maskfab.designs.model.expected_psnr` takes every lag and follows the spectrum's power law down to the lowest
frequency.

The surrogate (:mod:`maskfab.designs.model.expected_psnr`) takes a sample of the lags, and below 1/16 cycle per pixel
it puts the leak in place of the law. For the number that it returns, at its own lags and weights,

    E(ε) = σ² · noise(A) + bias(A) + leak(A, ε),    leak >= 0,

so the least of σ² · noise + bias over all A that an opening of c dots can have bounds E(ε), and the least of these over
the protocol's ε bounds what the surrogate returns. That least is bounded by :func:`residue_error`, whose theorem needs
of the lags only that those of one residue share one number, not that they are all there.

Turned at random, A has the symmetry of the square, and lags that it maps to each other are added up. A repeated unit's
has only A(-t) = A(t): mirror images are kept apart there, as the sample does not hold them equally.

Where few openings have c dots, all are tried instead, leak and all (:mod:`maskfab.designs.model.limits`).

Notes:
    The leak is a mean of squares, hence the 0, and all that a design loses by leaking counts as head-room, though even
    the most compact opening leaks. With the leak goes all that the filter holds back at low frequencies, and the dual
    may let them vanish to save their noise: without any leak, the best unit found lies 0.7 dB below at 24 dB, 0.2 at 32
    and 0.1 at 40, for 100 of 441.

    Other lower limits of the leak were sought. Wherever it was looked at, it is convex in A, and descent over all that
    the dual allows, leak included, ends 0.02 to 0.6 dB above the best opening of 4 x 4 dots; but that convexity is not
    proved. What is: were the record mirrored without end, which changed the leak by 3 % at most, it would be diagonal
    in cosine waves, each (y / H)² for a y linear in A, which is at least y² over the chord of H². For H from 0 to 1
    that saves an eighth to a third of the slack at 4 x 4 dots, and next to nothing at 21 x 21, where low frequencies
    may vanish.

Upper bound on the gain of any layout with as many clear dots over a designed map, cut cells counted.

A map's light is its own: cells that the stop cuts hold what they were turned to hold. The theorem of
:mod:`maskfab.designs.model.duals` for all layouts counts pairs of cells, so it holds for any number of clear
dots within the stop: whole cells hold c each, cut ones at most c and at most their dots inside, and the rest of the
light lies in the cut ones. That includes every map of one unit, of every one of its mirror images and of other units of
c dots.

The frame's error is at least σ² · noise + bias without the frequencies below 1/16 cycle per pixel, where the leak
counts, which is at least 0 (:mod:`maskfab.designs.model.limits`); the best filter at each frequency, within
what the protocol's ε span there, is better than that of any ε.

Notes:
    Proven for what sampling folds back from a grey panel of the same light, as all bounds here are; a realised panel's
    error has its own in it, so beside that the limit is one of the model.

The most that the area under the radial minimum of the MTF can be, in expectation, by linear programming.

The area is the mean over whole lags r = 0, 1, ... up to half a cycle per pixel of the least of S(t) M(t) sinc(t) over
the lags t of length r, rounded; M is the unit's modulation, which is linear in these unknowns:

* repeated: C, with C(0) = 1, C >= 0, sum over residues c;
* turned at random: M(t) = C(t mod n) at lags of a cell and more, and C + L - B at shorter ones. L is the mean of the
  turned units' autocorrelations, B that of their mean, both over the c clear dots: L(0) = 1, L, B >= 0, sums c, and
  C(d) is the sum of B over the lags of residue d. L - B, B and L are positive semidefinite, at the points of a cosine
  transform that has no wrap-round.

The minimum of linear functions is concave, so its largest mean is a linear programme (Boyd, Vandenberghe, Convex
Optimization, 4.3.1), and the mean's expectation over layouts is at most its value at the expected modulation (Jensen).
What is returned is the programme's dual objective, recomputed from its multipliers, which bounds it whatever the
solver's accuracy.

Proven bounds and ideals for all openings of one clear count, to be printed beside a design.

Two numbers are bounded: the expected PSNR far from the sensor's edge, and the surrogate's own, of the whole frame, in
which what leaks in from the edge counts for at least nothing, unless so few openings have that count that the best of
all is known. Theorems and proofs:
:mod:`maskfab.designs.model.duals`, :mod:`maskfab.designs.model.duals`,
:mod:`maskfab.designs.model.limits`, :mod:`maskfab.designs.model.limits`; of designed maps,
:mod:`maskfab.designs.model.limits`.

Notes:
    That autocorrelations are positive semidefinite tightens the bound on the PSNR by at most 0.002 dB (100 of 441 dots,
    at the best ε), for 0.7 s per ε and level; it is left out there and kept in the bound on the area.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, sparse

from maskfab.base.arrays import Floats
from maskfab.base.errors import JobError, OpeningError
from maskfab.base.model import ORIENTATIONS, orient
from maskfab.camera.lens import CellGrid, OpenStop, at_lags, lattice, pupil_autocorrelation
from maskfab.designs.model.duals import block_error, blocks, residue_classes, residue_errors, residues, wiener_cost
from maskfab.designs.model.expected_psnr import Interior, Surrogate, interior, unit_modulation
from maskfab.mask.opening import require_clear_dots

_MOST_OPENINGS = 20_000
"""All of 4 x 4 dots, whatever their clear count, are at most 12 870."""


def few_openings(dots: int, clear_dots: int) -> bool:
    """Whether all openings of so many clear dots, in a unit of so many along its side, can be tried."""
    return comb(dots**2, clear_dots) <= _MOST_OPENINGS


def best_of_every_opening(
    estimate: Surrogate, clear_dots: int, *, periodic: bool, levels: Sequence[float]
) -> tuple[float, ...]:
    """dB at each level of the best opening, as the surrogate returns it.

    Args:
        estimate: of the scenes.
        clear_dots: of the unit, at least 1.
        periodic: the unit is repeated; otherwise turned at random.
        levels: of light.
    """
    units = distinct_openings(estimate.dots, clear_dots, periodic=periodic)
    share = clear_dots / estimate.dots**2
    leakless = [estimate.leakless_errors(unit, periodic=periodic) for unit in units]
    psnr: dict[int, tuple[float, ...]] = {}
    best = []
    for k, level in enumerate(levels):
        least = np.array([errors(level, share).min() for errors in leakless])
        highest = -np.inf
        for place in least.argsort():
            if estimate.decibels(level, float(least[place])) <= highest:
                break
            if place not in psnr:
                psnr[place] = estimate(units[place], periodic=periodic, levels=levels)
            highest = max(highest, psnr[place][k])
        best.append(highest)
    return tuple(best)


def distinct_openings(dots: int, clear_dots: int, *, periodic: bool) -> NDArray[np.bool_]:
    """[openings, dots, dots]: one of all those that the surrogate cannot tell apart.

    Turned at random, a unit is any of its eight orientations; repeated, it can begin anywhere, and its autocorrelation
    is that of its half turn.
    """
    places = np.array(list(combinations(range(dots**2), clear_dots)))
    cells = np.arange(dots**2).reshape(dots, dots)
    if periodic:
        moved = [np.roll(cells, (v, u), axis=(0, 1)) for v in range(dots) for u in range(dots)]
        images = moved + [image[::-1, ::-1] for image in moved]
    else:
        images = [orient(cells, k) for k in range(ORIENTATIONS)]
    openings = np.zeros((len(places), dots**2), dtype=np.bool_)
    np.put_along_axis(openings, places, values=True, axis=1)
    packed = np.packbits(openings, axis=1)
    # Of openings in dictionary order, each is told by its place.
    order = np.lexsort(packed.T[::-1])
    named = _words(packed[order])
    first = np.arange(len(order))
    for image in images:
        moved_words = _words(np.packbits(openings[order][:, image.ravel()], axis=1))
        first = np.minimum(first, np.searchsorted(named, moved_words))
    tried: NDArray[np.bool_] = openings[order][first == np.arange(len(order))]
    return tried.reshape(-1, dots, dots)


def _words(packed: NDArray[np.uint8]) -> NDArray[np.bytes_]:
    """Rows of bytes as one value each; they have one length, so that zeros cut off at the end tell no two alike."""
    return np.ascontiguousarray(packed).view(f"S{packed.shape[1]}").ravel()


def sampled(estimate: Surrogate, inner: Interior, *, periodic: bool) -> Interior:
    """The surrogate's own lags, with no power where the leak counts instead.

    Args:
        estimate: of the scenes.
        inner: of the same, by :func:`maskfab.designs.model.expected_psnr.interior`.
        periodic: keep every lag of the upper half plane; otherwise only 0 <= y <= x, mirror images added up.
    """
    lags = estimate.lags if periodic else np.sort(abs(estimate.lags), axis=0)
    distinct, first, place = np.unique(lags, axis=1, return_index=True, return_inverse=True)
    place = place.ravel()
    weight = np.bincount(place, estimate.weight).astype(np.float64)
    y, x = distinct
    if periodic:
        count = np.where((y == 0) & (x == 0), 1.0, 2.0)
    else:
        count = np.where(y == x, 4.0, 8.0) / np.where(y == 0, 2, 1)
        count[(y == 0) & (x == 0)] = 1
    return replace(
        inner,
        lags=distinct,
        count=count,
        weight=weight,
        stop=np.maximum(estimate.clear[first], 0),
        pixel=np.ones(len(first)),
        folded=estimate.folded[first],
        power=np.bincount(place, estimate.signal) / weight,
        inverse_prior=estimate.inverse_prior[first],
    )


def frame_bound(
    estimate: Surrogate,
    inner: Interior,
    clear_dots: int,
    *,
    periodic: bool = False,
    levels: Sequence[float] | None = None,
) -> tuple[float, ...]:
    """dB at each level; for no unit of this clear count the surrogate returns more.

    Args:
        estimate: of the scenes.
        inner: of the same.
        clear_dots: of the unit, at least 1.
        periodic: the unit is repeated; otherwise turned at random.
        levels: of light; None for the surrogate's own.
    """
    levels = estimate.levels if levels is None else levels
    if few_openings(estimate.dots, clear_dots):
        return best_of_every_opening(estimate, clear_dots, periodic=periodic, levels=levels)
    ratio = clear_dots / estimate.dots**2
    own = sampled(estimate, inner, periodic=periodic)
    classes = residues(own, periodic=periodic, mirrored=not periodic)
    variance = [own.noise.variance(level, ratio) for level in levels]
    least = residue_errors(own, classes, ratio, variance, periodic=periodic)
    # Brighter light has less noise for every unit and ε, so what bounds the error there bounds it in dimmer light.
    least = [max(e for e, v in zip(least, variance, strict=True) if v <= own_v) for own_v in variance]
    return tuple(own.decibels(level, v) for level, v in zip(levels, least, strict=True))


_STEPS = 30
_NODES = 32
"""Of A; twice as many change the limit of 100 dots of 441 by less than 0.03 dB."""
_FAINT = 0.1
_LOW = 1 / 16
"""Cycles per pixel below which, on both axes, the leak takes the bias's place."""


@dataclass(frozen=True)
class MapGap:
    """A layout beside its bound.

    Attributes:
        level_db: levels of light in dB.
        open_share: of the stop, the layout's own.
        limit: dB, no layout of as many dots in each whole cell and as much light has a higher PSNR.
        head_room: dB, what at most could be gained over the layout; not below 0.
    """

    level_db: tuple[float, ...]
    open_share: float
    limit: tuple[float, ...]
    head_room: tuple[float, ...]


def map_gap(
    estimate: Surrogate,
    pupil: Floats,
    clear_dots: int,
    psnr: Sequence[float],
    *,
    levels: Sequence[float] | None = None,
) -> MapGap:
    """A panel that is laid, beside what its clear dots and its light allow.

    Args:
        estimate: of the scenes.
        pupil: of :func:`maskfab.camera.lens.lay`, 0 outside the stop.
        clear_dots: of every whole cell.
        psnr: dB at each level, as :class:`maskfab.designs.model.panel_error.PupilError` finds it for the pupil.
        levels: of light; None for the surrogate's own.

    Raises:
        JobError: MF122 for a pupil of other dots than the surrogate's panel.
    """
    side = estimate.lattice.side
    if pupil.shape != (side, side):
        what = f"the panel has the shape {pupil.shape}, the surrogate's {side} x {side}"
        raise JobError("MF122", what, where="pupil", cure="Lay it with the surrogate's dots")
    inner, levels = interior(estimate), estimate.levels if levels is None else levels
    share = float(pupil.sum() / inner.stop_dots)
    limit = tuple(layout_bound(framed(inner), clear_dots / estimate.dots**2, level, share) for level in levels)
    room = tuple(max(0.0, most - have) for most, have in zip(limit, psnr, strict=True))
    return MapGap(tuple(levels), share, limit, room)


def framed(inner: Interior) -> Interior:
    """The lags without what the filter holds back at low frequencies, where the leak counts instead."""
    low = np.abs(inner.lags).max(axis=0) / inner.per_cycle < _LOW
    return replace(inner, power=np.where(low, 0.0, inner.power))


def layout_bound(inner: Interior, ratio: float, level: float, open_share: float) -> float:
    """dB that no layout reaches.

    Args:
        inner: of the camera; its power says what counts.
        ratio: clear share of each whole cell; no cut cell holds more dots.
        level: of light, dB.
        open_share: clear share of the stop.
    """
    faintest = float(inner.stop.min())
    # No lag has more pairs of clear dots than of dots, of which the stop passes the share that is clear.
    most = 1 / (faintest if faintest > _FAINT else open_share)
    nodes, cost = wiener_cost(inner, inner.noise.variance(level, open_share), open_share, most, _NODES)
    around = blocks(inner, ratio, cut_cells=True, open_share=open_share)
    error = block_error(inner, nodes, cost, around, open_share, moving=True, steps=_STEPS)[0]
    return inner.decibels(level, error)


@dataclass(frozen=True, eq=False)
class Rings:
    """Lags 0 <= y <= x up to half a cycle per pixel, and the open stop's MTF at them.

    Attributes:
        dots: along the unit's side.
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


def rings(dots: int = 21, wavelength_nm: float | None = None, *, room: CellGrid | None = None) -> Rings:
    """The rings of a camera.

    Args:
        dots: along the unit's side.
        wavelength_nm: of the light; None for the camera's shortest.
        room: of the cells behind the stop, of so many dots; None for cells of 168 um behind protocol F1's.
    """
    room = room or lattice(dots)
    nm = wavelength_nm or room.camera.shortest_nm
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
        around: the rings of the camera.
        clear_dots: of the unit, at least 1.
        periodic: the unit is repeated; otherwise turned at random.
        positive: use that autocorrelations are positive semidefinite (turned at random only).
    """
    n, count = around.dots, around.count
    y, x = around.lags
    every, size, _ = residue_classes(n)
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
        upper += [
            sparse.hstack([zero, -waves, sparse.csr_array(waves.shape)]),
            sparse.hstack([zero, waves, -waves]),
        ]
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
        clear_dots: of the unit.
        periodic: the unit is repeated; otherwise turned at random.
        psnr: dB, no unit tiled so has a higher expected interior PSNR.
        frame: dB, no unit tiled so has a higher expected PSNR of the whole frame, as the surrogate returns it.
        any_layout: dB, nor has any panel with as many clear dots in each whole cell, however each is drawn and turned,
            and whatever the cells that the stop cuts hold; None if it was not asked for.
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
    frame: tuple[float, ...]
    any_layout: tuple[float, ...] | None
    grey: tuple[float, ...]
    open_stop: tuple[float, ...]
    auc: float | None
    method: tuple[str, ...]


@dataclass(frozen=True)
class Gap:
    """Distance of a design from its bounds.

    Attributes:
        bounds: for its clear count and tiling.
        psnr: dB, its expected interior PSNR at each level.
        head_room: dB, what at most could be gained in the interior; not below 0.
        psnr_frame: dB, what the surrogate returns for it.
        head_room_frame: dB, what at most could be gained there; not below 0.
        auc: its expected area under the radial minimum of the blue MTF.
    """

    bounds: Bounds
    psnr: tuple[float, ...]
    head_room: tuple[float, ...]
    psnr_frame: tuple[float, ...]
    head_room_frame: tuple[float, ...]
    auc: float


def bounds(
    estimate: Surrogate,
    clear_dots: int,
    *,
    periodic: bool = False,
    levels: Sequence[float] | None = None,
    any_layout: bool = True,
) -> Bounds:
    """Bounds for units of the surrogate's size, its scenes and its camera.

    Args:
        estimate: of the scenes, by :func:`maskfab.designs.model.expected_psnr.surrogate`.
        clear_dots: of the unit.
        periodic: the unit is repeated; otherwise turned at random.
        levels: of light; None for the surrogate's own.
        any_layout: find the bound on designed maps too.

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
    whole = frame_bound(estimate, inner, clear_dots, periodic=periodic, levels=levels)
    area = None
    if estimate.dots <= _MOST_DOTS_OF_LP:
        area = auc_bound(rings(estimate.dots, room=estimate.lattice), clear_dots, periodic=periodic)
    method = [
        "psnr: Lagrangian dual over lag residues, least over the protocol's ε; cut cells as whole ones",
        "frame: the best of all openings of so many dots"
        if few_openings(estimate.dots, clear_dots)
        else "frame: the same at the surrogate's own lags; the leak is at least 0",
        "auc: linear programme's dual, positive semidefinite" if not periodic else "auc: linear programme's dual",
    ]
    free = None
    if any_layout:
        free = tuple(layout_bound(inner, ratio, level, ratio) for level in levels)
        method.append(
            "any_layout: Lagrangian dual over blocks of lags, best filter within ε at each frequency, cut cells counted"
        )
    return Bounds(tuple(levels), clear_dots, periodic, interior_psnr, whole, free, grey, small, area, tuple(method))


def optimality_gap(
    estimate: Surrogate,
    unit: NDArray[np.bool_],
    *,
    periodic: bool = False,
    levels: Sequence[float] | None = None,
    known: Bounds | None = None,
) -> Gap:
    """A unit beside the bounds of its clear count.

    Args:
        estimate: of the scenes.
        unit: bool [dots, dots].
        periodic: it is repeated; otherwise turned at random.
        levels: of light; None for the surrogate's own.
        known: bounds found before for this estimate; used if clear count, tiling and levels are the same.

    Raises:
        OpeningError: MF201 if it is not of the surrogate's size, and as :func:`bounds`.
    """
    n = estimate.dots
    if unit.shape != (n, n):
        raise OpeningError("MF201", f"the unit has the shape {unit.shape}", where="unit", cure=f"Give {n} x {n} dots")
    levels = estimate.levels if levels is None else levels
    clear = int(unit.sum())
    fits = known is not None and (known.clear_dots, known.periodic, known.level_db) == (clear, periodic, tuple(levels))
    limit = known if fits and known is not None else bounds(estimate, clear, periodic=periodic, levels=levels)
    reached = interior(estimate).of_unit(unit, periodic=periodic, levels=levels)
    whole = estimate(unit, periodic=periodic, levels=levels)
    area = rings(n, room=estimate.lattice).of_unit(unit, periodic=periodic)
    return Gap(limit, reached, _room(limit.psnr, reached), whole, _room(limit.frame, whole), area)


def _room(most: tuple[float, ...], have: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(max(0.0, a - b) for a, b in zip(most, have, strict=True))


def _smaller_stop(inner: Interior, ratio: float) -> Floats:
    """Autocorrelation at the lags of a clear round stop of ``ratio`` times the area."""
    side = (len(inner.stop_table) + 1) // 2
    distance = (np.arange(side) - (side - 1) / 2) ** 2
    square = distance[:, None] + distance
    # As many dots as are clear, nearest to the axis first.
    area = max(1, round(ratio * inner.lattice.stop.sum()))
    clear = (square <= np.partition(square.ravel(), area - 1)[area - 1]).astype(np.float64)
    table = pupil_autocorrelation(clear)
    y, x = inner.lags
    return np.asarray(np.maximum(at_lags(table, y, x), 0) / table[side - 1, side - 1])
