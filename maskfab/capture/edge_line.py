"""The place of an edge on every line across it, and the polynomial that they lie on.

Steps 3 and 4 of the slanted-edge method of ISO 12233: the centroid of each line's derivative, and a polynomial through
them, here of first to third order and robust. The centroids only begin it: the shift that best maps a line onto the
common edge spread has less noise, as it weighs the derivative's tails by what they say.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.polynomial import Polynomial
from numpy.polynomial.polynomial import polyder, polyval

from maskfab.base.arrays import Floats

Order = Literal[1, 2, 3]

_CENTROID_PX = 8.0
_CENTROID_ROUNDS, _HUBER_ROUNDS = 4, 8
# Residuals beyond so many robust standard deviations count less; Huber's constant for 95 % efficiency.
_HUBER = 1.345
# By how much the information criterion must fall for one more order: strong evidence.
_LEAST_GAIN = 6.0


@dataclass(frozen=True)
class EdgeLine:
    """The edge's place along every line across it, in samples, as a polynomial of the line's number.

    Attributes:
        coefficients: of the powers of (line - middle) / half, from the zeroth on.
        middle, half: which map the lines to -1 to 1.
    """

    coefficients: tuple[float, ...]
    middle: float
    half: float

    @property
    def order(self) -> int:
        return len(self.coefficients) - 1

    def places(self, lines: Floats) -> Floats:
        """Where it crosses them."""
        return np.asarray(polyval((lines - self.middle) / self.half, self.coefficients), np.float64)

    def slopes(self, lines: Floats) -> Floats:
        """Samples per line."""
        found = polyval((lines - self.middle) / self.half, polyder(self.coefficients))
        return np.asarray(found / self.half, np.float64)


def fitted_line(lines: Floats, places: Floats, order: Order | None = None) -> EdgeLine:
    """The polynomial through places on lines, [n] each, robust against a few that are far off (Huber's weights).

    Args:
        lines: their numbers.
        places: NaN where a line has none.
        order: 1 to 3; None for the one with the least Bayesian information criterion.
    """
    known = np.isfinite(places)
    lines, places = lines[known], places[known]
    middle, half = (float(lines[0] + lines[-1])) / 2, max(float(lines[-1] - lines[0]) / 2, 1.0)
    scaled = (lines - middle) / half
    best: tuple[float, Floats] | None = None
    for tried in (order,) if order else (1, 2, 3):
        coefficients, loss = _huber(scaled, places, tried)
        criterion = lines.size * np.log(max(loss, 1e-24)) + (tried + 1) * np.log(lines.size)
        if best is None or criterion < best[0] - _LEAST_GAIN:
            best = criterion, coefficients
    assert best is not None
    return EdgeLine(tuple(map(float, best[1])), middle, half)


def _huber(scaled: Floats, places: Floats, order: int) -> tuple[Floats, float]:
    """Coefficients, and the mean of Huber's loss."""
    weights = np.ones(places.size)
    spread = 0.0
    for _ in range(_HUBER_ROUNDS):
        fit = Polynomial.fit(scaled, places, order, domain=(-1, 1), window=(-1, 1), w=np.sqrt(weights))
        residual = abs(places - fit(scaled))
        spread = 1.4826 * float(np.median(residual))
        if spread <= 1e-9:
            break
        weights = np.minimum(1.0, _HUBER * spread / np.maximum(residual, 1e-300))
    limit = _HUBER * max(spread, 1e-9)
    residual = abs(places - fit(scaled))
    loss = np.where(residual <= limit, residual**2, 2 * limit * residual - limit**2)
    return np.asarray(fit.coef, np.float64), float(loss.mean())


def centroid_line(values: Floats, lines: Floats, first: Floats, order: Order | None) -> EdgeLine:
    """The line through the centroids of the lines' derivatives, each within a Hann window about the last estimate.

    Args:
        values: float64 [n, samples]; nothing is missing.
        lines: numbers of the lines, [n].
        first: a first estimate of the places, [n].
        order: of the polynomial, or None.
    """
    derivative = np.diff(values, axis=1)
    between = np.arange(derivative.shape[1]) + 0.5
    step = float(np.median(abs(derivative.sum(axis=1))))
    places = first
    for _ in range(_CENTROID_ROUNDS):
        off = between - places[:, None]
        seen = derivative * np.where(abs(off) < _CENTROID_PX, np.cos(np.pi / (2 * _CENTROID_PX) * off) ** 2, 0.0)
        total = seen.sum(axis=1)
        moved = (seen * off).sum(axis=1) / np.where(total, total, np.nan)
        # A line without a step of its own has no centroid.
        sure = (abs(total) > 0.1 * step) & (abs(moved) < _CENTROID_PX)
        line = fitted_line(lines, np.where(sure, places + moved, np.nan), order)
        places = line.places(lines)
    return line
