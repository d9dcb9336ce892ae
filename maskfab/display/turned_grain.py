"""Slow grain of an even field whose pixels are turned independently of each other, from the emitters of one pixel.

Let the pixel's luminance be l(x), its integral 1, and L_k(f) its transform under element k of D4, lengths in pixels.
The field is the sum of pixels that each draw an element. Its transform has the mean of L_k on the lattice, whose orders
the eye does not see as slow, and beside them a power that draws leave,

    PSD(f) = mean over k of |L_k(f)|^2 - |mean over k of L_k(f)|^2,     rms^2 = integral over |f| <= F of PSD(f) d^2 f.

To first order in f it is the centroid's wander (:mod:`maskfab.display.eye`); here no order is left out, so that a pixel
whose light is centred has grain too, by the shape of its emitters.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.base.model import ORIENTATIONS, Emitters, orient
from maskfab.display.emitted_light import Viewing
from maskfab.display.eye import SLOW_CPD
from maskfab.optics.colour import LUMINANCE
from maskfab.optics.polynomials import gauss_legendre

_RADII, _ANGLES = 6, 24


def turned_grain(emitters: Emitters, viewing: Viewing, *, elements: Iterable[int] = range(ORIENTATIONS)) -> float:
    """rms luminance contrast, as slow grain, of a white field of pixels that each draw one of the elements."""
    weights = _luminance(emitters)
    if not weights.any():
        return 0.0
    n = len(weights)
    places = (np.arange(n) + 0.5) / n - 0.5
    nodes, steps = gauss_legendre(_RADII)
    highest = SLOW_CPD / viewing.pixels_per_degree
    radius, step = highest * (nodes + 1) / 2, highest * steps / 2
    angle = 2 * math.pi * np.arange(_ANGLES) / _ANGLES
    x, y = (radius[:, None] * part for part in (np.cos(angle), np.sin(angle)))
    along_x, along_y = (np.exp(-2j * math.pi * f[..., None] * places) * np.sinc(f / n)[..., None] for f in (x, y))
    seen = np.stack(
        [np.einsum("raj,ji,rai->ra", along_y, orient(weights, k), along_x, optimize=True) for k in elements]
    )
    power = (np.abs(seen) ** 2).mean(axis=0) - np.abs(seen.mean(axis=0)) ** 2
    return float(math.sqrt(max(0.0, 2 * math.pi * float((power.mean(axis=1) * radius * step).sum()))))


def _luminance(emitters: Emitters) -> Floats:
    """Luminance that every cell of the emitters' grid sends, [n, n], 1 together; white is the sum of all colours."""
    light = np.zeros(emitters.labels.shape)
    for colour, share in enumerate(LUMINANCE.tolist(), 1):
        cells = emitters.labels == colour
        if cells.any():
            light[cells] = share / cells.sum()
    total = light.sum()
    return light / total if total else light
