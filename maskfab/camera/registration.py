"""Shift, turn and scale between two photographs of one scene, so that the dies that they were taken through compare.

Roughly, every turn and scale of a grid is tried, and every shift by a transform: the correlation of two high-passed
pictures a and b over where both are valid,

    ρ(t) = Σ a(x) b(x + t) / sqrt(Σ a²(x) m_b(x + t) · Σ m_a(x) b²(x + t)),

is four sums that transforms give for all shifts t at once (D. Padfield, IEEE Trans. Image Process. 21, 2706, 2012).
Then both are brought into one band, Gaussians of σ less those of 6 σ, which keeps what is even and what is finest out
of the fit: dies differ in both. With g and o of each colour,

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

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import ndimage

from maskfab.base.arrays import Floats, Mask, Singles
from maskfab.base.errors import SourceError
from maskfab.camera.scores import NORMAL_95

MOST_TURN_DEG, MOST_SCALE = 10.0, 0.1
_TURN_STEP_DEG, _SCALE_STEP = 1.0, 0.02
"""At the corner of a picture of 100 pixels an error of half of them is less than one pixel."""
_LEAST_SHARED = 0.3
"""Of the first picture, so that a match of two corners does not win by chance."""


@dataclass(frozen=True)
class Similarity:
    """A point of the first picture at (x, y) from its middle, y downwards, lies in the second, from its middle, at

        x' = x + u x + v y + shift_x,        y' = y + u y - v x + shift_y,

    turned counter-clockwise by atan2(v, 1 + u) and larger by sqrt((1 + u)² + v²).
    """

    u: float = 0.0
    v: float = 0.0
    shift_x: float = 0.0
    shift_y: float = 0.0

    @property
    def scale(self) -> float:
        return math.hypot(1 + self.u, self.v)

    @property
    def turn_deg(self) -> float:
        return math.degrees(math.atan2(self.v, 1 + self.u))

    def grown(self, times: float) -> Similarity:
        """The similarity of the same pictures with so many times as many pixels along a side."""
        return Similarity(self.u, self.v, self.shift_x * times, self.shift_y * times)

    def taken(self, second: Singles, shape: tuple[int, int], *, order: int) -> Singles:
        """The second picture [rows, columns] at the places of the first one's pixels, by splines of an order."""
        matrix = np.array([[1 + self.u, -self.v], [self.v, 1 + self.u]])
        middle = (np.array(shape) - 1) / 2
        there = (np.array(second.shape) - 1) / 2 + (self.shift_y, self.shift_x)
        offset, mode = there - matrix @ middle, "constant" if order < 2 else "mirror"
        seen = ndimage.affine_transform(second, matrix, offset, shape, np.float32, order=order, mode=mode)
        return np.asarray(seen)


def rough_match(first: Singles, first_valid: Mask, second: Singles, second_valid: Mask) -> Similarity:
    """The turn, scale and shift of the best correlation of high-passed pictures of one scale, some 100 px a side."""
    size = tuple(scipy.fft.next_fast_len(a + b, real=True) for a, b in zip(first.shape, second.shape, strict=True))

    def spectra(picture: Singles, valid: Mask) -> list[NDArray[np.complex64]]:
        shown = np.where(valid, picture, np.float32(0))
        parts = (shown, np.square(shown), valid.astype(np.float32))
        return [np.asarray(scipy.fft.rfft2(part, size, workers=1)) for part in parts]

    light, power, there = (each.conj() for each in spectra(first, first_valid))
    fewest = _LEAST_SHARED * first_valid.sum()
    best, match = -1.0, Similarity()
    turns = np.arange(-MOST_TURN_DEG, MOST_TURN_DEG + _TURN_STEP_DEG / 2, _TURN_STEP_DEG)
    scales = np.arange(1 - MOST_SCALE, 1 + MOST_SCALE + _SCALE_STEP / 2, _SCALE_STEP)
    # On a grid of the first one's size a second picture that is smaller, or shifted, keeps what is in it.
    for turn, scale in itertools.product(np.deg2rad(turns), scales):
        tried = Similarity(scale * math.cos(turn) - 1, scale * math.sin(turn))
        seen = tried.taken(second, second.shape, order=1)
        valid = tried.taken(second_valid.astype(np.float32), second.shape, order=1) > 0.99
        other = spectra(seen, valid)

        def inverse(spectrum: NDArray[np.complex64]) -> Singles:
            return np.asarray(scipy.fft.irfft2(spectrum, size, workers=1))

        shared = inverse(there * other[2])
        below = np.maximum(inverse(power * other[2]), 0) * np.maximum(inverse(there * other[1]), 0)
        counted = shared >= fewest
        level = np.where(counted, inverse(light * other[0]) / np.sqrt(np.where(counted, below, 1) + 1e-30), -1)
        row, column = np.unravel_index(int(level.argmax()), level.shape)
        if level[row, column] > best:
            best = float(level[row, column])
            lag = [
                float(at if at < side else at - whole)
                for at, side, whole in zip((row, column), second.shape, size, strict=True)
            ]
            # Pixels are counted from corners, and the similarity from middles.
            apart = [(one - two) / 2 for one, two in zip(first.shape, second.shape, strict=True)]
            y, x = (moved + off for moved, off in zip(lag, apart, strict=True))
            shift = (1 + tried.u) * x + tried.v * y, (1 + tried.u) * y - tried.v * x
            match = Similarity(tried.u, tried.v, *shift)
    return match


_SIGMA, _WIDER = 1.0, 6.0
"""Of the band: pixels, and the background's in these."""
_EDGE = 2.0
"""Of the background's sigma, what is cut off at edges."""
_ROUGH, _LARGEST = 64, 1536
"""Pixels along the longer side where the search begins, and at most where it ends."""
_STEPS, _STILL = 12, 1e-3
_TILES = 12
"""Along a side, for the errors."""
_LEAST_SHARED_AREA, _LEAST_ALIKE = 0.25, 0.4


@dataclass(frozen=True)
class Registration:
    """Place of a second photograph of a scene against the first.

    Attributes:
        shift_error_px: half the 95 % interval of the shift to the right and of that downwards.
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
    first_valid: Mask
    second: Singles
    second_valid: Mask


def registered(first: Singles, first_full: Mask, second: Singles, second_full: Mask, name: str = "") -> Registration:
    """The place of the second picture against the first.

    Args:
        first, second: linear light, [3, rows, columns], of 128 pixels or more along a side.
        first_full, second_full: [rows, columns], pixels that were full, which are left out with what is near them.

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
    for stride in strides[::-1]:
        if longest / stride > _LARGEST and stride != strides[-1]:
            break
        level = _level(first, first_full, second, second_full, stride)
        where, covariance, correlation, shared = _refined(level, where, name)
    if correlation < _LEAST_ALIKE or not (
        abs(where.turn_deg) < MOST_TURN_DEG + 1 and abs(where.scale - 1) < MOST_SCALE + 0.02
    ):
        raise _unlike(name, f"correlate by {correlation:.2f} where they match best; the limit is {_LEAST_ALIKE}")
    scale = where.scale
    by_scale = np.array([(1 + where.u) / scale, where.v / scale, 0, 0])
    by_turn = np.array([-where.v, 1 + where.u, 0, 0]) / scale**2
    turned, scaled = (NORMAL_95 * math.sqrt(float(by @ covariance @ by)) for by in (by_turn, by_scale))
    half = NORMAL_95 * np.sqrt(np.diag(covariance))
    shift = float(half[2]), float(half[3])
    return Registration(where, shift, math.degrees(turned), scaled, correlation, shared)


def _level(first: Singles, first_full: Mask, second: Singles, second_full: Mask, stride: int) -> _Level:
    def coarser(picture: Singles, full: Mask) -> tuple[Singles, Mask]:
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
    """Band between two Gaussians along the last two axes, of pixels so many times as fine as the first picture's."""
    fine = np.empty_like(picture)
    planes, bands = (stack.reshape(-1, *picture.shape[-2:]) for stack in (picture, fine))
    for plane, band in zip(planes, bands, strict=True):
        low = ndimage.gaussian_filter(plane, _SIGMA * scale, mode="nearest")
        band[:] = low - ndimage.gaussian_filter(plane, _WIDER * _SIGMA * scale, mode="nearest")
    return fine


def _refined(level: _Level, start: Similarity, name: str) -> tuple[Similarity, Floats, float, float]:
    """The similarity of the best fit, its covariance, correlation and shared part."""
    # A coarser picture's pixels are means: its middle is that of the pixels it holds.
    where = start.grown(1 / level.stride)
    first = _band(level.first, 1.0)
    second = _band(level.second, start.scale)
    for _ in range(_STEPS):
        change, *_ = _solved(level, first, second, where, name)
        u, v, x, y = map(float, change)
        where = Similarity(where.u + u, where.v + v, where.shift_x + x, where.shift_y + y)
        reach = math.hypot(*first.shape[1:]) / 2
        if max(math.hypot(u, v) * reach, math.hypot(x, y)) < _STILL:
            break
    _, covariance, correlation, shared = _solved(level, first, second, where, name)
    unit = np.diag([1.0, 1.0, level.stride, level.stride])
    return where.grown(level.stride), unit @ covariance @ unit, correlation, shared


def _solved(
    level: _Level, first: Singles, second: Singles, where: Similarity, name: str
) -> tuple[Floats, Floats, float, float]:
    """A step of least squares, its covariance, and how both correlate and what share of the first both show there."""
    shape = (first.shape[1], first.shape[2])
    seen = where.taken(level.second_valid.astype(np.float32), shape, order=1) > 0.99
    valid = seen & level.first_valid
    shared = float(valid.mean())
    if shared < _LEAST_SHARED_AREA:
        raise _unlike(name, f"share {100 * shared:.0f} % of the first; the limit is {100 * _LEAST_SHARED_AREA:.0f} %")
    y, x = (np.arange(side, dtype=np.float32) - (side - 1) / 2 for side in shape)
    unknowns = 4
    row, column = (np.arange(side) * _TILES // side for side in shape)
    tiles = row[:, None] * _TILES + column
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
        by_scale, by_turn = in_x * x + in_y * y[:, None], in_x * y[:, None] - in_y * x
        slopes = np.stack([slope[valid] for slope in (by_scale, by_turn, in_x, in_y)]).astype(np.float64)
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
    return -inverse @ pull, covariance, float(alike.mean()), shared


def _unlike(name: str, why: str) -> SourceError:
    cure = (
        "Take both of one scene from one place, turned by less than 10 degrees and a tenth larger at most, "
        "or restore each by itself"
    )
    return SourceError("MF354", f"the first photograph and {name or 'another'} {why}", where=name, cure=cure)


_ORDER = 5
"""Of the splines: of a wave of 0.3 cycles per pixel they keep 0.99, of 0.4 they keep 0.92."""
_REACH = 4
"""Pixels from a full one, or from an edge, that it touches."""


@dataclass(frozen=True, eq=False)
class RegisteredPhoto:
    """A picture brought onto another.

    Attributes:
        picture: float32 [3, rows, columns] of the other's shape, within 0 to 1; 0 beyond its own edges.
        gain, offset: of each colour, by which the other's light becomes this one's in the mean.
        difference: root of the mean squared difference that they leave, over pixels that both show and that are full in
            neither, by the gain in light of the other, whose white is 1.
    """

    name: str
    onto: str
    registration: Registration
    picture: Singles
    gain: tuple[float, ...]
    offset: tuple[float, ...]
    difference: float

    def to_dict(self) -> dict[str, Any]:
        """Everything but the picture."""
        return {
            "name": self.name,
            "onto": self.onto,
            **self.registration.to_dict(),
            "gain": list(self.gain),
            "offset": list(self.offset),
            "rms_difference": self.difference,
        }

    def __str__(self) -> str:
        return (
            f"{self.name} against {self.onto}: {self.registration}; {self.difference:.4f} of white root mean square "
            f"difference after gain and offset"
        )


def brought(
    names: tuple[str, str], first: Singles, first_full: Mask, second: Singles, second_full: Mask
) -> RegisteredPhoto:
    """The second picture, resampled once, at the places of the first one's pixels.

    Args:
        first, second: linear light within 0 to 1, [3, rows, columns].
        first_full, second_full: [rows, columns], pixels that were full.
    """
    registration = registered(first, first_full, second, second_full, names[1])
    where, shape = registration.where, (first.shape[1], first.shape[2])
    taken = np.stack([where.taken(plane, shape, order=_ORDER) for plane in second])
    inner = np.zeros(second.shape[1:], dtype=np.float32)
    inner[_REACH:-_REACH, _REACH:-_REACH] = 1
    counted = where.taken(np.where(second_full, np.float32(0), inner), shape, order=1) > 0.99
    counted &= ~first_full
    gains, offsets, squares = [], [], 0.0
    for one, two in zip(first, taken, strict=True):
        a, b = one[counted].astype(np.float64), two[counted].astype(np.float64)
        gain = float(np.cov(a, b)[0, 1] / a.var(ddof=1))
        gains.append(gain)
        offsets.append(float(b.mean() - gain * a.mean()))
        squares += float(np.square((b - offsets[-1]) / gain - a).mean()) / len(first)
    there = where.taken(np.ones(second.shape[1:], dtype=np.float32), shape, order=1) > 0.5
    picture = np.where(there, np.clip(taken, 0, 1), np.float32(0))
    return RegisteredPhoto(names[1], names[0], registration, picture, tuple(gains), tuple(offsets), squares**0.5)
