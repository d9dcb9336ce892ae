"""Numbers of the eye on a display as it is tiled: even white, its grain, and the colour fringe of an edge.

They are those of ``maskfab check --look`` (:func:`maskfab.display.eye.judge`), from the same Fourier series, which need
no samples along a pixel: a die takes a fraction of a second. The field of even white and of the edge are the pixels of
the die's orientation map, where it has one, for the regular display round a map would flatter it; else up to 100 x 100
in the middle.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from maskfab.base.arrays import Floats, Singles
from maskfab.display import pictures
from maskfab.display.emitted_light import MOST_SEEN, Series, Tiled, Viewing, ideal, series
from maskfab.display.eye import (
    EDGE,
    FINE_CPD,
    FLAT,
    HIGHEST_CPD,
    SLOW_CPD,
    TEXT,
    appearance,
    carrying,
    colour_difference,
    measured_rms,
    of_series,
)
from maskfab.display.reference import Reference
from maskfab.optics.colour import lab_of_linear_srgb

_ROUNDING = 1e-12
MOST_PIXELS = 100
"""Along a side of the field of a die without a map."""


@dataclass(frozen=True)
class Looks:
    """Everything that is told of how a display looks.

    Attributes:
        delta_e: mean S-CIELAB difference of even white from white without structure.
        grain: rms contrast of the luminance of even white, up to 10 cycles per degree.
        fine_grain: the same from 10 to 30.
        fringe: largest difference in a* and b* of an edge from one without structure, the common shift removed.
    """

    delta_e: float
    delta_e_95: float
    grain: float
    fine_grain: float
    fringe: float


def looks(shown: Tiled, viewing: Viewing) -> Looks:
    """Look at the pixels of a die, seen scaled to the viewing's pitch; the field repeats beyond its edges."""
    return _looks(shown, shown, viewing)


def looks_of_reference(reference: Reference, columns: int, viewing: Viewing) -> Looks:
    """Look at a reference display, which repeats every two pixels, and at an edge as far across as a die's."""
    even = columns + columns % 2
    return _looks(reference.tiled(2, 2), reference.tiled(2, even), viewing)


def _looks(white: Tiled, edged: Tiled, viewing: Viewing) -> Looks:
    spectrum = white.series(_flat(*white.held.shape), viewing, HIGHEST_CPD)
    # Light without structure is one colour everywhere.
    off = colour_difference(of_series(spectrum, viewing), lab_of_linear_srgb(_flat(1, 1)[0, 0]))
    edge = _edge(*edged.held.shape)
    seen = of_series(edged.series(edge, viewing, HIGHEST_CPD), viewing)
    perfect = series(ideal(edge, 1, edged.pitch_um), viewing, HIGHEST_CPD).displaced(*edged.centroid)
    return Looks(
        off.mean,
        off.worst_twentieth,
        _rms(spectrum, 0.0, SLOW_CPD),
        _rms(spectrum, SLOW_CPD, FINE_CPD),
        colour_difference(seen, of_series(perfect, viewing)).fringe,
    )


def _rms(spectrum: Series, low_cpd: float, high_cpd: float) -> float:
    """Contrast in a band; 0 where rounding alone is left of pixels that are all alike."""
    found = measured_rms(spectrum, low_cpd, high_cpd)
    return found if found > _ROUNDING else 0.0


def seen(shown: Tiled, viewing: Viewing, picture: str) -> Singles:
    """A picture on a display as it appears to the eye: linear light [y, x, 3], row 0 the lowest.

    Args:
        shown: the field, of die or reference, square and at least eight pixels wide for text.
        picture: "flat", even grey of half the light, or "text".
    """
    image = _PICTURES[picture](*shown.held.shape)
    return appearance(shown.series(image, viewing, HIGHEST_CPD), viewing).astype(np.float32)


def field_of(
    cells: tuple[int, ...], viewing: Viewing, of_map: tuple[int, int] | None = None, *, least: int = 1
) -> tuple[int, int]:
    """Rows and columns that are looked at, ``least`` or more of either, however near the eye is."""
    most = max(least, math.isqrt(MOST_SEEN) // carrying(HIGHEST_CPD, viewing))
    rows, columns = of_map or (MOST_PIXELS, MOST_PIXELS)
    return max(1, min(cells[0], rows, most)), max(1, min(cells[1], columns, most))


def _flat(rows: int, columns: int) -> Floats:
    return np.broadcast_to(pictures.flat(1), (rows, columns, 3))


def _edge(rows: int, columns: int) -> Floats:
    return np.broadcast_to(pictures.edge(columns)[:1], (rows, columns, 3))


def _text(rows: int, columns: int) -> Floats:
    return pictures.text(max(rows, columns))[:rows, :columns]


_PICTURES: Mapping[str, Callable[[int, int], Floats]] = MappingProxyType({FLAT: _flat, EDGE: _edge, TEXT: _text})
