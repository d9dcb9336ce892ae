"""Proven upper bound on the PSNR of layouts that pass as much light through every cell, far from the sensor's edge.

**The theorem.** Let p be the pupil's dots, 0 or 1, with n clear ones of the m dots that a cell has inside the stop; q
spreads each cell's n evenly, and u = p - q. In every cell u sums to 0, and the sum of u² over all is known: that of
n (1 - n/m). For any even weights w of lags, w(0) = 0, with W the convolution by them,

    A(0) sum over t of w(t) A(t)  =  q·Wq + 2 u·Wq + u·Wu.

The first is known. The second is at most what every cell gains by putting its dots where Wq is largest. The third is at
most λ u·u, λ the largest eigenvalue of W among functions that sum to 0 in every cell: on a torus on which no lag wraps
it is found phase by phase (Bloch), where W is diagonal and the sum over a cell is one condition. It is sharpened by
what ramps, whose eigenvalue is the largest, can hold of u·u: dots packed to one side of the cell have about half. With
β above the eigenvalues of what is orthogonal to ramps, and W <= β + γ (ramps), u·Wu <= β u·u + γ (what ramps hold).

**The dual.** As in :mod:`maskfab.designs.model.duals`, for every w,

    E  >=  sum over t of min over a of (e(t, a) + w(t) a)  -  (the bound on the right) / A(0),

for the best filter at each frequency, within what the protocol's ε span there; the best w is sought near the slope of E
at the grey panel of the same light.

Notes:
    It says nothing of layouts that share light otherwise between cells, nor of what leaks in from the frame's edge.
    What sampling folds back is that of a grey panel, as everywhere here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
import scipy
from scipy import optimize

from maskfab.base.arrays import Complexes, Floats, Ints
from maskfab.base.errors import JobError
from maskfab.base.processes import ALONE, Call, SerialExecutor
from maskfab.camera.stop_cells import CellGrid, at_lags, pupil_autocorrelation
from maskfab.designs.model.duals import best_regular, wiener_cost
from maskfab.designs.model.expected_psnr import Interior, Surrogate, interior

_TRIES = 36
_STEP = 0.4
_SCALES = (1.0, 4.3)
"""Of the Gaussians by whose exponentials w differs from the slope at a grey panel, in cells."""
_BETAS = (0.05, 0.1, 0.2, 0.3, 0.45, 0.6)
_HALVINGS = 40
_FAINT = 0.1
_ANGLES = 46
_LARGEST = 1100
"""Dots along the torus; beyond it the bound takes minutes."""


@dataclass(frozen=True)
class LayoutGap:
    """A layout beside its bound, both far from the sensor's edge and with the best filter at each frequency.

    Attributes:
        psnr: dB, expected behind the layout.
        limit: dB, no layout that passes as much light through every cell has a higher PSNR.
        head_room: dB, what at most could be gained over the layout.
    """

    level_db: tuple[float, ...]
    psnr: tuple[float, ...]
    limit: tuple[float, ...]

    @property
    def head_room(self) -> tuple[float, ...]:
        return tuple(most - have for most, have in zip(self.limit, self.psnr, strict=True))


def layout_gap(
    estimate: Surrogate, pupil: Floats, *, levels: Sequence[float] | None = None, executor: SerialExecutor = ALONE
) -> LayoutGap | None:
    """A panel that is laid, beside what the light of its cells allows; None for so many dots that it takes minutes.

    Args:
        pupil: of :func:`maskfab.camera.stop_cells.lay`, 0 and 1, 0 outside the stop.
        levels: of light; None for the surrogate's own.

    Raises:
        JobError: MF122 for a pupil of other dots than the surrogate's panel.
    """
    side = estimate.lattice.side
    if pupil.shape != (side, side):
        what = f"the panel has the shape {pupil.shape}, the surrogate's {side} x {side}"
        raise JobError("MF122", what, where="pupil", cure="Lay it with the surrogate's dots")
    inner, levels = interior(estimate), estimate.levels if levels is None else levels
    light = CellLight.of(inner, pupil)
    if light.across * estimate.dots > _LARGEST:
        return None
    reached = tuple(_reached(inner, pupil, level) for level in levels)
    # Where every cell is clear or closed there is no other layout.
    if not light.rough.any():
        return LayoutGap(tuple(levels), reached, reached)
    calls = [Call(layout_limit, partial(tuple, (inner, light, level))) for level in levels]
    return LayoutGap(tuple(levels), reached, tuple(executor.run_alike(calls)))


def _reached(inner: Interior, pupil: Floats, level: float) -> float:
    """dB expected behind a pupil [side, side] with the best filter at each frequency."""
    table = pupil_autocorrelation(pupil)
    y, x = inner.lags
    images = np.stack([at_lags(table, v, u) for v, u in ((y, x), (-y, x), (x, y), (-x, y))]) / table.max()
    share = float(pupil.sum() / inner.stop_dots)
    variance = inner.noise.variance(level, share)
    squared, regular = inner.transfer(images, share) ** 2, best_regular(inner, variance)
    errors = (variance * squared + inner.power * regular**2) / (squared + regular) ** 2
    return inner.decibels(level, float((errors @ inner.weight).mean()))


@dataclass(frozen=True, eq=False)
class CellLight:
    """Light of every cell of a panel, and all of the bound that no weights change.

    Attributes:
        lags: int64 [2, m], 0 <= y <= x, those of the weights.
        clear: int64 [cells, cells], clear dots of every cell inside the stop.
        reach: largest lag along an axis that has pairs inside the stop.
    """

    room: CellGrid
    lags: Ints
    clear: Ints
    reach: int

    @classmethod
    def of(cls, inner: Interior, pupil: Floats) -> CellLight:
        """The light of a pupil [side, side] of 0 and 1."""
        room = inner.lattice
        clear = np.rint(_by_cell(pupil, room).sum(axis=1)).astype(np.int64).reshape(room.cells, room.cells)
        return cls(room, inner.lags, clear, min(int(inner.lags.max()), room.side - 1))

    @property
    def total(self) -> int:
        """Clear dots, A(0)."""
        return int(self.clear.sum())

    @cached_property
    def across(self) -> int:
        """Cells along a torus on which no lag within reach wraps."""
        return -(-(self.room.side + self.reach) // self.room.dots)

    @cached_property
    def inside(self) -> Floats:
        """[cells², dots²] of 0 and 1."""
        return _by_cell(self.room.stop.astype(np.float64), self.room)

    @cached_property
    def spread(self) -> Floats:
        """q, [side, side]."""
        dots = np.maximum(self.inside.sum(axis=1), 1)
        cells, n = self.room.cells, self.room.dots
        even = (self.inside * (self.clear.ravel() / dots)[:, None]).reshape(cells, cells, n, n)
        return np.asarray(even.transpose(0, 2, 1, 3).reshape(self.room.side, self.room.side))

    @cached_property
    def spread_spectrum(self) -> Complexes:
        """Transform of q on the torus, [size, size / 2 + 1]."""
        size = self.across * self.room.dots
        return np.asarray(scipy.fft.rfft2(self.spread, (size, size), workers=1))

    @cached_property
    def rough(self) -> Floats:
        """Sum of u² in every cell, [cells²]."""
        n = self.clear.ravel()
        return np.asarray(n * (1 - n / np.maximum(self.inside.sum(axis=1), 1)))

    @cached_property
    def ramped(self) -> float:
        """Most of the sum of u² that ramps can hold."""
        whole = self.inside.all(axis=1)
        counts, number = np.unique(self.clear.ravel()[whole], return_counts=True)
        most = [_most_ramped(self.room.dots, int(count)) for count in counts]
        return float(number @ np.array(most, dtype=np.float64)) + float(self.rough[~whole].sum())

    @cached_property
    def waves(self) -> tuple[Ints, Ints, Complexes]:
        """Of waves that repeat from cell to cell but for a phase: their frequencies along y and x, [phases, dots] each,
        and by phase the spectra of an even cell and of the ramps along y and x, [phases, 3, dots²]."""
        n, across = self.room.dots, self.across
        slow = [(v, u) for v in range(across // 2 + 1) for u in range(v + 1)]
        starts = np.array(slow).T
        along = starts[:, :, None] + across * np.arange(n)
        place = np.arange(n) - (n - 1) / 2
        basis = np.stack([np.ones(n) / np.sqrt(n), place / np.sqrt(max(float(place @ place), 1.0))])
        spectra = np.exp(-2j * np.pi * np.outer(np.arange(n * across), place) / (n * across)) @ basis.T / np.sqrt(n)
        (v, u), phases = along, len(slow)
        parts = [
            (spectra[v, i][:, :, None] * spectra[u, j][:, None, :]).reshape(phases, -1)
            for i, j in ((0, 0), (1, 0), (0, 1))
        ]
        return v, u, np.stack(parts, axis=1)

    def most(self, weights: Floats, *, sharp: bool) -> float:
        """No layout of this light has a larger sum of w(t) A(t).

        Args:
            weights: [m], w at the lags, each for all its images; 0 at lag 0.
            sharp: use what ramps can hold; otherwise the largest eigenvalue alone.
        """
        side, size = self.room.side, self.across * self.room.dots
        plane = np.zeros((self.reach + 1, self.reach + 1))
        y, x = self.lags
        within = x <= self.reach
        plane[y[within], x[within]] = plane[x[within], y[within]] = weights[within]
        # Weights are even along both axes, and so is their transform: a quarter of each is the whole.
        by_x = 2 * scipy.fft.rfft(plane, size, axis=1, workers=1).real - plane[:, :1]
        quarter = 2 * scipy.fft.rfft(by_x, size, axis=0, workers=1).real - by_x[:1]
        line = np.arange(size)
        line = np.minimum(line, size - line)
        rows = scipy.fft.ifft(self.spread_spectrum * quarter[line], axis=0, overwrite_x=True, workers=1)[:side]
        field = scipy.fft.irfft(rows, size, axis=1, workers=1)[:, :side]
        even = float((self.spread * field).sum())
        return (even + 2 * self._packed(field) + self._scattered(quarter, line, sharp=sharp)) / self.total

    def _packed(self, field: Floats) -> float:
        """Most of u·Wq: every cell's dots where the field is largest."""
        values = _by_cell(field, self.room)
        ranked = -np.sort(np.where(self.inside > 0, -values, np.inf), axis=1)
        taken = np.arange(values.shape[1]) < self.clear.reshape(-1, 1)
        best = np.where(taken, ranked, 0.0).sum(axis=1)
        mean = (values * self.inside).sum(axis=1) / np.maximum(self.inside.sum(axis=1), 1)
        return float((best - self.clear.ravel() * mean).sum())

    def _scattered(self, quarter: Floats, line: Ints, *, sharp: bool) -> float:
        """Most of u·Wu, at least 0, of a quarter of the transform of W and the place of each frequency along it."""
        v, u, parts = self.waves
        values = quarter[line[v][:, :, None], line[u][:, None, :]].reshape(len(v), -1)
        rough = float(self.rough.sum())
        largest = max(_largest(values, parts[:, :1]), 0.0)
        if not sharp or largest == 0 or self.room.dots < 2:
            return largest * rough
        rest = max(_largest(values, parts), 0.0)
        if rest >= largest:
            return largest * rough
        even, ramps = parts[:, 0], parts[:, 1:]
        found = [largest * rough]
        for share in _BETAS:
            beta = rest + share * (largest - rest)
            inverse = 1 / (beta - values)
            seen = ramps.conj() * inverse[:, None]
            crossed = seen @ even[:, :, None]
            among = seen @ ramps.transpose(0, 2, 1)
            alone = (abs(even) ** 2 * inverse).sum(axis=1)
            kept = among - crossed @ crossed.conj().transpose(0, 2, 1) / alone[:, None, None]
            eigen = np.linalg.eigvalsh(kept)
            gamma = float(np.max(np.where(eigen < 0, -1 / np.where(eigen < 0, eigen, -1.0), 0.0)))
            found.append(beta * rough + gamma * self.ramped)
        return min(found)


def layout_limit(inner: Interior, light: CellLight, level: float) -> float:
    """dB that no layout of this light reaches, whatever filter within the protocol's ε is best at each frequency."""
    dual = _Dual.of(inner, light, level)
    return inner.decibels(level, dual(dual.best_bend(), sharp=True))


@dataclass(frozen=True, eq=False)
class _Dual:
    """The dual function at one level.

    Attributes:
        cost: [m, k], as :func:`maskfab.designs.model.duals.wiener_cost` gives it; at lag 0 its least.
        unit: [m], A by A/S, summed over the images of a lag; 0 at lag 0.
        bends: [b, m], what the logarithm of w may differ by.
    """

    light: CellLight
    nodes: Floats
    cost: Floats
    unit: Floats
    slope: Floats
    bends: Floats

    @classmethod
    def of(cls, inner: Interior, light: CellLight, level: float) -> _Dual:
        """Arguments as of :func:`layout_limit`."""
        share = light.total / inner.stop_dots
        variance = inner.noise.variance(level, share)
        zero = inner.lags.sum(axis=0) == 0
        faintest = float(inner.stop.min())
        # No lag has more pairs of clear dots than of dots, of which the stop passes the share that is clear.
        nodes, cost = wiener_cost(inner, variance, share, 1 / (faintest if faintest > _FAINT else share))
        cost[zero] = cost[zero].min()
        grey, regular = inner.transfer(share * inner.stop, share), best_regular(inner, variance)
        falls = variance * (grey**2 - regular) + 2 * inner.power * regular**2
        slope = inner.weight * falls / (grey**2 + regular) ** 3 * 2 * grey * inner.pixel / inner.count
        length = np.hypot(*inner.lags) / inner.dots
        bends = np.stack([np.ones_like(length), *(np.exp(-((length / scale) ** 2) / 2) for scale in _SCALES)])
        unit = np.where(zero, 0.0, inner.count * inner.stop)
        return cls(light, nodes, cost, unit, np.where(zero, 0.0, np.maximum(slope, 0.0)), bends)

    def __call__(self, bend: Floats, *, sharp: bool) -> float:
        """Its value at the weights that the logarithm's difference gives; no error is less."""
        weights = self.slope * np.exp(bend @ self.bends)
        priced = (self.cost + (weights * self.unit)[:, None] * self.nodes).min(axis=1)
        return float(priced.sum()) - self.light.most(weights, sharp=sharp)

    def best_bend(self) -> Floats:
        """The difference at which the value is largest, as far as it was found."""
        start = np.zeros(len(self.bends))
        size = abs(self(start, sharp=False))
        found = optimize.minimize(
            lambda bend: -self(bend, sharp=False) / size,
            start,
            method="Nelder-Mead",
            options={
                "initial_simplex": np.vstack([start, start - _STEP * np.eye(len(start))]),
                "maxfev": _TRIES,
                "xatol": 1e-2,
                "fatol": 1e-4,
            },
        )
        return np.asarray(found.x)


def _by_cell(values: Floats, room: CellGrid) -> Floats:
    """[side, side] as [cells², dots²]."""
    cells, n = room.cells, room.dots
    return np.asarray(values.reshape(cells, n, cells, n).transpose(0, 2, 1, 3).reshape(cells * cells, n * n))


def _largest(values: Floats, held: Complexes) -> float:
    """Largest eigenvalue over all phases of diagonal matrices [phases, k] on what is orthogonal to vectors [phases, j,
    k], from above, by the inertia of the matrix with the vectors as a border."""
    low, high = -float(abs(values).max()) * 1.01, float(values.max())
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        shifted = values - middle
        shifted[shifted == 0] = np.finfo(np.float64).tiny
        seen = (held.conj() / shifted[:, None]) @ held.transpose(0, 2, 1)
        above = (shifted > 0).sum(axis=1) + (np.linalg.eigvalsh(seen) < 0).sum(axis=1) > held.shape[1]
        if above.any():
            # The largest is of one of these phases.
            low, values, held = middle, values[above], held[above]
        else:
            high = middle
    return high


def _most_ramped(dots: int, clear: int) -> float:
    """Most of the sum of u² in one cell that ramps hold, for its clear dots anywhere."""
    place = np.arange(dots) - (dots - 1) / 2
    norm = dots * max(float(place @ place), 1.0)
    angles = np.linspace(0, np.pi / 4, _ANGLES)
    moments = [
        -np.sort(-np.add.outer(np.sin(angle) * place, np.cos(angle) * place).ravel())[:clear].sum() for angle in angles
    ]
    # Between two angles the largest moment grows by no more than the cosine of half their distance.
    return float(max(moments) / np.cos((angles[1] - angles[0]) / 2)) ** 2 / norm
