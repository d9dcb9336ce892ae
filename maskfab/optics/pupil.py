"""The pupil: openings cut by the lens stop, the stop's edge integrated instead of stepped.

A dot that the stop cuts keeps the exact shape of what is left of it, as its moments in Legendre polynomials.
The zeroth moment alone is the usual grey rim; the higher ones carry the curve.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import leggauss, legvander
from numpy.typing import NDArray

from maskfab.model import Stop, frozen
from maskfab.optics.aperture import Aperture, Lattice

Floats = NDArray[np.float64]

RIM_ORDERS = 10
_SLICE_NODES = 12
_SLICES = 3


@dataclass(frozen=True, eq=False)
class Pupil:
    """What is clear inside the stop.

    Attributes:
        x, y: lattices whose edges bound the intervals.
        whole: float64 [ny, nx] transmission of the intervals that the stop leaves whole; 0 elsewhere.
        whole_variance: float64 [ny, nx] its variance within each of them.
        rim_row, rim_column: intp [k] intervals that the stop cuts and that transmit.
        rim_moments: float64 [k, orders, orders]; ``[i, q, p]`` is the mean over interval i of
            transmission x P_q(eta) x P_p(xi) inside the stop, xi and eta in [-1, 1].
        rim_transmission: float64 [k], amplitude of the cut intervals.
        stop: the lens stop.
    """

    x: Lattice
    y: Lattice
    whole: Floats
    whole_variance: Floats
    rim_row: NDArray[np.intp]
    rim_column: NDArray[np.intp]
    rim_moments: Floats
    rim_transmission: Floats
    stop: Stop

    def __post_init__(self) -> None:
        for name in ("whole", "whole_variance", "rim_moments", "rim_transmission"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def mean_transmission(self) -> Floats:
        """Amplitude averaged over each interval, float64 [ny, nx]: the grey-rim picture of the pupil."""
        grey = self.whole.copy()
        grey[self.rim_row, self.rim_column] = self.rim_moments[:, 0, 0]
        return grey

    @property
    def variance(self) -> Floats:
        """Variance of the amplitude within each interval, float64 [ny, nx]: what the grey-rim picture leaves out."""
        share = self.rim_moments[:, 0, 0] / self.rim_transmission
        spread = self.whole_variance.copy()
        spread[self.rim_row, self.rim_column] = self.rim_transmission**2 * np.clip(share * (1 - share), 0, None)
        return spread

    @property
    def field_integral_um2(self) -> float:
        """Integral of the amplitude: the field on the axis."""
        widths, heights = np.diff(self.x.edges_um()), np.diff(self.y.edges_um())
        return float(heights @ self.mean_transmission @ widths)

    @property
    def energy_um2(self) -> float:
        """Integral of the squared amplitude: all transmitted energy; the clear area if the mask is binary."""
        widths, heights = np.diff(self.x.edges_um()), np.diff(self.y.edges_um())
        return float(heights @ (self.mean_transmission**2 + self.variance) @ widths)


def cut(aperture: Aperture, stop: Stop) -> Pupil:
    """The part of an aperture inside a centred stop."""
    x, y = aperture.x.edges_um(), aperture.y.edges_um()
    inside, outside = _circle_sides(x, y, stop) if stop.shape == "circle" else _square_sides(x, y, stop)
    whole = np.where(inside, aperture.transmission, 0.0)
    row, column = np.nonzero(~inside & ~outside & (aperture.transmission != 0))
    transmission = aperture.transmission[row, column]
    boxes = np.stack([x[column], x[column + 1], y[row], y[row + 1]], axis=1)
    shape = _circle_moments if stop.shape == "circle" else _square_moments
    moments = shape(boxes, stop.diameter_um / 2) * transmission[:, None, None]
    variance = np.where(inside, aperture.variance, 0.0)
    return Pupil(aperture.x, aperture.y, whole, variance, row, column, moments, transmission, stop)


def _circle_sides(x: Floats, y: Floats, stop: Stop) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which intervals lie wholly inside the circle, and which wholly outside."""
    radius2 = (stop.diameter_um / 2) ** 2
    far_x, far_y = np.maximum(abs(x[:-1]), abs(x[1:])), np.maximum(abs(y[:-1]), abs(y[1:]))
    near_x, near_y = _nearest_to_zero(x), _nearest_to_zero(y)
    inside = far_x**2 + far_y[:, None] ** 2 <= radius2
    outside = near_x**2 + near_y[:, None] ** 2 >= radius2
    return inside, outside


def _square_sides(x: Floats, y: Floats, stop: Stop) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    half = stop.diameter_um / 2
    tolerance = 1e-9 * stop.diameter_um
    far_x, far_y = np.maximum(abs(x[:-1]), abs(x[1:])), np.maximum(abs(y[:-1]), abs(y[1:]))
    inside = np.maximum(far_x, far_y[:, None]) <= half + tolerance
    outside = np.maximum(_nearest_to_zero(x), _nearest_to_zero(y)[:, None]) >= half - tolerance
    return inside, outside


def _nearest_to_zero(edges: Floats) -> Floats:
    straddles = (edges[:-1] < 0) & (edges[1:] > 0)
    return np.where(straddles, 0.0, np.minimum(abs(edges[:-1]), abs(edges[1:])))


def _square_moments(boxes: Floats, half: float) -> Floats:
    """Moments of box x square: products of one-dimensional ones, exact by Gauss-Legendre."""
    along_x = _clipped_moments(
        boxes[:, 0], boxes[:, 1], np.full((len(boxes), 1), -half), np.full((len(boxes), 1), half)
    )
    along_y = _clipped_moments(
        boxes[:, 2], boxes[:, 3], np.full((len(boxes), 1), -half), np.full((len(boxes), 1), half)
    )
    return along_y[:, 0, :, None] * along_x[:, 0, None, :]


def _circle_moments(boxes: Floats, radius: float) -> Floats:
    """Moments of box x disc, [k, orders, orders], by slices of constant y = R sin(theta).

    Over theta the half chord R cos(theta) is smooth even at the poles, so Gauss-Legendre between the angles at which
    the disc's edge crosses the box's sides converges to rounding.
    """
    x0, x1, y0, y1 = boxes.T

    def angle(y: Floats) -> Floats:
        result: Floats = np.arcsin(np.clip(y / radius, -1, 1))
        return result

    half_chords = np.sqrt(np.clip(radius**2 - np.stack([x0, x1], axis=1) ** 2, 0, None))
    first, last = angle(y0)[:, None], angle(y1)[:, None]
    kinks = np.clip(angle(np.concatenate([half_chords, -half_chords], axis=1)), first, last)
    breaks = np.sort(np.concatenate([kinks, np.linspace(first[:, 0], last[:, 0], _SLICES + 1, axis=1)], axis=1), axis=1)
    nodes, weights = leggauss(_SLICE_NODES)
    lower, length = breaks[:, :-1, None], np.diff(breaks, axis=1)[:, :, None]
    samples = (len(boxes), (breaks.shape[1] - 1) * nodes.size)
    theta = (lower + length * (nodes + 1) / 2).reshape(samples)
    y, half_chord = radius * np.sin(theta), radius * np.cos(theta)
    weight = (length * weights / 2).reshape(samples) * half_chord / (y1 - y0)[:, None]
    along_x = _clipped_moments(x0, x1, -half_chord, half_chord)
    eta = np.clip(2 * (y - y0[:, None]) / (y1 - y0)[:, None] - 1, -1, 1)
    moments: Floats = np.einsum("ksq,ks,ksp->kqp", legvander(eta, RIM_ORDERS - 1), weight, along_x, optimize=True)
    return moments


def _clipped_moments(low: Floats, high: Floats, floor: Floats, ceiling: Floats) -> Floats:
    """Mean over [low, high] of P_p(xi) where floor < x < ceiling; [k], [k], [k, s], [k, s] -> [k, s, orders].

    Integrals of Legendre polynomials are (P_{p+1} - P_{p-1}) / (2p + 1), DLMF 18.16.1 and 14.10.5.
    """
    width = (high - low)[:, None]
    start = np.clip(2 * (np.clip(floor, low[:, None], high[:, None]) - low[:, None]) / width - 1, -1, 1)
    end = np.clip(2 * (np.clip(ceiling, low[:, None], high[:, None]) - low[:, None]) / width - 1, -1, 1)
    orders = np.arange(RIM_ORDERS)

    def antiderivative(xi: Floats) -> Floats:
        values = legvander(xi, RIM_ORDERS)
        below = np.concatenate([-np.ones_like(values[..., :1]), values[..., : RIM_ORDERS - 1]], axis=-1)
        integral: Floats = (values[..., 1:] - below) / (2 * orders + 1)
        return integral

    return np.where((end > start)[..., None], (antiderivative(end) - antiderivative(start)) / 2, 0.0)
