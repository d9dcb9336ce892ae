"""Slanted edges rendered exactly, by another path than the one that measures them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from maskfab.base.model import Psf

Floats = NDArray[np.float64]


def blurred_edge(sigma_px: float) -> Callable[[Floats], Floats]:
    """The second integral of a Gaussian blur's edge spread: of it a pixel's mean is a difference."""

    def second(x: Floats) -> Floats:
        t = x / sigma_px
        normal = np.exp(-(t**2) / 2) / np.sqrt(2 * np.pi)
        return sigma_px**2 * ((t**2 + 1) * ndtr(t) + t * normal) / 2

    return second


def rendered(
    rows: int, columns: int, normal_deg: float, second: Callable[[Floats], Floats], *, at: float = 0.0, bow: float = 0.0
) -> Floats:
    """An edge from 0 to 1 along a direction (x right, y up) through the middle, as means over pixels, [rows, columns].

    A pixel's shadow along the normal is two boxes convolved, so its mean is a second difference of the edge spread's
    second integral. ``bow`` shifts the edge by so many pixels at its ends.
    """
    angle = np.radians(normal_deg)
    across, up = np.cos(angle), np.sin(angle)
    row, column = np.mgrid[:rows, :columns].astype(float)
    x, y = column - (columns - 1) / 2, (rows - 1) / 2 - row
    along = (y * across - x * up) / (max(rows, columns) / 2)
    distance = x * across + y * up - at - bow * along**2
    a, b = abs(across) / 2, abs(up) / 2
    return box_mean(second, distance, a, b)


def box_mean(second: Callable[[Floats], Floats], x: Floats, a: float, b: float) -> Floats:
    """Mean over two boxes convolved, of half widths a and b, of what ``second`` is the second integral of."""
    return (second(x + a + b) - second(x + a - b) - second(x - a + b) + second(x - a - b)) / (4 * a * b)


def windowed_mtf(
    frequency: Floats, normal_deg: float, second: Callable[[Floats], Floats], half_px: float, flat: float
) -> Floats:
    """The presampled MTF of the line spread within a window: 1 up to ``flat`` of its reach, then a cosine's square."""
    angle = np.radians(normal_deg)
    fine = 1 / 64
    x = fine * np.arange(-round(half_px / fine), round(half_px / fine) + 1)
    line = np.diff(box_mean(second, x, abs(np.cos(angle)) / 2, abs(np.sin(angle)) / 2))
    middle = x[:-1] + fine / 2
    beyond = np.clip((abs(middle) / half_px - flat) / (1 - flat), 0, 1)
    found = np.exp(-2j * np.pi * frequency[:, None] * middle) @ (line * (1 + np.cos(np.pi * beyond)) / 2)
    return abs(found / found[0]) / np.sinc(frequency * fine)


def true_mtf(frequency: Floats, normal_deg: float, optics: Callable[[Floats], Floats]) -> Floats:
    """Presampled: of the optics at frequencies along the normal, times the square pixel's."""
    angle = np.radians(normal_deg)
    return abs(optics(frequency)) * abs(np.sinc(frequency * np.cos(angle)) * np.sinc(frequency * np.sin(angle)))


def gaussian(sigma_px: float) -> Callable[[Floats], Floats]:
    """The transfer function of a Gaussian blur."""
    return lambda frequency: np.exp(-2 * (np.pi * sigma_px * frequency) ** 2)


def noisy(light: Floats, seed: int, decibels: float = 40.0) -> Floats:
    """Photographs whose white has that signal-to-noise ratio, by photons; black is a tenth of it."""
    electrons = 10 ** (decibels / 10)
    return np.random.default_rng(seed).poisson(electrons * (0.1 + 0.9 * light)) / electrons


def second_integral(psf: Psf, pixel_um: float, normal_deg: float) -> Callable[[Floats], Floats]:
    """As :func:`blurred_edge`, of a PSF that is known at points: each is a sharp edge of its own weight."""
    half = psf.values.shape[0] // 2
    place = psf.step_um / pixel_um * np.arange(-half, half + 1)
    angle = np.radians(normal_deg)
    along = (place[None, :] * np.cos(angle) + place[:, None] * np.sin(angle)).ravel()
    fine = 1 / 32
    reach = int(np.ceil(abs(along).max() / fine)) + 1
    # Split between the two nearest places, a point keeps its weight and its mean.
    below = np.floor(along / fine).astype(int)
    share = along / fine - below
    weight = psf.values.ravel() / psf.values.sum()
    line = sum(np.bincount(below + reach + k, weight * part, 2 * reach + 2) for k, part in ((0, 1 - share), (1, share)))
    spread = np.cumsum(line)
    first = fine * np.concatenate([[0.0], np.cumsum(spread)[:-1]])
    second = np.concatenate([[0.0], np.cumsum(fine * first + fine**2 / 2 * spread)[:-1]])

    def integral(x: Floats) -> Floats:
        k = np.clip(np.floor(x / fine).astype(int) + reach, 0, line.size - 1)
        within = np.maximum(x - fine * (k - reach), 0)
        return second[k] + first[k] * within + spread[k] * within**2 / 2

    return integral
