"""Pictures that show what a display does: one value per pixel, linear light, [rows, columns, 3], row 0 the lowest."""

from __future__ import annotations

import numpy as np

from maskfab.base.arrays import Floats

# Strokes of a few letters on a grid of 5 x 7, the top row first.
_LETTERS = (
    ("#...#", "##.##", "#.#.#", "#.#.#", "#...#", "#...#", "#...#"),
    (".###.", "#...#", "#...#", "#####", "#...#", "#...#", "#...#"),
    (".####", "#....", "#....", ".###.", "....#", "....#", "####."),
    ("#...#", "#..#.", "#.#..", "##...", "#.#..", "#..#.", "#...#"),
)


def flat(pixels: int, level: float = 0.5) -> Floats:
    """An even grey of that linear light."""
    return np.full((pixels, pixels, 3), level)


def edge(pixels: int, dark: float = 0.0, bright: float = 1.0) -> Floats:
    """Dark on the left, bright on the right; where the picture repeats there is the opposite edge."""
    return _grey(np.broadcast_to(np.where(np.arange(pixels) < pixels // 2, dark, bright), (pixels, pixels)))


def zone_plate(pixels: int) -> Floats:
    """Rings whose frequency grows with the radius, to half a cycle per pixel at the middle of the sides."""
    axis = np.arange(pixels) - (pixels - 1) / 2
    squared = axis[:, None] ** 2 + axis**2
    return _grey(0.5 + 0.5 * np.cos(np.pi * squared / pixels))


def text(pixels: int) -> Floats:
    """Black letters five pixels wide on white, and bars of one, two and three pixels under them."""
    page = np.ones((pixels, pixels))
    for line, top in enumerate(range(2, pixels - 8, 10)):
        if line % 3 == 2:
            _bars(page[top : top + 7], pixels)
        else:
            _letters(page[top : top + 7], pixels, line)
    return _grey(page[::-1])


def leaves(pixels: int, seed: int = 1) -> Floats:
    """Discs of all sizes and muted colours that hide one another, whose statistics are those of photographs.

    Lee, Mumford and Huang, "Occlusion models for natural images" (2001): as many discs of radius r as 1 / r^3.
    """
    draw = np.random.default_rng(seed)
    scale = 4  # samples along a pixel
    side = pixels * scale
    smallest, largest = 1.0 * scale, 0.3 * side
    picture = np.zeros((side, side, 3))
    bare = np.ones((side, side), dtype=np.bool_)
    left = side * side
    for _ in range(6000):
        part = draw.random()
        radius = (smallest**-2 - part * (smallest**-2 - largest**-2)) ** -0.5
        x, y = draw.uniform(0, side, size=2)
        colour = _muted(draw)
        box = tuple(slice(max(0, int(at - radius)), int(at + radius) + 2) for at in (y, x))
        rows, columns = np.ogrid[: bare[box].shape[0], : bare[box].shape[1]]
        disc = (columns + box[1].start - x) ** 2 + (rows + box[0].start - y) ** 2 < radius**2
        new = bare[box] & disc
        picture[box][new] = colour
        bare[box] &= ~new
        left -= int(new.sum())
        if not left:
            break
    picture[bare] = 0.18
    return np.asarray(picture.reshape(pixels, scale, pixels, scale, 3).mean(axis=(1, 3)))


def _muted(draw: np.random.Generator) -> Floats:
    """A grey of any lightness with some colour to it."""
    grey = draw.uniform(0.02, 0.85)
    return np.clip(grey * (1 + 0.45 * draw.uniform(-1, 1, size=3)), 0.0, 1.0)


def _letters(strip: Floats, pixels: int, line: int) -> None:
    for place, left in enumerate(range(2, pixels - 6, 6)):
        letter = _LETTERS[(place + line) % len(_LETTERS)]
        strip[:, left : left + 5] = [[0.0 if stroke == "#" else 1.0 for stroke in row] for row in letter]


def _bars(strip: Floats, pixels: int) -> None:
    left = 2
    for width in (1, 2, 3):
        if left + 9 * width > pixels - 2:
            return
        for _ in range(5):
            strip[:, left : left + width] = 0.0
            left += 2 * width
        left += 2


def _grey(level: Floats) -> Floats:
    return np.repeat(np.asarray(level, dtype=np.float64)[:, :, None], 3, axis=2)
