"""Evenness of a white field whose pixels are turned at random, as the eye sees it, without a picture.

Let orientation k of the pixel have the transform E_k(f) of its emitted red, green and blue, f in cycles per pixel, each
of mean 1. If every pixel draws its orientation by itself, the field is the lattice of the mean pixel, Ē at whole f,
and noise whose power spectrum is, with the pixel as unit of area,

    C(f) = sum over k of p_k (E_k - Ē)(E_k - Ē)*,         p_k the share of pixels that have it.

S-CIELAB blurs opponent channels and then takes L*a*b*, which for small noise is linear: a matrix B(f), so that the
covariance of L*a*b* is the integral of B C B*, and lattice terms add B Ē Ē* B*. Many pixels add up in what the eye
takes in at once, so that L*a*b* is nearly normal, and the mean ΔE is the mean length of a normal vector,

    E|x| = 1/sqrt(pi) integral over u > 0 of (1 - product of (1 + 2 u^2 w)^-1/2) / u^2 du,

w the eigenvalues of the covariance (the Laplace transform of |x|^2). Slow grain is the same integral of the luminance's
power, up to 10 cycles per degree.

Notes:
    A hundredth of a second for a pixel, against a second for a picture. Of pictures of 100 x 100 pixels that draw their
    orientations, ΔE differs by 2 % below 5; a single wave, such as a lattice that is just seen, is not normal, which
    makes its ΔE up to a sixth too low. Neighbours are taken to be independent: in maps, where they are not, ΔE of the
    shipped displays is up to 5 % higher from 300 mm, and up to 15 % from 600 mm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from maskfab.base.arrays import Complexes, Floats, Labels
from maskfab.base.model import COLOURS, ORIENTATIONS, Emitters, Panel, frozen, orient
from maskfab.display.emitted_light import Viewing, emitters_of
from maskfab.display.emitter_rules import EmitterGrid
from maskfab.display.eye import OPPONENT_OF_RGB, SLOW_CPD, gains
from maskfab.optics.colour import LUMINANCE, lab_of_linear_srgb
from maskfab.optics.polynomials import gauss_legendre

EVEN_LEVEL = 0.5
"""Linear light of the even field, as in the picture of it."""
_HIGHEST_CPD = 30.0
"""Noise beyond passes with less than 1e-3."""
_STEP_CPD, _FINEST_STEP, _MOST_STEPS = 1.0, 0.1, 100
_NODES = 96
_SEARCH_STEP_CPD = 3.0
_NEGLIGIBLE = 1e-8
"""Share of the power of all that lights could do that a search leaves out."""


@dataclass(frozen=True)
class Evenness:
    """Unevenness seen of an even field: mean S-CIELAB difference, and rms luminance contrast to 10 cycles/degree."""

    delta_e: float
    grain: float


def evenness(panel: Panel, viewing: Viewing) -> Evenness:
    """Evenness of a panel's pixels as often turned, each by itself; those all alike that frame a map are left out."""
    contents = [
        (orient(emitters.labels, turn), emitters.cell_nm)
        for emitters in emitters_of(panel)
        for turn in range(ORIENTATIONS)
    ]
    used = np.bincount(_framed(panel.orientations).ravel(), minlength=len(contents))
    held = np.flatnonzero(used)
    pixels = [Emitters(*contents[content]) for content in held]
    return evenness_of(pixels, used[held] / used.sum(), panel.pitch_nm, viewing)


def _framed(cells: Labels) -> Labels:
    """Cells within the frame of those that hold what the corner holds; all of them if nothing else is there."""
    rows, columns = (np.flatnonzero((cells != cells[0, 0]).any(axis=axis)) for axis in (1, 0))
    return cells if not len(rows) else cells[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def evenness_of(pixels: list[Emitters], shares: Floats, pitch_nm: int, viewing: Viewing) -> Evenness:
    """Evenness of pixels drawn from a few kinds.

    Args:
        shares: of the pixels that are of each kind, [kinds].
        pitch_nm: from pixel to pixel; the panel may be seen at another scale, that of ``viewing``.
    """
    ppd = viewing.pixels_per_degree
    step = min(_FINEST_STEP, _STEP_CPD / ppd)
    count = min(_MOST_STEPS, math.ceil(_HIGHEST_CPD / ppd / step))
    f = _frequencies(count, ppd)
    sent = np.stack([_transform(pixel, pitch_nm, f) for pixel in pixels])
    mean = np.tensordot(shares, sent, axes=1)
    off = (sent - mean) * np.sqrt(shares)[:, None, None, None]
    area = (f[1] - f[0]) ** 2
    seen = _lab(off, f, ppd)
    covariance = np.einsum("kayx,kbyx->ab", seen, seen.conj()).real * area
    covariance += _of_lattice(pixels, shares, pitch_nm, ppd)
    slow = np.hypot(f[:, None], f) * ppd <= SLOW_CPD
    luminance = np.tensordot(off, LUMINANCE, axes=(1, 0))
    grain = math.sqrt(float((np.abs(luminance) ** 2).sum(axis=0)[slow].sum()) * area)
    return Evenness(_mean_length(np.linalg.eigvalsh(covariance)), grain)


@lru_cache(maxsize=4)
def sight(grid: EmitterGrid, viewing: Viewing, grain_worth: float = 0.0) -> Floats:
    """Effect of a lit cell on the evenness of a field, as vectors [3, n, n, terms].

    The length of their sum over the cells of a colour over its area, summed over colours, is the rms of ΔE, were every
    pixel turned by any of the eight orientations; with slow grain times its worth in ΔE as one more component.
    """
    ppd = viewing.pixels_per_degree
    count = max(1, min(_MOST_STEPS // 4, math.ceil(_HIGHEST_CPD / min(_SEARCH_STEP_CPD, _FINEST_STEP * ppd))))
    f = _frequencies(count, ppd)[count:]
    along, size = _places(grid.cells, grid.cell_nm, grid.pitch_nm)
    angles, blur = 2 * np.pi * np.outer(f, along), np.sinc(f * size)[:, None]
    even, odd = np.cos(angles) * blur, np.sin(angles) * blur
    radius = np.hypot(f[:, None], f) * ppd
    rows, columns = np.nonzero(radius <= _HIGHEST_CPD)
    slow = (radius <= SLOW_CPD)[rows, columns]
    grain = grain_worth * slow[:, None, None] * LUMINANCE
    # All four quarters of the spectrum count; the first frequency is half a step.
    matrix = 2 * (2 * f[0]) * np.concatenate([_matrices(f, ppd)[rows, columns], grain], axis=1)
    found = []
    # Waves of unlike symmetry share no power.
    for y, x in ((even, even), (odd, odd), (odd, even), (even, odd)):
        off = y[rows][:, :, None] * x[columns][:, None, :]
        if y is even and x is even:
            # Less their mean over all orientations, which the others lack.
            off = (off - off.swapaxes(1, 2)) / 2
        found.append(_principal(matrix, off.reshape(len(rows), -1)))
    most = max(power[-1] for power, _ in found)
    few = np.concatenate([lights[..., power > _NEGLIGIBLE * most] for power, lights in found], axis=-1)
    return frozen(few.reshape(3, grid.cells, grid.cells, few.shape[-1]))


def _principal(matrix: Floats, waves: Floats) -> tuple[Floats, Floats]:
    """Powers [terms], rising, and lights [3, cells, terms] whose inner products are those of all that is seen."""
    count = matrix.shape[1]
    if matrix.size < 9 * waves.shape[1]:
        each = matrix.reshape(-1, 3)
        power, directions = np.linalg.eigh(each @ each.T * np.kron(waves @ waves.T, np.ones((count, count))))
        return power, waves.T @ np.einsum("wsc,wst->cwt", matrix, directions.reshape(-1, count, len(power)))
    parts = np.einsum("wsc,wn->cnws", matrix, waves).reshape(3 * waves.shape[1], -1)
    power, directions = np.linalg.eigh(parts @ parts.T)
    return power, (directions * np.sqrt(np.maximum(power, 0))).reshape(3, -1, len(power))


def _frequencies(count: int, ppd: float) -> Floats:
    """So many to either side of 0, cycles per pixel, symmetric so that turning maps them on themselves."""
    return np.asarray((np.arange(-count, count) + 0.5) * (_HIGHEST_CPD / ppd / count), dtype=np.float64)


def _transform(emitters: Emitters, pitch_nm: int, f: Floats) -> Complexes:
    """[3, y, x] transform of red, green and blue of mean 1 at frequencies f, in cycles per pixel, along both axes."""
    along, size = _places(len(emitters.labels), emitters.cell_nm, pitch_nm)
    waves = np.exp(-2j * np.pi * np.outer(f, along)) * np.sinc(f * size)[:, None]
    lit: list[Labels] = [emitters.labels == colour for colour in range(1, 1 + len(COLOURS))]
    return np.stack([waves @ cells @ waves.T / max(1, int(cells.sum())) for cells in lit])


def _places(cells: int, cell_nm: int, pitch_nm: int) -> tuple[Floats, float]:
    """Middles of cells from the pixel's centre, and their side, in pixels."""
    return (np.arange(cells) + 0.5 - cells / 2) * cell_nm / pitch_nm, cell_nm / pitch_nm


def _matrices(f: Floats, ppd: float) -> Floats:
    """[y, x, 3, 3]: L*a*b* of red, green and blue of small waves on an even field."""
    passed = gains(np.hypot(f[:, None], f) * ppd)
    step = 1e-5
    ends = [lab_of_linear_srgb(EVEN_LEVEL * (1 + sign * step * np.eye(3))) for sign in (1, -1)]
    slope = (ends[0] - ends[1]).T / (2 * step)
    return np.asarray(np.einsum("ij,jyx,jk->yxik", slope @ np.linalg.inv(OPPONENT_OF_RGB), passed, OPPONENT_OF_RGB))


def _lab(sent: Complexes, f: Floats, ppd: float) -> Complexes:
    """[..., 3, y, x] L*a*b* of waves of red, green and blue."""
    return np.asarray(np.einsum("yxij,...jyx->...iyx", _matrices(f, ppd), sent))


def _of_lattice(pixels: list[Emitters], shares: Floats, pitch_nm: int, ppd: float) -> Floats:
    """[3, 3] covariance of L*a*b* by the mean pixel, which repeats."""
    most = math.floor(_HIGHEST_CPD * 1.5 / ppd)
    if most < 1:
        return np.zeros((3, 3))
    f = np.arange(-min(most, _MOST_STEPS), min(most, _MOST_STEPS) + 1, dtype=np.float64)
    mean = sum(share * _transform(pixel, pitch_nm, f) for share, pixel in zip(shares, pixels, strict=True))
    seen = _lab(np.asarray(mean), f, ppd)
    seen[:, len(f) // 2, len(f) // 2] = 0
    return np.asarray(np.einsum("ayx,byx->ab", seen, seen.conj()).real)


def _mean_length(variances: Floats) -> float:
    w = np.maximum(variances, 0.0)
    if not w.max() > 0:
        return 0.0
    # u = tan(t) / sqrt(2 w) brings 0 to infinity to 0 to a right angle, of which the integrand is smooth.
    nodes, weights = gauss_legendre(_NODES)
    t = (nodes + 1) * math.pi / 4
    u = np.tan(t)
    lost = 1 - np.prod((1 + u[:, None] ** 2 * (w / w.max())) ** -0.5, axis=1)
    value = float((weights * lost / np.sin(t) ** 2).sum()) * math.pi / 4
    return value * math.sqrt(2 * float(w.max()) / math.pi)
