"""The autocorrelation of openings in a film that leaks, strips between cells included.

With t the openings, S the clear stop and τ the film's amplitude, a = τ S + (1 - τ) t, and

    (a ⋆ a)(s) = |1 - τ|² (t ⋆ t)(s) + |τ|² (S ⋆ S)(s) + c X(s) + c* X(-s),
    c = (1 - τ) τ*,    X(s) = ∫ t(r) S(r + s) d²r.

The first is the table of the openings. The others are smooth, for S has no edge but its rim, and have a table of their
own: that of means over even squares, between whole steps of which it is linear. Shapes within squares change that
where a square meets the rim of the moved stop (see :mod:`maskfab.optics.shape_bounds`): of t by at most h² / 4 in every
square whose sweep meets the rim, of S by its own w in every square that its rim cuts.

The imaginary part, c.imag (X(s) - X(-s)), is where the openings on one side of the stop differ from those on the other.
It enters the modulus squared, and is counted as an error.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from maskfab.base.arrays import Floats, fast_length
from maskfab.optics.lags import AxisLags, LagTable, axis_lags, lag_table
from maskfab.optics.psf import Leak
from maskfab.optics.pupil import Lattice, Pupil, share_inside

_SQUARES = 512


def lit_lags(openings: Pupil, leak: Leak, reach_um: float) -> tuple[LagTable, tuple[AxisLags, AxisLags]]:
    """Tables of all that passes light: of lags up to a reach, and of those along the axes, x first."""
    part = openings.scaled(abs(1 - leak.amplitude))
    film = _film(openings, leak)
    table = lag_table(part, reach_um)
    shares = part.energy_um2 / film.energy_um2
    lit = replace(
        table, energy_um2=film.energy_um2, floor=table.floor * shares + film.floor, film=replace(film, floor=0.0)
    )
    # Along an axis all lags are in the table's first row or column, and have its bound.
    of_film = (
        AxisLags(film.x, film.values[0, 0], film.x.dot_um, np.zeros(1)),
        AxisLags(film.y, film.values[:, :, 0, 0], film.y.dot_um, np.zeros(1)),
    )
    along = axis_lags(part, part.energy_um2)
    x, y = (replace(axis, film=other) for axis, other in zip(along, of_film, strict=True))
    return lit, (x, y)


def _film(openings: Pupil, leak: Leak) -> LagTable:
    """Table of what the film adds to the openings; its energy is all that passes, its floor the error of all of it."""
    stop, amplitude = leak.stop, leak.amplitude
    x, y = (Lattice(-side / 2, _SQUARES, 1, side / _SQUARES, side / _SQUARES) for side in stop.sides_um)
    clear, area = share_inside(x, y, stop), x.dot_um * y.dot_um
    across, up = (_shares(lattice, even) for lattice, even in ((openings.x, x), (openings.y, y)))
    dots = up @ openings.whole @ across.T
    dots += up[:, openings.rim_row] * openings.rim_transmission @ across[:, openings.rim_column].T
    opened, on_rim = dots * clear, (clear > 0) & (clear < 1)
    # Where both vary, means of products are known by their sum.
    opened[on_rim] *= (openings.field_integral_um2 / area - opened[~on_rim].sum()) / max(opened[on_rim].sum(), 1e-300)
    size = fast_length(2 * _SQUARES)
    # Of few squares their transforms are the largest things here: one at a time.
    waves = np.fft.rfft2(opened, (size, size)).conj()
    waves *= np.fft.rfft2(clear, (size, size))
    ahead = np.fft.irfft2(waves) * area
    del waves
    behind = np.roll(ahead[::-1, ::-1], 1, (0, 1))
    farthest = float(abs(ahead - behind).max())
    turned = (1 - amplitude) * amplitude.conjugate()
    total = turned.real * (ahead + behind)
    del ahead, behind
    total += abs(amplitude) ** 2 * area * np.fft.irfft2(abs(np.fft.rfft2(clear, (size, size))) ** 2)
    energy = leak.energy_um2(openings.energy_um2)
    own = energy - abs(1 - amplitude) ** 2 * openings.energy_um2 - float(total[0, 0])
    total[0, 0] += own
    # Sweeps of two squares along either axis that the rim crosses, and w of the squares that it cuts.
    ends = [np.pad(extreme, 1) for extreme in (np.ceil(clear - 1e-12), np.floor(clear + 1e-12))]
    corners = [[part[j : j + _SQUARES + 1, i : i + _SQUARES + 1] for j in (0, 1) for i in (0, 1)] for part in ends]
    swept = float((np.maximum.reduce(corners[0]) - np.minimum.reduce(corners[1])).sum())
    cut = float((clear * (1 - clear)).sum())
    one_way = (swept / 4 + cut + np.count_nonzero(on_rim & (dots > 0) & (dots < 1)) / 4) * area
    error = abs(amplitude) ** 2 * 2 * cut * area + 2 * abs(turned.real) * one_way + abs(own)
    error += abs(turned.imag) * (farthest + 2 * one_way)
    values = total.reshape(size, 1, size, 1)
    return LagTable(x, y, values, np.inf, energy, error / energy, sum_um2=float(total.sum()) - own)


def _shares(lattice: Lattice, even: Lattice) -> Floats:
    """Shares of even steps that lie in a lattice's intervals, [steps, intervals]."""
    (low, high), (begin, end) = ((edges[:-1], edges[1:]) for edges in (lattice.edges_um(), even.edges_um()))
    return np.asarray(np.clip(np.minimum(high, end[:, None]) - np.maximum(low, begin[:, None]), 0, None) / even.dot_um)
