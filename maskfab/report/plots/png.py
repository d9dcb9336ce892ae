"""Pictures of openings, panels and PSFs as arrays of grey or colour levels, and as small palette PNGs."""

from __future__ import annotations

import base64
import struct
import zlib

import numpy as np
from numpy.typing import NDArray

from maskfab.model import Panel, Psf

_STEPS = 10
"""Shades of a decade: more are not told apart, and a picture of fewer is smaller."""
DECADES = 6
"""Decades below the peak that every picture of a PSF shows; equal for all, so that pictures can be compared."""


def panel_coverage(panel: Panel, side_nm: int, pixels: int) -> NDArray[np.float64]:
    """Clear share of each pixel of a square view into the middle of a panel, [y, x], row 0 the lowest.

    Areas are exact: a gutter narrower than a pixel darkens it by its share and cannot vanish or beat with the grid.
    """
    rows, columns = panel.orientations.shape
    wanted = -(-side_nm // panel.pitch_nm)
    high, wide = min(rows, wanted), min(columns, wanted)
    bottom, left = (rows - high) // 2, (columns - wide) // 2
    dots = panel.opening.dots
    cells = np.zeros((high, dots + 2, wide, dots + 2))
    for row in range(high):
        for column in range(wide):
            orientation = int(panel.orientations[bottom + row, left + column])
            cells[row, 1:-1, column, 1:-1] = panel.pattern(orientation)
    clear = cells.reshape(high * (dots + 2), wide * (dots + 2))
    return _shares(panel, high, side_nm, pixels) @ clear @ _shares(panel, wide, side_nm, pixels).T


def log_intensity(psf: Psf, pixels: int, peak: float | None = None) -> NDArray[np.float64]:
    """log10 of intensity over a peak, its own if none is given, from -DECADES to 0; at most ``pixels`` samples a side.

    Notes:
        A PSF with more samples is averaged over areas, never thinned out: thinning drops whole orders. Averaging
        lowers a peak narrower than the new sample, so a reduced picture is for the eye and not for reading values.
    """
    values = psf.values
    peak = float(values.max()) if peak is None else peak
    samples = len(values)
    if samples > pixels:
        kept = pixels if pixels % 2 else pixels - 1  # odd, so that the optical axis stays in the middle of a sample
        edges = np.linspace(0.0, samples, kept + 1)
        mean = _overlap(edges, np.arange(samples + 1.0)) * (kept / samples)
        values = mean @ values @ mean.T
    if peak <= 0:
        return np.full(values.shape, -float(DECADES))
    return np.round(np.log10(np.clip(values / peak, 10.0**-DECADES, 1.0)) * _STEPS) / _STEPS


def png(levels: NDArray[np.uint8], palette: NDArray[np.uint8]) -> bytes:
    """An 8-bit palette PNG of ``levels`` [y, x], row 0 the lowest; ``palette`` is [colours, 3].

    Equal input gives equal bytes: there is no date and no name of a program in it.
    """
    return _png(levels, 3, ((b"PLTE", palette.tobytes()),))


def png_of_colours(colours: NDArray[np.uint8]) -> bytes:
    """An 8-bit colour PNG of ``colours`` [y, x, 3], row 0 the lowest; equal input gives equal bytes."""
    return _png(colours.reshape(len(colours), -1), 2, ())


def few_colours(colours: NDArray[np.uint8], most: int = 256) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """A colour picture [y, x, 3] in at most so many colours of its own: levels [y, x] and the palette [colours, 3].

    The box of colours whose sum of squares is largest is cut at its mean, across its widest channel, until there are
    enough (after Heckbert, Computer Graphics 16, 297, 1982); a third of the bytes then shows the same to the eye.
    """
    pixels = colours.reshape(-1, 3).astype(np.float64)
    boxes = [np.arange(len(pixels))]
    spread = [_spread(pixels)]
    while len(boxes) < most and max(spread)[0] > 0:
        widest = spread.index(max(spread))
        box, (_, channel) = boxes[widest], spread[widest]
        values = pixels[box, channel]
        low = values <= values.mean()
        boxes[widest], spread[widest] = box[low], _spread(pixels[box[low]])
        boxes.append(box[~low])
        spread.append(_spread(pixels[box[~low]]))
    levels = np.empty(len(pixels), dtype=np.uint8)
    for number, box in enumerate(boxes):
        levels[box] = number
    palette = np.array([pixels[box].mean(axis=0) for box in boxes]).round().astype(np.uint8)
    return levels.reshape(colours.shape[:2]), palette


def _spread(pixels: NDArray[np.float64]) -> tuple[float, int]:
    """Largest sum of squares about the mean over the channels, and that channel."""
    squares = pixels.var(axis=0) * len(pixels)
    channel = int(squares.argmax())
    return float(squares[channel]), channel


def _png(samples: NDArray[np.uint8], kind: int, before: tuple[tuple[bytes, bytes], ...]) -> bytes:
    """A PNG of rows of bytes, the lowest first; ``kind`` 2 has three bytes a pixel, 3 one."""
    height, width = samples.shape
    rows = np.zeros((height, width + 1), dtype=np.uint8)  # the leading zero of a row says "unfiltered"
    rows[:, 1:] = samples[::-1]
    header = struct.pack(">IIBBBBB", width // 3 if kind == 2 else width, height, 8, kind, 0, 0, 0)
    data = zlib.compress(rows.tobytes(), 9 if kind == 3 else 6)
    parts = ((b"IHDR", header), *before, (b"IDAT", data), (b"IEND", b""))
    chunks = (
        struct.pack(">I", len(data)) + tag + data + struct.pack(">I", zlib.crc32(tag + data)) for tag, data in parts
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def data_uri(image: bytes) -> str:
    """A PNG as a ``data:`` address."""
    return "data:image/png;base64," + base64.b64encode(image).decode("ascii")


def _shares(panel: Panel, cells: int, side_nm: int, pixels: int) -> NDArray[np.float64]:
    """Share of each pixel that each interval covers: half a gutter, the dots, half a gutter, cell after cell."""
    dots, half = panel.opening.dots, panel.gutter_nm // 2
    cell = np.concatenate([[0], half + panel.dot_nm * np.arange(dots + 1)])
    starts = (np.arange(cells)[:, None] * panel.pitch_nm + cell).ravel()
    edges = np.append(starts, cells * panel.pitch_nm).astype(np.float64)
    return _overlap(np.linspace(0.0, side_nm, pixels + 1), edges) * (pixels / side_nm)


def _overlap(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Length of the overlap of every interval between neighbours of ``a`` with every interval of ``b``."""
    high = np.minimum(a[1:, None], b[1:])
    low = np.maximum(a[:-1, None], b[:-1])
    shared: NDArray[np.float64] = np.maximum(high - low, 0.0)
    return shared
