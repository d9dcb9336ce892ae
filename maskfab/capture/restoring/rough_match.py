r"""Where one picture lies in another, roughly: every turn and scale of a grid, every shift by a transform.

For each turn and scale the correlation of two high-passed pictures a and b over where both are valid,

    ρ(t) = Σ a(x) b(x + t) / sqrt(Σ a²(x) m_b(x + t) · Σ m_a(x) b²(x + t)),

is four sums that transforms give for all shifts t at once (D. Padfield, IEEE Trans. Image Process. 21, 2706, 2012).
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy import ndimage

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

    Attributes:
        u, v: of the turn and the scale.
        shift_x, shift_y: of the middle, in pixels.
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
        """Of the same pictures with so many times as many pixels along a side."""
        return Similarity(self.u, self.v, self.shift_x * times, self.shift_y * times)

    def taken(
        self, second: NDArray[np.float32], shape: tuple[int, int], *, order: int, fill: float = 0.0
    ) -> NDArray[np.float32]:
        """The second picture [rows, columns] at the places of the first one's pixels, by splines of an order."""
        matrix = np.array([[1 + self.u, -self.v], [self.v, 1 + self.u]])
        middle = (np.array(shape) - 1) / 2
        there = (np.array(second.shape) - 1) / 2 + (self.shift_y, self.shift_x)
        mode, cval = ("constant", fill) if order < 2 else ("mirror", 0.0)
        return np.asarray(
            ndimage.affine_transform(
                second, matrix, there - matrix @ middle, shape, order=order, mode=mode, cval=cval, output=np.float32
            )
        )


def rough_match(
    first: NDArray[np.float32],
    first_valid: NDArray[np.bool_],
    second: NDArray[np.float32],
    second_valid: NDArray[np.bool_],
) -> Similarity:
    """The turn, scale and shift of the best correlation.

    Args:
        first, second: high-passed pictures of one scale, some 100 pixels along a side.
        first_valid, second_valid: of their pixels, those that count.
    """
    size = tuple(scipy.fft.next_fast_len(a + b, real=True) for a, b in zip(first.shape, second.shape, strict=True))

    def spectra(picture: NDArray[np.float32], valid: NDArray[np.bool_]) -> list[NDArray[np.complex64]]:
        shown = np.where(valid, picture, np.float32(0))
        parts = (shown, np.square(shown), valid.astype(np.float32))
        return [np.asarray(scipy.fft.rfft2(part, size, workers=1)) for part in parts]

    light, power, there = (each.conj() for each in spectra(first, first_valid))
    fewest = _LEAST_SHARED * first_valid.sum()
    best, found = -1.0, Similarity()
    turns = np.arange(-MOST_TURN_DEG, MOST_TURN_DEG + _TURN_STEP_DEG / 2, _TURN_STEP_DEG)
    scales = np.arange(1 - MOST_SCALE, 1 + MOST_SCALE + _SCALE_STEP / 2, _SCALE_STEP)
    # On a grid of the first one's size a second picture that is smaller, or shifted, keeps what is in it.
    for turn, scale in itertools.product(np.deg2rad(turns), scales):
        tried = Similarity(scale * math.cos(turn) - 1, scale * math.sin(turn))
        seen = tried.taken(second, second.shape, order=1)
        valid = tried.taken(second_valid.astype(np.float32), second.shape, order=1) > 0.99
        other = spectra(seen, valid)

        def inverse(spectrum: NDArray[np.complex64]) -> NDArray[np.float32]:
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
            found = Similarity(
                tried.u,
                tried.v,
                (1 + tried.u) * x + tried.v * y,
                (1 + tried.u) * y - tried.v * x,
            )
    return found
