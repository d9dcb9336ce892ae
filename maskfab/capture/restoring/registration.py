r"""Shift, turn and scale between two photographs of one scene, so that the dies that they were taken through compare.

Both are brought into one band, Gaussians of σ less those of 6 σ, which keeps what is even and what is finest out of the
fit: dies differ in both. With g and o of each colour,

    b(x'(x)) = g a(x) + o,

is solved for the four numbers of x' by least squares, Gauss-Newton steps from coarse pixels to fine
(B. Lucas, T. Kanade, Proc. IJCAI, 674, 1981), b resampled by cubic splines.

Notes:
    What is left of two restored pictures is correlated over many pixels. Standard errors are therefore those of sums
    over tiles, whatever is correlated within one (K.-Y. Liang, S. Zeger, Biometrika 73, 13, 1986). A bend of the field
    that no similarity follows, as of two distortions, is in them only as far as it differs from tile to tile.
    Blur that is the same turned by 180 degrees moves nothing, however different of the two.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from maskfab.base.arrays import Floats, Singles
from maskfab.capture.restoring.rough_match import MOST_SCALE, MOST_TURN_DEG, Similarity, rough_match
from maskfab.errors import SourceError

Flags = NDArray[np.bool_]

_SIGMA, _WIDER = 1.0, 6.0
"""Of the band: pixels, and the background's in these."""
_EDGE = 2.0
"""Of the background's sigma, what is cut off at edges."""
_ROUGH, _LARGEST = 64, 1536
"""Pixels along the longer side where the search begins, and at most where it ends."""
_STEPS, _STILL = 12, 1e-3
_TILES = 12
"""Along a side, for the errors."""
_LEAST_SHARED, _LEAST_ALIKE = 0.25, 0.4
_NORMAL_95 = 1.959964


@dataclass(frozen=True)
class Registration:
    """Place of a second photograph of a scene against the first.

    Attributes:
        where: the similarity.
        shift_error_px: half the 95 % interval of the shift to the right and of that downwards.
        turn_error_deg, scale_error: likewise.
        correlation: of both in the band of the fit.
        shared: share of the first picture's pixels that both show.
    """

    where: Similarity
    shift_error_px: tuple[float, float]
    turn_error_deg: float
    scale_error: float
    correlation: float
    shared: float

    def to_dict(self) -> dict[str, Any]:
        """With a unit in each name."""
        where = self.where
        return {
            "shift_right_px": where.shift_x,
            "shift_right_px_half95": self.shift_error_px[0],
            "shift_down_px": where.shift_y,
            "shift_down_px_half95": self.shift_error_px[1],
            "turn_deg": where.turn_deg,
            "turn_deg_half95": self.turn_error_deg,
            "scale": where.scale,
            "scale_half95": self.scale_error,
            "correlation": self.correlation,
            "shared": self.shared,
        }

    def __str__(self) -> str:
        where, (right, down) = self.where, self.shift_error_px
        return (
            f"shifted {where.shift_x:.3f} ± {right:.3f} px to the right and {where.shift_y:.3f} ± {down:.3f} px down, "
            f"turned {where.turn_deg:.4f} ± {self.turn_error_deg:.4f} deg counter-clockwise, {where.scale:.6f} ± "
            f"{self.scale_error:.6f} times as large; correlation {self.correlation:.3f}, "
            f"{100 * self.shared:.0f} % shared"
        )


@dataclass(frozen=True, eq=False)
class _Level:
    """Both pictures at a number of pixels: [3, rows, columns], and where they count [rows, columns]."""

    stride: int
    first: Singles
    first_valid: Flags
    second: Singles
    second_valid: Flags


@dataclass(frozen=True, eq=False)
class _Solved:
    """A step of least squares, and what is left after it."""

    change: Floats
    covariance: Floats
    correlation: float
    shared: float


def registered(first: Singles, first_full: Flags, second: Singles, second_full: Flags, name: str = "") -> Registration:
    """The place of the second picture against the first.

    Args:
        first, second: linear light, [3, rows, columns], of 128 pixels or more along a side.
        first_full, second_full: [rows, columns], pixels that were full, which are left out with what is near them.
        name: of the second, for errors.

    Raises:
        SourceError: MF354 if they do not show one scene, up to a turn of 10 degrees and a tenth in scale, over a
            quarter of the first.
    """
    longest = max(*first.shape[1:], *second.shape[1:])
    strides = [2**k for k in range(12) if longest // 2**k >= _ROUGH or k == 0]
    coarsest = _level(first, first_full, second, second_full, strides[-1])
    where = rough_match(
        _band(coarsest.first.mean(axis=0), 1.0),
        coarsest.first_valid,
        _band(coarsest.second.mean(axis=0), 1.0),
        coarsest.second_valid,
    )
    where = where.grown(strides[-1])
    solved = None
    for stride in strides[::-1]:
        if longest / stride > _LARGEST and solved is not None:
            break
        level = _level(first, first_full, second, second_full, stride)
        where, solved = _refined(level, where, name)
    assert solved is not None
    if solved.correlation < _LEAST_ALIKE or not (
        abs(where.turn_deg) < MOST_TURN_DEG + 1 and abs(where.scale - 1) < MOST_SCALE + 0.02
    ):
        raise _unlike(name, f"correlate by {solved.correlation:.2f} where they match best; the limit is {_LEAST_ALIKE}")
    turned, scaled = _errors(where, solved.covariance)
    half = _NORMAL_95 * np.sqrt(np.diag(solved.covariance))
    return Registration(
        where,
        (float(half[2]), float(half[3])),
        turned,
        scaled,
        solved.correlation,
        solved.shared,
    )


def _level(first: Singles, first_full: Flags, second: Singles, second_full: Flags, stride: int) -> _Level:
    def coarser(picture: Singles, full: Flags) -> tuple[Singles, Flags]:
        near = ndimage.binary_dilation(full, iterations=max(2, round(2 * _SIGMA * stride))) if full.any() else full
        rows, columns = (side // stride * stride for side in picture.shape[1:])
        cells = picture[:, :rows, :columns].reshape(3, rows // stride, stride, columns // stride, stride)
        held = near[:rows, :columns].reshape(rows // stride, stride, columns // stride, stride).any(axis=(1, 3))
        valid = np.array(~held)
        # Near an edge the band knows nothing of the background beyond.
        edge = min(round(_EDGE * _WIDER * _SIGMA), min(valid.shape) // 12)
        for cut in (slice(0, edge), slice(-edge, None)):
            valid[cut], valid[:, cut] = False, False
        return cells.mean(axis=(2, 4), dtype=np.float32), valid

    return _Level(stride, *coarser(first, first_full), *coarser(second, second_full))


def _band(picture: Singles, scale: float) -> Singles:
    """Of the last two axes, what is between two Gaussians, of pixels so many times as fine as the first picture's."""
    fine = np.empty_like(picture)
    planes, bands = (each.reshape(-1, *picture.shape[-2:]) for each in (picture, fine))
    for plane, band in zip(planes, bands, strict=True):
        low = ndimage.gaussian_filter(plane, _SIGMA * scale, mode="nearest")
        band[:] = low - ndimage.gaussian_filter(plane, _WIDER * _SIGMA * scale, mode="nearest")
    return fine


def _refined(level: _Level, start: Similarity, name: str) -> tuple[Similarity, _Solved]:
    # A coarser picture's pixels are means: its middle is that of the pixels it holds.
    where = start.grown(1 / level.stride)
    first = _band(level.first, 1.0)
    second = _band(level.second, start.scale)
    for _ in range(_STEPS):
        solved = _solved(level, first, second, where, name)
        u, v, x, y = (float(each) for each in solved.change)
        where = Similarity(where.u + u, where.v + v, where.shift_x + x, where.shift_y + y)
        reach = math.hypot(*first.shape[1:]) / 2
        if max(math.hypot(u, v) * reach, math.hypot(x, y)) < _STILL:
            break
    solved = _solved(level, first, second, where, name)
    unit = np.diag([1.0, 1.0, level.stride, level.stride])
    return where.grown(level.stride), replace(solved, covariance=unit @ solved.covariance @ unit)


def _solved(level: _Level, first: Singles, second: Singles, where: Similarity, name: str) -> _Solved:
    shape = (first.shape[1], first.shape[2])
    seen = where.taken(level.second_valid.astype(np.float32), shape, order=1) > 0.99
    valid = seen & level.first_valid
    shared = float(valid.mean())
    if shared < _LEAST_SHARED:
        raise _unlike(name, f"share {100 * shared:.0f} % of the first; the limit is {100 * _LEAST_SHARED:.0f} %")
    y, x = (np.arange(side, dtype=np.float32) - (side - 1) / 2 for side in shape)
    unknowns, tiles = 4, _tiles(shape)
    normal, pull = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
    pulls = np.zeros((_TILES**2, unknowns))
    alike = np.zeros(3)
    cos, sin = (1 + where.u) / where.scale**2, where.v / where.scale**2
    for colour in range(3):
        taken = where.taken(second[colour], shape, order=3)
        a, b = first[colour][valid].astype(np.float64), taken[valid].astype(np.float64)
        one, two = a - a.mean(), b - b.mean()
        size = math.sqrt(float(one @ one) * float(two @ two))
        if size == 0:
            raise _unlike(name, "show no detail in a colour")
        gain, alike[colour] = float(one @ two / (one @ one)), one @ two / size
        down, right = (np.gradient(taken, axis=axis) for axis in (0, 1))
        # Slopes along the second picture's own axes.
        in_x, in_y = cos * right + sin * down, cos * down - sin * right
        slopes = np.stack(
            [
                (in_x * x + in_y * y[:, None])[valid],
                (in_x * y[:, None] - in_y * x)[valid],
                in_x[valid],
                in_y[valid],
            ]
        ).astype(np.float64)
        # Gain and offset are solved for with the rest, of which the slopes keep what these do not explain.
        slopes -= slopes.mean(axis=1, keepdims=True)
        slopes -= np.outer(slopes @ one / (one @ one), one)
        left = two - gain * one
        weight = valid.sum() / max(float(left @ left), 1e-30)
        normal += weight * slopes @ slopes.T
        pull += weight * slopes @ left
        for k in range(unknowns):
            pulls[:, k] += weight * np.bincount(tiles[valid], slopes[k] * left, _TILES**2)
    inverse = np.linalg.inv(normal)
    held = np.unique(tiles[valid]).size
    covariance = inverse @ (pulls.T @ pulls) @ inverse * (held / max(held - unknowns, 1))
    return _Solved(-inverse @ pull, covariance, float(alike.mean()), shared)


def _tiles(shape: tuple[int, int]) -> NDArray[np.intp]:
    row, column = (np.arange(side) * _TILES // side for side in shape)
    return np.asarray(row[:, None] * _TILES + column)


def _errors(where: Similarity, covariance: Floats) -> tuple[float, float]:
    """Halves of the 95 % intervals of turn, in degrees, and scale."""
    scale = where.scale
    along = np.array([(1 + where.u) / scale, where.v / scale, 0, 0])
    across = np.array([-where.v, 1 + where.u, 0, 0]) / scale**2
    turned, scaled = (_NORMAL_95 * math.sqrt(float(each @ covariance @ each)) for each in (across, along))
    return math.degrees(turned), scaled


def _unlike(name: str, why: str) -> SourceError:
    return SourceError(
        "MF354",
        f"the first photograph and {name or 'another'} {why}",
        where=name,
        cure="Take both of one scene from one place, turned by less than 10 degrees and a tenth larger at most, "
        "or restore each by itself",
    )
